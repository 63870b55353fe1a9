"""The budget of a search: a number of simulations, after which it ends with what it has, and a safety limit on the time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

SECONDS_PER_MINUTE = 60.0
# Held-out curves and next tests may be computed until this share of the limit on the time.
REPORT_TIME_SHARE = 1.1


class OutOfTimeError(Exception):  # no RunError, which would count as a model that cannot be computed
    """The limit on the time is reached, between two simulations or within one."""


@dataclass
class Budget:
    """How long a search may take. What is counted in simulations does not depend on the machine or its load.

    Parameters
    ----------
    simulations, minutes : None is no limit.

    Attributes
    ----------
    spent : simulations so far.
    watch : called after each of them, with its number in words.
    ended : which limit has ended the search, in words; "" where it goes on or was completed.
    """

    simulations: int | None = None
    minutes: float | None = None
    spent: int = 0
    watch: Callable[[str], object] = lambda words: None
    ended: str = ""
    _least: int = 0
    _time_share: float = 1.0
    _begin: float = field(default_factory=lambda: time.perf_counter())

    def spend(self) -> None:
        """Count a simulation."""
        self.spent += 1
        self.watch(f"simulation {self.spent}")

    def begin_fits(self) -> None:
        """Note that the baseline and the screening are done: fits may take as many simulations again, whatever the budget."""
        self._least = 2 * self.spent

    def begin_report(self) -> None:
        """Note that the search has ended, whether or not it has reached a limit."""
        self._time_share = REPORT_TIME_SHARE

    @property
    def capacity(self) -> float:
        """Number of simulations after which the search ends."""
        return float("inf") if self.simulations is None else max(self.simulations, self._least)

    def remaining_s(self) -> float | None:
        """Seconds until the limit on the time; None where there is none."""
        if self.minutes is None:
            return None
        return self._time_share * SECONDS_PER_MINUTE * self.minutes - (time.perf_counter() - self._begin)

    def is_late(self) -> bool:
        """Whether the limit on the time is reached."""
        left = self.remaining_s()
        return left is not None and left <= 0.0

    def check(self) -> None:
        """Raise :class:`OutOfTimeError` where the limit on the time is reached."""
        if self.is_late():
            raise OutOfTimeError(f"the limit of {self.minutes:g} minutes was reached")

    def reached(self) -> bool:
        """Whether the search has to end, which is noted in ``ended``."""
        if self.is_late():
            self.ended = f"the search reached its limit of {self.minutes:g} minutes, so that its result depends on the machine"
        elif self.spent >= self.capacity:
            self.ended = f"the search reached its budget of {self.capacity:g} simulations"
        return bool(self.ended)


NO_LIMIT = Budget()


class SearchLimits(NamedTuple):
    """Bounds on a search: largest number of added effects, budget, and number of processes (None: one per core)."""

    max_effects: int
    budget: Budget
    processes: int | None
