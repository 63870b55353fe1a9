"""A load cell that drifts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.effects.effect import Description, Measurement, Sought


class ForceDrift(Measurement):
    """Drift of the force with time."""

    about: ClassVar[Description] = Description(
        title="drift of the load cell",
        equation="F_read = F + r t",
        source="-",
        where="measurement",
        strength="r (N/s)",
        plausible=0.001,
        needs="long holds",
        neighbours="viscoelastic (saturates, goes with the load)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"rate_N_s": Sought((-0.03, -0.2, 0.03, 0.2), -1.0, 1.0, scale="drift_N_s")}
    requires: ClassVar[tuple[str, ...]] = ("tool", "time")
    rate_N_s: float = Field(description="drift [N/s]")

    @property
    def strength(self) -> float:
        return self.rate_N_s

    def read_force(self, force_N: np.ndarray, time_s: np.ndarray, cycle: float) -> np.ndarray:
        return force_N + self.rate_N_s * time_s
