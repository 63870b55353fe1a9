"""The scenario of an indentation: a tool presses on a specimen in a sequence of equilibria."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from explicitfe.fem.inputs.limits import RelativeResidual, StressField
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.inputs.table import MOST_ROWS_OF_A_COURSE, MOST_TABLES_OF_A_KIND, Table, Threads, Title
from explicitfe.simulate.scenario.effects_table import EffectsTable
from explicitfe.simulate.scenario.expected import EXPECTED, ExpectedNumbers


class RelaxationTable(Table):
    """One equilibrium after the other, by dynamic relaxation."""

    type: Literal["relaxation"] = Field(description="one equilibrium after the other")
    forces_N: list[Annotated[float, Field(ge=0.0)]] | None = Field(
        default=None,
        max_length=MOST_ROWS_OF_A_COURSE,
        description="of the whole tool, one after the other",
    )
    displacements_mm: list[float] | None = Field(
        default=None,
        max_length=MOST_ROWS_OF_A_COURSE,
        description="of the tool into the tissue, instead of forces; negative: away from it",
    )
    times_s: list[float] | None = Field(default=None, description="times of the loads; 1 s for each load by default")
    tolerance: RelativeResidual = Field(default=1e-4, description="relative force residual")
    threads: Threads = None

    @model_validator(mode="after")
    def _one_course(self) -> RelaxationTable:
        if (self.forces_N is None) == (self.displacements_mm is None):
            raise ValueError("give either forces_N or displacements_mm, and not both")
        if not self.course:
            raise ValueError("at least one load is needed")
        if self.times_s is not None and len(self.times_s) != len(self.course):
            raise ValueError(f"times_s has {len(self.times_s)} entries and the loads are {len(self.course)}")
        if self.times_s is not None and any(b <= a for a, b in zip([0.0, *self.times_s], self.times_s, strict=False)):
            raise ValueError("times_s must rise from above 0")
        return self

    @property
    def course(self) -> list[float]:
        """The loads, N or mm."""
        return (self.displacements_mm if self.forces_N is None else self.forces_N) or []


class SpecimenRecordTable(Table):
    """What is stored."""

    fields: list[Literal["displacement", "J", "strain_energy_density", "hourglass_energy", StressField]] = Field(
        default=["displacement", "J", "strain_energy_density", "hourglass_energy"],
        description="what is stored of every node or element at each equilibrium; in addition to the default stress, von_mises, "
        "pressure, their means at nodes (nodal_...), strain and stretches",
    )


class IndentationScenario(Table):
    """One indentation, as its file states it."""

    title: Title
    question: str = Field(default="", description="what the run is to answer")
    expect: str = Field(default="", description="expected result, in words")
    expected: list[ExpectedNumbers] = Field(default=[], max_length=MOST_TABLES_OF_A_KIND, description=EXPECTED)
    model: SpecimenTable
    tool: ToolTable
    effects: EffectsTable = EffectsTable()
    analysis: RelaxationTable
    record: SpecimenRecordTable = SpecimenRecordTable()

    @property
    def file_names(self) -> tuple[str, ...]:
        """The files that it names, relative to its own: none."""
        return ()
