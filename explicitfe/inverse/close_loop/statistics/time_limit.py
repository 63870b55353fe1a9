"""The time after which a search ends with what it has."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import NamedTuple

SECONDS_PER_MINUTE = 60.0


@dataclass
class TimeLimit:
    """A limit on the time of a search, counted from its creation.

    Parameters
    ----------
    minutes : None is no limit.
    """

    minutes: float | None = None
    _begin: float = field(default_factory=time.perf_counter)
    _least_s: float = 0.0

    def begin_fits(self) -> None:
        """Note that the baseline and the screening are done: fits may take as long again, whatever the limit."""
        self._least_s = 2.0 * (time.perf_counter() - self._begin)

    def reached(self) -> bool:
        """Whether the search has to end."""
        if self.minutes is None:
            return False
        return time.perf_counter() - self._begin > max(SECONDS_PER_MINUTE * self.minutes, self._least_s)


NO_LIMIT = TimeLimit()


class SearchLimits(NamedTuple):
    """Bounds on a search: largest number of added effects, time, and number of processes (None: one per core)."""

    max_effects: int
    time: TimeLimit
    processes: int | None
