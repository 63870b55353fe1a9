"""A load cell that drifts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class ForceDrift(Measurement):
    """Drift of the force, or of the stress, with time."""

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
    sought_without_tool: ClassVar[Mapping[str, Sought]] = {
        "rate_Pa_s": Sought((-0.03, -0.2, 0.03, 0.2), -1.0, 1.0, scale="drift_Pa_s")
    }
    requires: ClassVar[tuple[str, ...]] = ("time",)
    without_tool = True
    rate_N_s: float = Field(default=0.0, description="drift [N/s]")
    rate_Pa_s: float = Field(default=0.0, description="the same where stresses are read [Pa/s]")

    @property
    def strength(self) -> float:
        return self.rate_N_s or self.rate_Pa_s

    def read_load(self, true: np.ndarray, record: Record) -> np.ndarray:
        return true + self._rate(record) * record.time_s

    def true_load(self, read: np.ndarray, record: Record) -> np.ndarray:
        return read - self._rate(record) * record.time_s

    def _rate(self, record: Record) -> float:
        return self.rate_N_s if record.with_tool else self.rate_Pa_s
