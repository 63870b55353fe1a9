"""Selection of the stored sample that is measured or drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.results.files import Recorded


def last_step(result: Recorded) -> int:
    """Number of the last stored sample whose displacements are finite.

    Raises
    ------
    InputError : there is none.
    """
    for step in reversed(range(len(result.times))):
        if np.isfinite(result.displacement(step)).all():
            return step
    raise InputError(f"{result.path} has no sample with finite displacements; run the scenario again.")


def step_at(result: Recorded, time_s: float | None) -> int:
    """Number of the stored sample nearest to a time; of the last one with finite displacements if the time is None.

    Raises
    ------
    InputError : there is none, or the time is outside the times of the samples with finite displacements.
    """
    last = last_step(result)
    if time_s is None:
        return last
    first_ms, last_ms = 1e3 * result.times[0], 1e3 * result.times[last]
    rounding_ms = 1e-6 * max(abs(first_ms), abs(last_ms))
    if not first_ms - rounding_ms <= 1e3 * time_s <= last_ms + rounding_ms:
        raise InputError(
            f"{result.path}: time {1e3 * time_s:g} ms is outside the stored samples; "
            f"give a time from {first_ms:g} to {last_ms:g} ms."
        )
    return int(np.argmin(np.abs(result.times[: last + 1] - time_s)))


def common_steps(results: Sequence[Recorded], time_s: float | None) -> tuple[float, list[int]]:
    """A time, s, and the number of the sample of each result that is nearest to it.

    Parameters
    ----------
    time_s : the time; by default the last one that all results have.

    Raises
    ------
    InputError : a result does not have the time.
    """
    if time_s is None:
        time_s = min(float(result.times[last_step(result)]) for result in results)
    return time_s, [step_at(result, time_s) for result in results]
