"""The zero of displacement is not first touch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.effects.effect import Description, Measurement, Sought


class ContactOffset(Measurement):
    """How far the tool is from first touch where the displacement is called zero."""

    about: ClassVar[Description] = Description(
        title="offset of the contact point",
        equation="d_tool = d + d0",
        source="-",
        where="measurement",
        strength="d0 (mm)",
        plausible=1.0,
        needs="small depths",
        neighbours="preload, force-offset, tilt",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"offset_mm": Sought((-0.03, -0.1, 0.03, 0.1), -0.5, 0.5, scale="displacement_mm")}
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    offset_mm: float = Field(description="way of the tool into the tissue at displacement 0 [mm]; negative: a gap")

    @property
    def strength(self) -> float:
        return self.offset_mm

    def true_displacement(self, displacement_m: np.ndarray) -> np.ndarray:
        return displacement_m + 1e-3 * self.offset_mm
