"""What fits would leave, by estimates with the errors that the fits of a comparison have shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from explicitfe.inverse.close_loop.compared import Entry, Key
from explicitfe.inverse.close_loop.statistics.signatures import EstimatedFit, Screening

# Initial relative errors of the change that an effect causes, by fast answers (True; 1 to 18 % were measured under a flat tool)
# and by signatures (False; up to 23 % in homogeneous tests). For sets of effects they count the less the more fits have shown
# their errors, the largest of which counts in full.
FIRST_ERROR_SHARE = {True: 0.1, False: 0.3}
POSSIBLE_GAINS = 33  # over which the posterior of a hypothesis that was not fitted is averaged


class Estimates:
    """Estimates of hypotheses by their keys, and how far they may be wrong.

    Parameters
    ----------
    rows : how many rows are fitted, which is the chi2 of noise.
    """

    def __init__(self, rows: int) -> None:
        self.known: dict[Key, EstimatedFit] = {}
        self._rows = rows
        self._errors: dict[bool, list[float]] = {True: [], False: []}

    def learn(self, key: Key, chi2: float) -> None:
        """Note what the fit of an estimated hypothesis has left."""
        one = self.known[key]
        self._errors[one.fast].append(one.error_of(chi2))

    def error_share(self, *, fast: bool, single: bool) -> float:
        """Relative error of estimates: the largest that fits have shown, or what is assumed before."""
        shown = self._errors[fast]
        return max([FIRST_ERROR_SHARE[fast] / (1.0 if single else 1.0 + len(shown)), *shown])

    def possible_gain(self, key: Key, screening: Screening) -> float:
        """Largest decrease of chi2 by a fit beyond its estimate."""
        one, single = self.known[key], len(key) == 1
        more = one.possible_gain(self.error_share(fast=one.fast, single=single), self._rows)
        return max(more, screening.bound - screening.gain if single else 0.0, 0.0)

    def average_over_gains(
        self, entry: Entry, screening: Screening, log_posterior: Callable[[Entry], float], most: float
    ) -> Entry:
        """A hypothesis that the limit of time left: its fit could have found any gain up to the largest possible one.

        Its posterior is the mean over these gains; the log of none is larger than ``most``.
        """
        gains = np.linspace(0.0, self.possible_gain(entry.key, screening), POSSIBLE_GAINS)
        possible = [replace(entry, evidence=entry.evidence.with_gain(gain)) for gain in gains]
        logs = [log_posterior(one) for one in possible]
        mean = float(logsumexp(np.minimum(logs, most)) - np.log(POSSIBLE_GAINS))
        return possible[-1].lowered(logs[-1] - mean)
