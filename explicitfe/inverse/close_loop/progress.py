"""Progress of a search: it counts simulations, never decreases, and is 1 only at the end."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from explicitfe.inverse.close_loop.statistics.budget import Budget, OutOfTimeError
from explicitfe.platform.errors import Progress, Share, Stage

RUNS_OF_A_STEP = 20.0  # simulations of each test in one step


class SearchProgress:
    """The progress of one search, which a budget tells of each simulation.

    Parameters
    ----------
    usual_runs : simulations of one step.
    """

    def __init__(self, progress: Progress, budget: Budget, usual_runs: float = RUNS_OF_A_STEP) -> None:
        self._progress, self._budget, self._usual_runs = progress, budget, usual_runs
        self._stage: Stage = "trace"
        self._shown: dict[Stage, float] = {}
        self._words, self._share, self._until, self._begun = "", 0.0, 0.0, 0
        budget.watch = self._after_a_run

    def step(self, words: str, share: float) -> None:
        """Begin a step of the search at a share of it; the simulations of the step lead towards the next one."""
        self.enter("trace", share, min(share + 0.1, 0.5 * (1.0 + share)), words)

    def enter(self, stage: Stage, share: float, until: float = 1.0, words: str = "") -> None:
        """Note that a stage has come to a share, from which simulations lead towards ``until``."""
        self._stage, self._share, self._until, self._words, self._begun = stage, share, until, words, self._budget.spent
        self._show(share, words)

    def _after_a_run(self, words: str) -> None:
        """Advance the share, but not to the end of the step: the number of simulations is not known in advance."""
        done = -np.expm1(-(self._budget.spent - self._begun) / self._usual_runs)
        self._show(self._share + (self._until - self._share) * float(done), ", ".join(filter(None, (self._words, words))))

    def _show(self, share: float, words: str) -> None:
        self._shown[self._stage] = max(self._shown.get(self._stage, 0.0), share)
        with suppress(OutOfTimeError):  # the next simulation is not begun
            self._progress(self._stage, Share(self._shown[self._stage], words))
