"""Activation profiles of loads: piecewise linear in time, with jumps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from explicitfe.fem.inputs.argument import finite_number
from explicitfe.fem.mesh.checked_arrays import number_array
from explicitfe.platform.errors import InputError


@dataclass(frozen=True)
class Profile:
    """Activation profile of a load: a piecewise linear factor of time.

    Two equal times in a row are a jump. Before the first time the factor is the first value, after the last time the last one.

    Parameters
    ----------
    time_s : (k,) times, s, not decreasing.
    scale : (k,) factors of the load at these times, dimensionless.
    lag_s : time constant with which the load follows the profile, lag df/dt + f = scale, from 0 before time 0; 0: at once.

    Raises
    ------
    InputError : arrays of different lengths, empty, not finite, or times that decrease; a negative ``lag_s``.
    """

    time_s: np.ndarray
    scale: np.ndarray
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("time_s", "scale"):
            object.__setattr__(self, name, number_array(f"Profile: {name}", getattr(self, name), ("k",)))
        if not len(self.time_s):
            raise InputError("Profile: time_s needs at least one time.")
        if len(self.scale) != len(self.time_s):
            raise InputError(
                f"Profile: scale has {len(self.scale)} entries and time_s {len(self.time_s)}; give one for each time."
            )
        if (np.diff(self.time_s) < 0.0).any():
            raise InputError("Profile: time_s must not decrease; sort the times.")
        finite_number("Profile: lag_s", self.lag_s, 0.0)

    @classmethod
    def constant(cls) -> Profile:
        """The factor 1 at all times."""
        return cls(np.array([0.0]), np.array([1.0]))

    @classmethod
    def step(cls, start_s: float, end_s: float = np.inf, rise_s: float = 0.0) -> Profile:
        """A step, or a ramp: 0 before ``start_s``, 1 after ``rise_s`` more, 0 again from ``end_s`` on.

        Parameters
        ----------
        start_s : where it begins, s.
        end_s : where it ends, s; never if left out.
        rise_s : duration of the ramp, s.

        Raises
        ------
        InputError : a number that is not finite, a negative ``rise_s``, or an end before the ramp is over.
        """
        start_s, rise_s = finite_number("Profile.step: start_s", start_s), finite_number("Profile.step: rise_s", rise_s, 0.0)
        if end_s != np.inf and finite_number("Profile.step: end_s", end_s) < start_s + rise_s:
            raise InputError(f"Profile.step: end_s = {end_s:g} is not possible: the step is complete at {start_s + rise_s:g} s.")
        times, scales = [start_s, start_s + rise_s], [0.0, 1.0]
        if np.isfinite(end_s):
            times, scales = times + [end_s, end_s], scales + [1.0, 0.0]
        return cls(np.array(times), np.array(scales))

    def times_ramp(self, at_s: float, over_s: float) -> Profile:
        """The profile times a ramp that rises from 0 to 1 between ``at_s`` and ``at_s + over_s``, both in s.

        Jumps of both are kept. Where both change, their product is linear between twenty instants of the ramp.
        """
        end_s = at_s + over_s
        inside = self.time_s[(self.time_s >= at_s) & (self.time_s <= end_s)]
        grid = np.unique(np.concatenate([np.linspace(at_s, end_s, 21), inside]))
        share = np.clip((grid - at_s) / over_s, 0.0, 1.0) if over_s > 0.0 else np.zeros(len(grid))
        after = share if over_s > 0.0 else np.ones(len(grid))
        pairs = np.column_stack([share * self._limit(grid, "left"), after * self._limit(grid, "right")])
        later = self.time_s > end_s
        return Profile(
            np.concatenate([np.repeat(grid, 2), self.time_s[later]]),
            np.concatenate([pairs.ravel(), self.scale[later]]),
            self.lag_s,
        )

    @property
    def edges_s(self) -> np.ndarray:
        """Times at which the factor jumps or its slope changes, s; a run puts its steps on them."""
        return np.unique(self.time_s)

    def at(self, time_s: np.ndarray, *, tolerance_s: float) -> np.ndarray:
        """Factors at increasing times; at a jump the mean of both sides, which keeps central differences of second order.

        At time 0, where the half step of the start uses later times only, the factor is that of the right side.

        Parameters
        ----------
        time_s : (t,) increasing times, s.
        tolerance_s : a time that is nearer to an edge is taken to be on it, s.

        Returns
        -------
        (t,) factors.
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
