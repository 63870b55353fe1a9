"""The edge of a flat tool is rounder than its dataset says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import SpecimenT, ToolT
from explicitfe.fem.effects.effect import Description, Effect, Sought


class Edge(Effect):
    """Rounding of a flat tool's edge, beyond the stated one."""

    about: ClassVar[Description] = Description(
        title="rounding of the tool's edge",
        equation="the edge is a torus of the stated radius and r more",
        source="geometry",
        where="contact",
        strength="r (mm)",
        plausible=3.0,
        needs="a test at small depths, where the flat face touches before the edge",
        neighbours="C10 and C20 themselves, contact-offset, tilt",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"rounder_mm": Sought((0.25, 0.5, 1.0), 0.0, 1.6, scale="edge_mm")}
    requires: ClassVar[tuple[str, ...]] = ("tool", "edge")
    acts_on = "tool"
    rounder_mm: float = Field(ge=0.0, description="radius of the rounding, beyond the stated one [mm]")

    @property
    def strength(self) -> float:
        return self.rounder_mm

    def prepare(self, specimen: SpecimenT, tool: ToolT) -> tuple[SpecimenT, ToolT]:
        table = tool.model_dump()
        return specimen, type(tool).model_validate(table | {"edge_radius_mm": table["edge_radius_mm"] + self.rounder_mm})
