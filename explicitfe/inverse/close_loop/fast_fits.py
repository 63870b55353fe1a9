"""Fits of hypotheses with fast answers: near the baseline, or beside a fitted hypothesis where fast answers are exact."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from explicitfe.inverse.close_loop.baseline import FitsByMapping
from explicitfe.inverse.close_loop.compared import Entry, Key, further_effects
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, outside
from explicitfe.inverse.close_loop.statistics.refit import BestFit, refit
from explicitfe.inverse.close_loop.statistics.signatures import Changes, EstimatedFit, scaled_trial
from explicitfe.inverse.close_loop.statistics.sketch import Sketch, change_by_terms
from explicitfe.inverse.close_loop.statistics.system import Answering, Candidate, Hypothesis, System
from explicitfe.platform.errors import RunError

# Share of a trial with which a fit beside a fitted hypothesis begins.
WEAK_TRIAL_SHARE = 0.1


class FastFits:
    """Fits with fast answers, and where each was made.

    Parameters
    ----------
    table : effect -> its candidate, and what its trials change.
    """

    def __init__(
        self, system: System, sketch: Sketch, table: Mapping[str, tuple[Candidate, Changes]], covariance: Covariance
    ) -> None:
        self.system, self.sketch, self.table, self.covariance = system, sketch, table, covariance
        self._beside: dict[Key, Key] = {}  # hypothesis -> the fitted one beside which it was fitted
        self._exact: dict[Key, Answering | None] = {}  # fast answers that are exact at a fitted hypothesis

    def is_possible(self, key: Key) -> bool:
        """Whether all effects have fast answers."""
        return all(self.system.has_sketch(name) for name in key)

    def is_due(self, key: Key, nearest: Entry) -> bool:
        """Whether a hypothesis has no fast fit, or none beside the fitted one that is nearest to it."""
        return self._beside.get(key) != nearest.key

    def fit(self, entry: Entry, nearest: Entry) -> tuple[BestFit, EstimatedFit] | None:
        """The fit of a hypothesis beside the nearest fitted one, and what it says of a fit with the simulator; None if there is
        no model where it begins.
        """
        self._beside[entry.key] = nearest.key
        beside = self._exact_at(nearest)
        try:
            if beside is None:
                trials = {name: candidate.trials for name, (candidate, _) in self.table.items()}
                fit = refit(self.sketch, self.sketch.best_start(entry.model, trials, self.covariance), self.covariance)
            else:
                fits = [refit(beside, start, self.covariance) for start in self._starts(nearest, entry)]
                fit = min(fits, key=lambda one: one.whitened)
        except RunError:
            return None
        assert nearest.fit is not None
        change = change_by_terms(beside or self.sketch, fit.model, nearest.model if beside is not None else None)
        size = float(np.linalg.norm(outside(nearest.fit.movable, self.covariance.whiten(change))))
        return fit, EstimatedFit(fit.whitened, size, fast=True)

    def _exact_at(self, fitted: Entry) -> Answering | None:
        """Fast answers that are exact at a fitted hypothesis with effects; None where there are none."""
        if fitted.key not in self._exact:
            self._exact[fitted.key] = None
            if fitted.key and fitted.fit is not None and isinstance(self.system, FitsByMapping):
                self._exact[fitted.key] = self.system.beside(fitted.fit)
        return self._exact[fitted.key]

    def _starts(self, subset: Entry, entry: Entry) -> list[Hypothesis]:
        """A fitted subset with a weak further term, for each of its trials; and the parameters that were estimated before."""
        (name,) = further_effects(entry.key, subset.key)
        candidate, _ = self.table[name]
        trials = candidate.trials
        starts = [subset.model.plus(candidate.term, scaled_trial(candidate, v, WEAK_TRIAL_SHARE)) for v in trials]
        return [*starts, starts[0].with_values_of(entry.model)]
