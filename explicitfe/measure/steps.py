"""Which stored step of a run is measured or drawn."""

from __future__ import annotations

import numpy as np

from explicitfe.errors import InputError
from explicitfe.results import Recorded


def last_step(result: Recorded) -> int:
    """The last stored step whose displacements are finite.

    Raises
    ------
    InputError : there is none.
    """
    for step in reversed(range(len(result.times))):
        if np.isfinite(result.displacement(step)).all():
            return step
    raise InputError(f"{result.path} has no step that can be drawn or measured; run the scenario again")


def step_at(result: Recorded, time_s: float | None) -> int:
    """The stored step nearest to a time; the last one with finite displacements if left out.

    Raises
    ------
    InputError : there is none, or the time is not one of the run, or the displacements there are not finite.
    """
    last = last_step(result)
    if time_s is None:
        return last
    first_ms, last_ms = 1e3 * result.times[0], 1e3 * result.times[last]
    rounding_ms = 1e-6 * max(abs(first_ms), abs(last_ms))
    if not first_ms - rounding_ms <= 1e3 * time_s <= last_ms + rounding_ms:
        raise InputError(f"{result.path} has no time {1e3 * time_s:g} ms; give one from {first_ms:g} to {last_ms:g} ms")
    return int(np.argmin(np.abs(result.times[: last + 1] - time_s)))
