"""A motion that is read too small or too large: a wrong gauge length, an encoder or a camera with another scale."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class GaugeLength(Measurement):
    """Relative error of the scale of strain, or of displacement."""

    about: ClassVar[Description] = Description(
        title="scale of the strain",
        equation="e_true = (1 + s) e_read",
        source="-",
        where="measurement",
        strength="s",
        plausible=0.15,
        needs="large strains; at small strains the effect equals a change of C10",
        neighbours="C10 and C20 themselves, third-yeoh, compliance",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"error": Sought((-0.05, -0.15, 0.05, 0.15), -0.2, 0.2)}
    requires: ClassVar[tuple[str, ...]] = ("strain",)
    without_tool = True
    error: float = Field(gt=-0.9, le=2.0, description="true strain over that which is read, less 1")

    @property
    def strength(self) -> float:
        return self.error

    def true_motion(self, read: np.ndarray, record: Record) -> np.ndarray:
        return read * (1.0 + self.error)

    def read_motion(self, true: np.ndarray, record: Record) -> np.ndarray:
        return true / (1.0 + self.error)
