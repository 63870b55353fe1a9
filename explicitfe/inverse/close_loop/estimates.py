"""What fits would leave, by estimates with the errors that the fits of a comparison have shown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from explicitfe.inverse.close_loop.compared import Entry, Key
from explicitfe.inverse.close_loop.statistics.budget import OutOfTimeError
from explicitfe.inverse.close_loop.statistics.covariance import outside
from explicitfe.inverse.close_loop.statistics.signatures import EstimatedFit, Screening, Signature, screen

# Initial relative errors of the change that an effect causes, by fast answers (True; 1 to 18 % were measured under a flat tool)
# and by signatures (False; up to 23 % in homogeneous tests). For sets of effects they count the less the more fits have shown
# their errors, the largest of which counts in full.
FIRST_ERROR_SHARE = {True: 0.1, False: 0.3}
POSSIBLE_GAINS = 33  # over which the posterior of a hypothesis that was not fitted is averaged
NOTHING_FURTHER = Screening(0.0, 0.0, 0.0, ())


class Estimates:
    """Estimates of hypotheses by their keys, and how far they may be wrong.

    Parameters
    ----------
    near : gives the signatures of effects beside a fitted hypothesis.
    rows : how many rows are fitted, which is the chi2 of noise.
    """

    def __init__(self, near: Callable[[Entry], Mapping[str, Signature]], rows: int) -> None:
        self.known: dict[Key, EstimatedFit] = {}
        self._near, self._rows = near, rows
        self._errors: dict[bool, list[float]] = {True: [], False: []}
        self._beside: dict[tuple[Key, Key], EstimatedFit | None] = {}

    def learn(self, key: Key, chi2: float) -> None:
        """Note what the fit of an estimated hypothesis has left."""
        one = self.known[key]
        self._errors[one.fast].append(one.error_of(chi2))

    def error_share(self, *, fast: bool, single: bool) -> float:
        """Relative error of estimates: the largest that fits have shown, or what is assumed before."""
        shown = self._errors[fast]
        return max([FIRST_ERROR_SHARE[fast] / (1.0 if single else 1.0 + len(shown)), *shown])

    def possible_gain(self, key: Key, screening: Screening, nearest: Entry) -> float:
        """Largest decrease of chi2 by a fit beyond its estimate.

        No model leaves less than the same model with further terms: what a hypothesis could explain beside the terms of the
        ``nearest`` fitted one bounds it too.
        """
        one, single = self.known[key], len(key) == 1
        more = one.possible_gain(self.error_share(fast=one.fast, single=single), self._rows)
        if single:
            more = max(more, screening.bound - screening.gain)
        union = self._of_union(nearest, key)
        if union is not None:
            # The way there may be as long as that of the hypothesis alone.
            union = union._replace(change=max(union.change, one.change))
            share = self.error_share(fast=False, single=single)
            more = min(more, one.chi2 - union.chi2 + union.possible_gain(share, self._rows))
        return max(more, 0.0)

    def average_over_gains(
        self, entry: Entry, screening: Screening, nearest: Entry, log_posterior: Callable[[Entry], float], most: float
    ) -> Entry:
        """A hypothesis that the limit of time left: its fit could have found any gain up to the largest possible one.

        Its posterior is the mean over these gains; the log of none is larger than ``most``.
        """
        gains = np.linspace(0.0, self.possible_gain(entry.key, screening, nearest), POSSIBLE_GAINS)
        possible = [replace(entry, evidence=entry.evidence.with_gain(gain)) for gain in gains]
        logs = [log_posterior(one) for one in possible]
        mean = float(logsumexp(np.minimum(logs, most)) - np.log(POSSIBLE_GAINS))
        return possible[-1].lowered(logs[-1] - mean)

    def _of_union(self, fitted: Entry, key: Key) -> EstimatedFit | None:
        """Estimated fit with the terms of both a fitted hypothesis and a key; None if a term has no signature near the former."""
        if (fitted.key, key) not in self._beside:
            estimate = None
            lacking = list((Counter(key) - Counter(fitted.key)).elements())
            near: Mapping[str, Signature] = {}
            with suppress(OutOfTimeError):  # without signatures more is possible
                near = self._near(fitted)
            if fitted.fit is not None and all(name in near for name in lacking):
                residual = outside(fitted.fit.movable, fitted.fit.residual)
                screening = screen(residual, [near[name] for name in lacking]) if lacking else NOTHING_FURTHER
                estimate = EstimatedFit(max(fitted.fit.whitened - screening.bound, 0.0), screening.change, fast=False)
            self._beside[fitted.key, key] = estimate
        return self._beside[fitted.key, key]
