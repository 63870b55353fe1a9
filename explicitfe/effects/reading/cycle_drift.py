"""Stiffness that changes from repeat to repeat: preconditioning, drying."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.effects.effect import Description, Measurement, Sought


class CycleDrift(Measurement):
    """Relative change of the force from one repeat to the next."""

    about: ClassVar[Description] = Description(
        title="drift from repeat to repeat",
        equation="F_read = F (1 + r (cycle - 1))",
        source="-",
        where="measurement",
        strength="r",
        plausible=0.2,
        needs="repeats",
        neighbours="softening (after the first only), viscoelastic (recovers with rest)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"per_cycle": Sought((-0.03, -0.15, 0.03, 0.15), -0.5, 0.5)}
    requires: ClassVar[tuple[str, ...]] = ("repeats",)
    without_tool = True
    per_cycle: float = Field(gt=-1.0, description="relative change a repeat")

    @property
    def strength(self) -> float:
        return self.per_cycle

    def read_force(self, force_N: np.ndarray, time_s: np.ndarray, cycle: float) -> np.ndarray:
        return force_N * (1.0 + self.per_cycle * (cycle - 1.0))
