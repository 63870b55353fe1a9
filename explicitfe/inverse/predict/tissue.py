"""A tissue: its constants and the effects that it has beside them, with which any dataset can be predicted; and its model file.

format = "explicitfe-model/1"
poisson = 0.499                  # in elements
incompressible = true            # homogeneous states are computed in the incompressible limit

[constants]                      # or one table a group of constants: [constants.fibre], [constants.cross-fibre]
C10_Pa = 210.0
C20_Pa = 90.0

[effects]                        # as in a scenario
viscoelastic = { g = [0.3, 0.2], tau_s = [1.0, 20.0] }

[numerics]                       # how tests under a tool are computed with it; these are the defaults
refinement = 1.0
density = 1.0
tolerance = 1e-4
section = 0.0
finer = 0.0
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import BeforeValidator, Field, ValidationError

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import Table, Title, validated
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.inverse.measured.curve import Curve, SpecimenDataset
from explicitfe.inverse.measured.tables import MeasuredSpecimen, MeasuredTool, RawTable
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.text import text_of, toml_of
from explicitfe.platform.host.toml_text import toml_key, toml_value
from explicitfe.simulate.scenario.effects_table import EffectsTable

FORMAT: Literal["explicitfe-model/1"] = "explicitfe-model/1"
EVERY = "*"  # This group of constants stands for all.
# The incompressible limit of homogeneous states, whose stress differs by 2e-5 from it. Elements need about ten times the
# iterations and the time steps at this ratio, so they keep the tissue's own.
INCOMPRESSIBLE_POISSON_RATIO = 0.49999
_MeasuredTable = TypeVar("_MeasuredTable", MeasuredSpecimen, MeasuredTool)


def effect_name(effect: Effect) -> str:
    """The name of an effect in the table of all effects."""
    return next(name for name, kind in EFFECTS.items() if kind is type(effect))


class Constants(Table):
    """Yeoh's constants; where the tissue relaxes, they are those of a sudden load."""

    C10_Pa: float = Field(gt=0.0, description="first constant [Pa]")
    C20_Pa: float = Field(default=0.0, ge=0.0, description="second constant [Pa]")


class Numerics(Table):
    """How tests under a tool are computed: a prediction follows from the file alone.

    Coarser than by 0.1 no element is left under the tool, finer than by 10 a test takes days."""

    refinement: float = Field(default=1.0, ge=0.1, le=10.0, description="divides the element sizes")
    density: float = Field(default=1.0, ge=0.1, le=100.0, description="multiplies the numbers of instants")
    tolerance: float = Field(default=1e-4, ge=1e-9, le=1e-2, description="relative force residual of an equilibrium")
    section: float = Field(
        default=0.0, ge=0.0, le=10.0, description="refinement of the section, where a body of revolution is solved; 0: hexahedra"
    )
    finer: float = Field(
        default=0.0, ge=0.0, le=10.0, description="refinement to which ramps correct the answers; 0: as they are computed"
    )


def _grouped(value: object) -> object:
    if not isinstance(value, dict) or not value:
        raise ValueError("must be a table with C10_Pa and C20_Pa, or one such table a group")
    return value if all(isinstance(v, dict | Constants) for v in value.values()) else {EVERY: value}


