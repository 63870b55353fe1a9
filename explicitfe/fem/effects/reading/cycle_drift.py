"""Stiffness that changes from repeat to repeat: preconditioning, drying."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class CycleDrift(Measurement):
    """Relative change of the load from one repeat to the next."""

    about: ClassVar[Description] = Description(
        title="drift from repeat to repeat",
        equation="F_read = F (1 + r (cycle - 1))",
        source="-",
        where="measurement",
        strength="r",
        plausible=0.2,
        needs="repeated cycles",
        neighbours="softening (after the first only), viscoelastic (recovers with rest)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"per_cycle": Sought((-0.03, -0.15, 0.03, 0.15), -0.5, 0.5)}
    requires: ClassVar[tuple[str, ...]] = ("repeats",)
    without_tool = True
    per_cycle: float = Field(gt=-1.0, description="relative change a repeat")

    @property
    def strength(self) -> float:
        return self.per_cycle

    def read_load(self, true: np.ndarray, record: Record) -> np.ndarray:
        return true * self._factor(record)

    def true_load(self, read: np.ndarray, record: Record) -> np.ndarray:
        return read / self._factor(record)

    def _factor(self, record: Record) -> float:
        return 1.0 + self.per_cycle * (record.cycle - 1.0)
