"""How a load changes with time: piecewise linear, with jumps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Profile:
    """A piecewise linear function of time; two equal times in a row are a jump.

    Attributes
    ----------
    time_s : (k,) s, not decreasing. Before the first and after the last the value is the first and the last one.
    scale : (k,). Dimensionless factor of the load.
    lag_s : time constant with which the load follows it, lag df/dt + f = scale, from rest before time 0; 0: at once.
    """

    time_s: np.ndarray
    scale: np.ndarray
    lag_s: float = 0.0

    @classmethod
    def constant(cls) -> Profile:
        """On all the time."""
        return cls(np.array([0.0]), np.array([1.0]))

    @classmethod
    def step(cls, start_s: float, end_s: float, rise_s: float = 0.0) -> Profile:
        """0 before ``start_s``, rising to 1 within ``rise_s``, back to 0 at ``end_s`` (inf: never)."""
        times, scales = [start_s, start_s + rise_s], [0.0, 1.0]
        if np.isfinite(end_s):
            times, scales = times + [end_s, end_s], scales + [1.0, 0.0]
        return cls(np.array(times), np.array(scales))

    @property
    def edges_s(self) -> np.ndarray:
        """Times at which the value jumps or the slope changes: they are put on step boundaries."""
        return np.unique(self.time_s)

    def at(self, time_s: np.ndarray, *, tolerance_s: float) -> np.ndarray:
        """Values at increasing times; at a jump the mean of both sides, which keeps central differences of second order.

        At time 0, where the half-step start looks forward only, the value is that of the right side.
        """
        time_s = np.asarray(time_s, dtype=float)
        if self.lag_s > 0.0:
            return self._followed(time_s)
        if not np.any((self.time_s >= time_s[0] - tolerance_s) & (self.time_s <= time_s[-1] + tolerance_s)):
            # No edge in sight. The same operations as below: a value must not round otherwise because of others asked with it.
            return self._limit(time_s, "right")
        near = np.abs(self.time_s - time_s[:, None])
        time_s = np.where(near.min(axis=1) < tolerance_s, self.time_s[near.argmin(axis=1)], time_s)
        right = self._limit(time_s, "right")
        return np.where(time_s <= 0.0, right, 0.5 * (self._limit(time_s, "left") + right))

    def _limit(self, time_s: np.ndarray, side: Literal["left", "right"]) -> np.ndarray:
        after = np.searchsorted(self.time_s, time_s, side=side)
        high, low = np.minimum(after, len(self.time_s) - 1), np.maximum(after - 1, 0)
        width = self.time_s[high] - self.time_s[low]
        share = np.divide(time_s - self.time_s[low], width, out=np.zeros_like(time_s), where=width > 0.0)
        value = self.scale[low] + share * (self.scale[high] - self.scale[low])
        return np.where(after == 0, self.scale[0], np.where(after == len(self.time_s), self.scale[-1], value))

    def _followed(self, time_s: np.ndarray) -> np.ndarray:
        """The lagged value at times, exactly: between knots the scale is a + b t, and f = a + b (t - lag) + C e^(-t / lag)."""
        lag = self.lag_s
        knots = np.unique(np.append(self.time_s[self.time_s > 0.0], 0.0))
        start = self._limit(knots, "right")
        slope = np.append(np.diff(knots) * 0.0, 0.0)
        slope[:-1] = (self._limit(knots[1:], "left") - start[:-1]) / np.diff(knots)
        value = np.zeros(len(knots))  # of f at the knots
        for k, width in enumerate(np.diff(knots)):
            decaying = value[k] - (start[k] - slope[k] * lag)
            value[k + 1] = start[k] + slope[k] * (width - lag) + decaying * np.exp(-width / lag)
        before = np.clip(np.searchsorted(knots, time_s, side="right") - 1, 0, None)
        since = np.maximum(time_s - knots[before], 0.0)
        decaying = value[before] - (start[before] - slope[before] * lag)
        return start[before] + slope[before] * (since - lag) + decaying * np.exp(-since / lag)
