"""Selection of the stored samples that are drawn, and their times in words."""

from __future__ import annotations

import math

import numpy as np

# Number of times drawn in addition to the shape at rest; more outlines would overlap.
DRAWN_TIMES = 6


def drawn_steps(times: np.ndarray, last: int, count: int = DRAWN_TIMES) -> list[int]:
    """Up to ``count`` steps after the first, equally spaced in time, ``last`` among them."""
    wanted = times[0] + (times[last] - times[0]) * np.arange(1, count + 1) / count
    steps = {int(np.argmin(np.abs(times[: last + 1] - time))) for time in wanted}
    return sorted(steps - {0})


def milliseconds(times_s: np.ndarray, span_s: float) -> list[str]:
    """Times in words, with enough digits to distinguish the drawn times of a run of ``span_s``."""
    apart = 1e3 * max(span_s, 1e-9) / DRAWN_TIMES
    return [f"{1e3 * time:.{max(0, -math.floor(math.log10(apart)))}f} ms" for time in times_s]
