"""A tool that leans: its axis makes an angle with the normal of the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.affected import ModelT, SpecimenT, ToolT, tool_of
from explicitfe.fem.effects.effect import Description, Effect, Sought


class Tilt(Effect):
    """Angle of the tool about the y axis."""

    about: ClassVar[Description] = Description(
        title="tilt of the tool",
        equation="the tool turned by theta about the middle of its face",
        source="geometry",
        where="loading",
        strength="theta^2 (degrees^2): the response is even",
        plausible=25.0,
        needs="a test at small depths, where one side touches first",
        neighbours="contact-offset, layer",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"angle_deg": Sought((2.0, 5.0), 0.0, 12.0, kind="square")}
    requires: ClassVar[tuple[str, ...]] = ("tool", "flat tool")
    acts_on = "tool"
    in_revolution = False
    needs_half_body = True
    angle_deg: float = Field(ge=-20.0, le=20.0, description="angle [degrees]")

    @property
    def strength(self) -> float:
        return self.angle_deg**2

    @property
    def breaks_symmetry(self) -> bool:
        return self.angle_deg != 0.0

    def prepare(self, specimen: SpecimenT, tool: ToolT) -> tuple[SpecimenT, ToolT]:
        if self.angle_deg != 0.0 and specimen.symmetry in ("sector", "quarter"):
            return specimen.model_copy(update={"symmetry": "half"}), tool
        return specimen, tool

    def apply(self, model: ModelT) -> ModelT:
        return replace(model, tool=replace(tool_of(model), tilt_rad=float(np.radians(self.angle_deg))))
