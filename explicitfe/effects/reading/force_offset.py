"""A load cell that was not at zero."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.effects.effect import Description, Measurement, Sought


class ForceOffset(Measurement):
    """Constant error of the force."""

    about: ClassVar[Description] = Description(
        title="offset of the load cell",
        equation="F_read = F + F0",
        source="-",
        where="measurement",
        strength="F0 (N)",
        plausible=0.1,
        needs="rows before contact or small depths",
        neighbours="preload, contact-offset",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"offset_N": Sought((-0.02, -0.1, 0.02, 0.1), -0.5, 0.5, scale="force_N")}
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    offset_N: float = Field(description="reading without a load [N]")

    @property
    def strength(self) -> float:
        return self.offset_N

    def read_force(self, force_N: np.ndarray, time_s: np.ndarray, cycle: float) -> np.ndarray:
        return force_N + self.offset_N