class Tissue(Table):
    """Constants with effects; the schema of a model file."""

    format: Literal["explicitfe-model/1"] = FORMAT
    title: Title = ""
    poisson: float = Field(default=0.499, ge=0.0, lt=0.5, description="Poisson's ratio; of elements alone if incompressible")
    incompressible: bool = Field(
        default=False, description=f"compute homogeneous states with Poisson's ratio {INCOMPRESSIBLE_POISSON_RATIO:g}"
    )
    constants_by: str | None = Field(default=None, min_length=1, description='condition, or "group", that names the constants')
    constants: Annotated[dict[str, Constants], BeforeValidator(_grouped)]
    effects: EffectsTable = EffectsTable()
    specimen: RawTable = Field(default={}, description="keys that replace the dataset's")
    tool: RawTable = Field(default={}, description="keys that replace the dataset's")
    numerics: Numerics = Numerics()

    def law(self, curve: Curve, *, homogeneous: bool = False) -> Yeoh:
        """The elastic law of a curve, for elements or for a homogeneous state.

        Raises
        ------
        InputError : the model has no constants for it.
        """
        constants = self.constants.get(curve.constants, self.constants.get(EVERY))
        if constants is None:
            raise InputError(
                f'the model has no [constants.{toml_key(curve.constants)}], which curve "{curve.id}" needs; '
                f"{nearest(curve.constants, self.constants)}"
            )
        density = {} if curve.specimen is None else {"density_kg_m3": curve.specimen.density_kg_m3}
        poisson = INCOMPRESSIBLE_POISSON_RATIO if homogeneous and self.incompressible else self.poisson
        return Yeoh(C10_Pa=constants.C10_Pa, C20_Pa=constants.C20_Pa, poisson=poisson, **density)

    def with_effect(self, effect: Effect) -> Tissue:
        """The tissue with one effect more, or another instead of one of its kind."""
        key = effect_name(effect).replace("-", "_")
        return self.model_copy(update={"effects": self.effects.model_copy(update={key: effect})})

    def grouped(self, dataset: SpecimenDataset) -> SpecimenDataset:
        """The dataset with its constants by ``constants_by`` and the keys of [specimen] and [tool] replaced.

        Raises
        ------
        InputError : a key is none of the dataset's, or no constants are given for a curve.
        """
        if self.constants_by is not None:
            dataset = dataset.regrouped(self.constants_by)
        curves = []
        for curve in dataset.curves:
            specimen = _replaced("specimen", curve.specimen, self.specimen, MeasuredSpecimen, curve.id)
            tool = _replaced("tool", curve.tool, self.tool, MeasuredTool, curve.id)
            curves.append(replace(curve, specimen=specimen, tool=tool))
            self.law(curve)
        return replace(dataset, curves=tuple(curves))

    @property
    def key(self) -> tuple[Hashable, ...]:
        """Equal for tissues with the same answers."""
        constants = tuple((group, one.C10_Pa, one.C20_Pa) for group, one in self.constants.items())
        effects, replaced = tuple(map(repr, self.effects.chosen)), (repr(self.specimen), repr(self.tool))
        return self.poisson, self.incompressible, self.constants_by, constants, effects, *replaced, self.numerics

    @property
    def text(self) -> str:
        """The text of its model file; read again it gives the same tissue, bit by bit."""
        lines = [f"format = {toml_value(self.format)}"]
        if self.title:
            lines.append(f"title = {toml_value(self.title)}")
        lines.append(f"poisson = {toml_value(self.poisson)}")
        if self.incompressible:
            lines.append("incompressible = true")
        if self.constants_by is not None:
            lines.append(f"constants_by = {toml_value(self.constants_by)}")
        for group, constants in self.constants.items():
            lines += ["", "[constants]" if group == EVERY else f"[constants.{toml_key(group)}]"]
            lines += [f"{name} = {toml_value(number)}" for name, number in constants.model_dump().items()]
        tables = {
            "effects": self.effects.model_dump(by_alias=True, exclude_none=True),
            "specimen": self.specimen,
            "tool": self.tool,
            "numerics": self.numerics.model_dump(exclude_defaults=True),
        }
        for name, table in tables.items():
            if table:
                lines += ["", f"[{name}]", *(f"{toml_key(key)} = {toml_value(value)}" for key, value in table.items())]
        return "\n".join(lines) + "\n"


def _replaced(
    name: str, own: _MeasuredTable | None, keys: RawTable, table: type[_MeasuredTable], curve: str
) -> _MeasuredTable | None:
    """A table of a curve with the tissue's keys over its own."""
    if not keys:
        return own
    if own is None:
        raise InputError(f'the model replaces keys of [{name}], and curve "{curve}" has none; take them out.')
    data = own.model_dump(exclude_unset=True, mode="json") | keys
    try:
        return validated(table, data)
    except ValidationError as error:
        raise InputError(f"[{name}] of the model: {explain(error, data, table)}") from None


def read_tissue(path: Path | str) -> Tissue:
    """The tissue of a model file, checked.

    Raises
    ------
    InputError : it cannot be read, is no TOML, or does not fit the schema; one sentence with file and key.
    """
    return parse_tissue(text_of(path, f'give a model file, which begins with format = "{FORMAT}"'), str(path))


def parse_tissue(text: str, name: str = "model") -> Tissue:
    """The tissue from a model file's text; see :func:`read_tissue`."""
    data = toml_of(text, name)
    if "format" not in data:
        raise InputError(f'{name}: the key "format" is missing; a model file begins with format = "{FORMAT}".')
    try:
        return validated(Tissue, data)
    except ValidationError as error:
        raise InputError(f"{name}: {explain(error, data, Tissue).replace('the scenario', 'the model')}") from None
