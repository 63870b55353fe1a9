"""Two channels that are not recorded at one time: the load comes later than the motion, as through a filter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import scipy
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class Lag(Measurement):
    """Time by which the load is recorded late. Before the first row of a test and after its last one nothing changes."""

    about: ClassVar[Description] = Description(
        title="lag between load and motion",
        equation="F_read(t) = F(t - T)",
        source="-",
        where="measurement",
        strength="T (s)",
        plausible=1.0,
        needs="unloading, or two rates",
        neighbours="viscoelastic (relaxes in a hold), friction and softening (do not depend on the rate)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"lag_s": Sought((-0.005, -0.02, 0.005, 0.02), -0.3, 0.3, scale="shortest_s")}
    requires: ClassVar[tuple[str, ...]] = ("time",)
    without_tool = True
    lag_s: float = Field(description="time by which the load comes late [s]; negative: early")

    @property
    def strength(self) -> float:
        return self.lag_s

    def read_load(self, true: np.ndarray, record: Record) -> np.ndarray:
        return self._shifted(true, record, -self.lag_s)

    def true_load(self, read: np.ndarray, record: Record) -> np.ndarray:
        return self._shifted(read, record, self.lag_s)

    def _shifted(self, column: np.ndarray, record: Record, by_s: float) -> np.ndarray:
        if by_s == 0.0:
            return column
        t, values = record.whole or (record.time_s, column)
        return scipy.interpolate.PchipInterpolator(t, values)(np.clip(record.time_s + by_s, t[0], t[-1]))
