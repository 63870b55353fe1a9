"""The hypotheses of a comparison: what is known of each, and the numbers by which a search orders them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from explicitfe.inverse.close_loop.baseline import Watch
from explicitfe.inverse.close_loop.compared import Entry, Key, forms_by_cause, further_effects, needed_decrease, without_term
from explicitfe.inverse.close_loop.estimates import Estimates
from explicitfe.inverse.close_loop.evidence import Causes, Prior, cost_of_term, evidence_of
from explicitfe.inverse.close_loop.fast_fits import FastFits
from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.inverse.close_loop.statistics.covariance import Covariance
from explicitfe.inverse.close_loop.statistics.refit import BestFit, Slopes
from explicitfe.inverse.close_loop.statistics.signatures import Changes, Screening, Signature, signatures_beside
from explicitfe.inverse.close_loop.statistics.sketch import Sketch
from explicitfe.inverse.close_loop.statistics.system import Candidate, Hypothesis, System

SCREENING_PROGRESS = 0.2  # share of the search at which the candidates are screened


class Hypotheses:
    """The table of responses near the baseline, and fitted and screened hypotheses by the effects of their terms.

    Parameters
    ----------
    max_effects, limit, watch : as for :func:`explicitfe.inverse.close_loop.comparison.compare`.
    """

    def __init__(
        self, system: System, covariance: Covariance, fit: BestFit, max_effects: int, limit: Budget, watch: Watch
    ) -> None:
        self.system, self.covariance, self.watch = system, covariance, watch
        self.max_effects, self.limit = max_effects, limit
        self.ended = ""  # which limit has ended the search, in words
        self.waiting: list[Entry] = []  # hypotheses that could matter and are not fitted yet
        self.left: list[Key] = []  # those of them when the limit was reached
        self.failed: dict[Key, str] = {}
        self.screened: dict[Key, tuple[Entry, Screening]] = {}
        watch("screening of the candidates", SCREENING_PROGRESS)
        self.library = system.candidates(fit.model)
        self.cause_of = {c.effect: c.cause for c in self.library}
        self.slow = {c.effect for c in self.library if c.slow}
        tested = [c for c in self.library if not c.reason and max_effects]
        meshed = [c for c in tested if system.costly(fit.model.plus(c.term, c.trials[0]))]
        changes = zip(meshed, system.changes(fit.model, meshed), strict=True)
        self.table: dict[str, tuple[Candidate, Changes]] = {c.effect: (c, d) for c, d in changes}
        self.sketch = Sketch(system, fit) if system.costly(fit.model) else None
        self.fast = None if self.sketch is None else FastFits(system, self.sketch, self.table, covariance)
        self.fast_fits: dict[Key, Entry] = {}
        self.estimates = Estimates(self._near, sum(len(one.measured) for one in system.series))
        self.near: dict[Key, dict[str, Signature]] = {}
        self.at_baseline = self._signatures(fit, covariance, tested)
        causes = {one.candidate.cause for one in self.at_baseline}
        self.prior = Prior(len(causes), forms_by_cause(self.library))
        self.visible = {one.candidate.effect for one in self.at_baseline if self._is_visible(one)}
        causes = {one.candidate.cause for one in self.at_baseline if one.candidate.effect in self.visible}
        self.prior = replace(self.prior, causes=len(causes))
        self.fitted: dict[Key, Entry] = {(): self._entry(fit, system, covariance)}
        limit.begin_fits()

    def _near(self, fitted: Entry) -> dict[str, Signature]:
        """Effect -> signature beside a fitted hypothesis."""
        if fitted.key not in self.near:
            assert fitted.fit is not None and fitted.covariance is not None and fitted.system is not None
            costly = self.system.costly(fitted.model)
            usable = self.visible & set(self.table) if costly else self.visible
            candidates = [c for c in fitted.system.candidates(fitted.model) if not c.reason and c.effect in usable]
            known = self._signatures(fitted.fit, fitted.covariance, candidates)
            self.near[fitted.key] = {one.candidate.effect: one for one in known if one.values}
        return self.near[fitted.key]

    def _is_fast(self, model: Hypothesis) -> bool:
        """Whether a model takes no more time than others: no slow effect, and no mesh where the baseline needs none."""
        mesh = self.system.costly(model) and not self.system.costly(self.fitted[()].model)
        return not mesh and self.slow.isdisjoint(model.effects)

    def _fast_slopes(self, model: Hypothesis) -> Slopes | None:
        """Derivatives by fast answers, where those of the simulator are rough."""
        return None if self.sketch is None or self.sketch.system.exact(model) else self.sketch.slopes

    def _entry(self, fit: BestFit, system: System, covariance: Covariance, *, with_forms: bool = False) -> Entry:
        """A fitted hypothesis with its evidence."""
        key = tuple(sorted(term.effect for term in fit.model.terms))
        covariance = covariance.at(fit.answer)
        causes = frozenset(self.cause_of[name] for name in key)
        cost = sum(self._cost(term.effect, len(term.parameters)) for term in fit.model.terms)
        forms = self._other_forms(fit, covariance, causes, system) if causes and with_forms else None
        evidence = evidence_of(fit, covariance, cost, forms)
        return Entry(key, causes, evidence, fit.model, fit, system, covariance)

    def _other_forms(self, fit: BestFit, covariance: Covariance, causes: Causes, system: System) -> np.ndarray | None:
        """Whitened changes (n, m) of the answer by other forms of the causes that are there; None where there are none.

        They are taken near the model without these causes; where an answer takes the run of a mesh, near the baseline.
        """
        columns = []
        for cause in (cause for cause in causes if self.prior.forms.get(cause, 1) > 1):
            bare = fit.model
            for name in [term.effect for term in fit.model.terms]:
                if system.costly(fit.model) or self.cause_of[name] == cause:
                    bare = without_term(bare, name)
            forms = [c for c in system.candidates(bare) if not c.reason and c.cause == cause]
            columns += [one.secants for one in self._signatures(fit, covariance, forms, bare) if one.values]
        return np.concatenate(columns, axis=1) if columns else None

    def _signatures(
        self, fit: BestFit, covariance: Covariance, candidates: Sequence[Candidate], model: Hypothesis | None = None
    ) -> list[Signature]:
        return signatures_beside(self.system, self.table, fit, covariance, candidates, model)

    # ---- numbers ----

    def _cost(self, effect: str, parameters: int) -> float:
        """Cost of the parameters of a term."""
        visible = max((one.visible for one in self.at_baseline if one.candidate.effect == effect), default=0.0)
        return cost_of_term(parameters, self.covariance.effective, visible)

    def _cost_beyond(self, subset: Entry, key: Key) -> float:
        """Cost of the parameters of the terms that a subset lacks."""
        terms = {c.effect: len(c.term.parameters) for c in self.library}
        return sum(self._cost(name, terms[name]) for name in further_effects(key, subset.key))

    def _log_posterior(self, entry: Entry) -> float:
        return entry.evidence.best + self.prior.log(entry.causes)

    def _closeness(self, entry: Entry) -> float:
        """Log posterior if the residual is noise: it orders the search, because a smooth residual may be large at little cost."""
        return entry.evidence.closed + self.prior.log(entry.causes)

    def _is_visible(self, one: Signature) -> bool:
        """Whether the largest plausible strength could make a cause as probable as a verdict asks for."""
        forms = self.prior.forms.get(one.candidate.cause, 1)
        needed = needed_decrease(self.covariance, self.prior.causes, forms, one)
        return bool(one.values) and one.visible > needed
