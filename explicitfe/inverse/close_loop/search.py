"""The comparison of hypotheses: sets of causes are screened, fitted and weighed by their evidence; from a system to an outcome.

Every single effect and every pair is screened from signatures; larger sets are built from the smaller ones that are nearest to
the data. On a mesh fits are estimated further with fast answers. A hypothesis that could matter, by the errors that estimates
have shown, is fitted with the simulator, and again from its fitted subsets if it ends worse than one of them. A set that was not
fitted keeps the evidence of its estimate, or, where a limit left it, the mean evidence of all that its fit could find.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.special import expit, logsumexp

from explicitfe.inverse.close_loop.baseline import Watch, fit_of, with_own_numerics
from explicitfe.inverse.close_loop.compared import (
    ComparedCauses,
    Entry,
    Key,
    forms_by_cause,
    further_effects,
    needed_decrease,
    not_testable,
    without_term,
)
from explicitfe.inverse.close_loop.estimates import Estimates
from explicitfe.inverse.close_loop.evidence import Causes, Prior, cost_of_term, evidence_of, log_odds_of_other, posterior_of
from explicitfe.inverse.close_loop.fast_fits import FastFits
from explicitfe.inverse.close_loop.statistics.budget import Budget, OutOfTimeError
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, outside
from explicitfe.inverse.close_loop.statistics.refit import BestFit, Slopes
from explicitfe.inverse.close_loop.statistics.signatures import EstimatedFit, Screening, Signature, screen, signatures_beside
from explicitfe.inverse.close_loop.statistics.sketch import Sketch
from explicitfe.inverse.close_loop.statistics.system import Candidate, Hypothesis, System
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.platform.errors import RunError

FURTHER_TERMS = 2  # A cause may use several terms: two more in a set than it has causes.
MOST_PARENTS = 6  # Hypotheses from which larger ones are built.
SCREENING_PROGRESS, FITS_PROGRESS, FINISH_PROGRESS = 0.2, 0.4, 0.9  # Shares of the search at which its stages begin.
# The largest number of hypotheses with one, two and more terms that are fitted, a bound on the time.
MOST_FITS, MOST_FITS_ON_A_MESH = {1: 60, 2: 24, 3: 12}, {1: 16, 2: 4, 3: 2}
MOST_FITS_BESIDE_FAST_ANSWERS = {1: 6, 2: 8, 3: 6}  # the simulator confirms the best of the estimated hypotheses


class Comparing:
    """One comparison: the table of responses near the baseline, and the hypotheses by the effects of their terms.

    Parameters
    ----------
    max_effects, limit, watch : as for :func:`explicitfe.inverse.close_loop.comparison.compare`.
    """

    def __init__(
        self, system: System, covariance: Covariance, fit: BestFit, max_effects: int, limit: Budget, watch: Watch
    ) -> None:
        self.system, self.covariance, self.watch = system, covariance, watch
        self.max_effects, self.limit = max_effects, limit
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
        self.table = {c.effect: (c, d) for c, d in changes}
        self.sketch = Sketch(system, fit) if system.costly(fit.model) else None
        self.fast = None if self.sketch is None else FastFits(system, self.sketch, self.table, covariance)
        self.fast_fits: dict[Key, Entry] = {}
        self.estimates = Estimates(sum(len(one.measured) for one in system.series))
        self.at_baseline = self._signatures(fit, covariance, tested)
        causes = {one.candidate.cause for one in self.at_baseline}
        self.prior = Prior(len(causes), forms_by_cause(self.library))
        self.visible = {one.candidate.effect for one in self.at_baseline if self._is_visible(one)}
        causes = {one.candidate.cause for one in self.at_baseline if one.candidate.effect in self.visible}
        self.prior = replace(self.prior, causes=len(causes))
        self.fitted: dict[Key, Entry] = {(): self._entry(fit, system, covariance)}
        limit.begin_fits()

    # ---- the comparison ----

    def run(self) -> ComparedCauses:
        """Fit what matters, then exchange terms of the best hypothesis until it stays; or until a limit is reached."""
        try:
            self._fit_levels()
            self._exchange()
        except OutOfTimeError:
            self.limit.reached()
            self.left += [one.key for one in self.waiting if one.key not in self.fitted and one.key not in self.failed]
        self.limit.begin_report()
        self._finish()
        return self._comparison()

    def _fit_levels(self) -> None:
        """Fit what matters, level by level: hypotheses with one term, two and more."""
        parents = [self.fitted[()]]
        for terms in range(1, self.max_effects + FURTHER_TERMS + 1) if self.max_effects else ():
            for parent in parents:
                self._screen_children(parent)
            if terms == 2:
                self._screen_children(self.fitted[()], pairs=True)  # with what the fits of the single effects have shown
            if not self._fit_plausible(terms):
                break
            level = [one for one in (self.fast_fits | self.fitted).values() if len(one.key) == terms]
            parents = [one for one in sorted(level, key=self._closeness, reverse=True) if one.has_all_terms][:MOST_PARENTS]
            if parents and len(parents[0].causes) < self.max_effects:
                parents += [one for one in self._in_other_forms(parents[0]) if one not in parents]

    def _in_other_forms(self, best: Entry) -> list[Entry]:
        """Fits of a hypothesis with each term in turn in the other forms of its cause.

        A further cause may show beside one form alone: a load that acts late, where the load hangs and is not fixed to the body.
        """
        fits = []
        for name in best.key:
            for form in (one for one, cause in self.cause_of.items() if cause == self.cause_of[name] and one not in best.key):
                key = tuple(sorted((*(k for k in best.key if k != name), form)))
                if key in self.screened and key not in self.fitted and key not in self.failed and not self.limit.reached():
                    self._fit(key, self.screened[key][0].model)
                fits += [self.fitted[key]] if key in self.fitted else []
        return fits

    def _exchange(self) -> None:
        """Drop each term of the best hypothesis and replace it by others, as long as another becomes the best."""
        for _ in range(FURTHER_TERMS):
            if self.limit.reached():
                return
            best = max(self.fitted.values(), key=self._log_posterior)
            for k in range(len(best.key)):
                smaller = best.key[:k] + best.key[k + 1 :]
                if smaller not in self.fitted and smaller not in self.failed:
                    self._fit(smaller, without_term(best.model, best.key[k]))
                if smaller in self.fitted:
                    self._screen_children(self.fitted[smaller])
            self._fit_plausible(None)
            if max(self.fitted.values(), key=self._log_posterior) is best:
                return

    def _screen_children(self, parent: Entry, *, pairs: bool = False) -> None:
        """Screen the parent with one further term, or with each pair of further terms."""
        assert parent.fit is not None and parent.covariance is not None and parent.system is not None
        candidates = [c for c in parent.system.candidates(parent.model) if not c.reason and c.effect in self._allowed(parent)]
        if parent.key and parent.key not in self.fitted:
            candidates = [c for c in candidates if c.effect in self.table]
        if not candidates:
            return
        known = self._signatures(parent.fit, parent.covariance, candidates) if parent.key else self.at_baseline
        tested = [one for one in known if one.values and one.candidate.effect in self._allowed(parent)]
        residual = outside(parent.fit.movable, parent.fit.residual)
        groups: list[tuple[Signature, ...]] = [(one,) for one in tested]
        if pairs:
            # A slow effect is tried beside others that were fitted, but not in pairs of which neither effect is known to help.
            fast = [one for one in tested if self._is_fast(parent.model.plus(one.candidate.term, one.values[0]))]
            groups = [pair for pair in combinations(fast, 2) if pair[0].candidate.cause != pair[1].candidate.cause]
        for group in groups:
            if len({*parent.causes, *(one.candidate.cause for one in group)}) > self.max_effects:
                continue
            self._screen(parent, group, residual)

    def _allowed(self, parent: Entry) -> set[str]:
        """Effects that may be added: those that the data can show, and further terms of a cause that is there."""
        return self.visible | {c.effect for c in self.library if c.cause in parent.causes}

    def _screen(self, parent: Entry, group: Sequence[Signature], residual: np.ndarray) -> None:
        """Keep the screening of a hypothesis if it is better than that from another parent."""
        key = tuple(sorted((*parent.key, *(one.candidate.effect for one in group))))
        if key in self.fitted or key in self.failed:
            return
        screening = screen(residual, group)
        model = parent.model
        for one, values in zip(group, screening.starts, strict=True):
            model = model.plus(one.candidate.term, values)
        assert parent.covariance is not None
        cost = sum(self._cost(one.candidate.effect, len(one.candidate.term.parameters)) for one in group)
        evidence = replace(parent.evidence, closed=parent.evidence.closed - cost).with_gain(screening.gain)
        causes = parent.causes | {one.candidate.cause for one in group}
        entry = Entry(key, causes, evidence, model, bound=screening.bound, parent=parent.key)
        before = self.screened.get(key)
        # What is estimated near a fitted model with more of the terms is more certain.
        fitted_terms = len(parent.key) if parent.key in self.fitted and key not in self.fast_fits else 0
        known_terms = 0 if before is None or before[0].parent not in self.fitted else len(before[0].parent)
        if before is None or (fitted_terms, evidence.closed) > (known_terms, before[0].evidence.closed):
            self.screened[key] = entry, screening
            assert parent.fit is not None
            self.estimates.known[key] = EstimatedFit(max(parent.fit.whitened - screening.gain, 0.0), screening.change, fast=False)

    def _fit_plausible(self, terms: int | None) -> int:
        """Fit the screened hypotheses that may matter, the most probable first; the number of those that were fitted."""
        costly = self.system.costly(self.fitted[()].model)
        on_a_mesh = MOST_FITS_BESIDE_FAST_ANSWERS if self.system.fast_everywhere else MOST_FITS_ON_A_MESH
        most = (on_a_mesh if costly else MOST_FITS)[min(terms or 3, 3)]
        count = 0
        if self.fast is not None and terms == 1:
            for entry, _ in [one for key, one in self.screened.items() if len(key) == 1 and self.fast.is_possible(key)]:
                self._fit_fast(entry, self.fast)
        while True:
            best = max(map(self._log_posterior, self.fitted.values()))
            self.waiting = waiting = [
                entry
                for key, (entry, screening) in self.screened.items()
                if key not in self.fitted and key not in self.failed and (terms is None or len(key) <= terms + 1)
                if self._could_matter(entry, screening, best, terms)
            ]
            if not waiting or count >= most:
                return count
            if self.limit.reached():
                self.left += [one.key for one in waiting]
                return 0
            # Fast ones and fewer terms first: what they explain, others need not.
            entry = max(waiting, key=lambda one: (self._is_fast(one.model), -len(one.key), self._closeness(one)))
            if self.fast is not None and self._is_fast_fit_due(entry.key):
                self._fit_fast(entry, self.fast)
                continue
            self._show_open_mass(waiting, terms)
            self._fit(entry.key, entry.model)
            done = self.fitted.get(entry.key)
            if done is not None and done.fit is not None:
                self.estimates.learn(entry.key, done.fit.whitened)
            count += 1

    def _show_open_mass(self, waiting: Sequence[Entry], terms: int | None) -> None:
        """Show the probability of the hypotheses to be fitted, by their estimates; further levels take as long as one before."""
        fitted, others = (logsumexp([self._log_posterior(one) for one in own]) for own in (self.fitted.values(), waiting))
        mass = float(expit(others - fitted))
        left = min(
            0.5 ** (terms or self.max_effects + FURTHER_TERMS) * (1.0 + mass), 1.0 - self.limit.spent / self.limit.capacity
        )
        share = FINISH_PROGRESS - (FINISH_PROGRESS - FITS_PROGRESS) * max(left, 0.0)
        self.watch(f"fit {len(self.fitted)}, {len(waiting)} hypotheses with {100.0 * mass:.0f} % of the probability open", share)

    def _fit_fast(self, entry: Entry, fast: FastFits) -> None:
        """Fit a hypothesis with fast answers, from which the fit with the simulator starts if it could still matter."""
        done = fast.fit(entry, self._nearest_subset(entry.key))
        if done is None:
            return
        fit, self.estimates.known[entry.key] = done
        one = self._entry(fit, self.system, self.covariance)
        self.fast_fits[entry.key] = one
        screening = self.screened[entry.key][1]
        gain = screening.gain + entry.evidence.chi2 - one.evidence.chi2
        entry = Entry(entry.key, entry.causes, one.evidence, fit.model, bound=gain, parent=entry.parent)
        self.screened[entry.key] = entry, replace(screening, gain=gain, bound=gain)

    def _is_fast_fit_due(self, key: Key) -> bool:
        """Whether all effects have fast answers that have not been used, or could be used beside a nearer fitted hypothesis."""
        return self.fast is not None and self.fast.is_possible(key) and self.fast.is_due(key, self._nearest_subset(key))

    def _nearest_subset(self, key: Key) -> Entry:
        """The fitted hypothesis with one term less that is nearest to the data; the baseline where there is none."""
        subsets = [one for one in self._subsets(key) if one.has_all_terms]
        return max(subsets, key=self._closeness, default=self.fitted[()])

    def _subsets(self, key: Key) -> list[Entry]:
        """Fitted hypotheses with one term less."""
        return [one for k in range(len(key)) if (one := self.fitted.get(key[:k] + key[k + 1 :])) is not None]

    def _could_matter(self, entry: Entry, screening: Screening, best: float, terms: int | None) -> bool:
        """Whether a fit could change the probabilities: with the largest gain that estimates allow it comes near the best.

        Where the best leaves more than noise, it is enough to come nearer to the data than any other. Elsewhere slow effects are
        fitted only if their estimate is probable. Without a mesh, single effects are fitted until one explains all.
        """
        top = max(self.fitted.values(), key=self._log_posterior)
        explained = top.evidence.other + log_odds_of_other() <= 0.0
        single = terms == 1 and len(entry.key) == 1 and not self.system.costly(entry.model)
        unknown = self.system.fast_everywhere and self._is_fast_fit_due(entry.key)
        if unknown or (single and (not explained or entry.causes == top.causes)):
            return True
        negligible = best + np.log(THRESHOLDS.negligible_probability)
        if explained and not self._is_fast(entry.model) and self._log_posterior(entry) <= negligible:
            return False
        prior = self.prior.log(entry.causes)
        evidence = entry.evidence.with_gain(self.estimates.possible_gain(entry.key, screening))
        least = np.inf if explained else max(map(self._closeness, self.fitted.values()))
        return evidence.closed + prior > least or evidence.best + prior > negligible

    def _is_fast(self, model: Hypothesis) -> bool:
        """Whether a model takes no more time than others: no slow effect, and no mesh where the baseline needs none."""
        mesh = self.system.costly(model) and not self.system.costly(self.fitted[()].model)
        return not mesh and self.slow.isdisjoint(model.effects)

    def _fit(self, key: Key, start: Hypothesis) -> None:
        """Fit a hypothesis from its screening and, where it ends worse than a subset, from that subset."""
        system, covariance = self.fitted[()].system, self.covariance
        assert system is not None
        subsets = self._subsets(key)
        fits: list[BestFit] = []
        reasons: list[str] = []

        def search_from(start: Hypothesis) -> None:
            try:
                fits.append(fit_of(system, start, covariance, self._fast_slopes(start)))
            except RunError as error:
                reasons.append(str(error))

        search_from(start)
        least = min((one.fit for one in subsets if one.fit is not None), key=lambda f: f.whitened, default=None)
        if least is not None and fits and fits[0].whitened > least.whitened and self._fast_slopes(fits[0].model) is not None:
            # Without strength the further term leaves what the subset leaves; another search would take as many runs again.
            subset = max((one for one in subsets if one.fit is least), key=self._log_posterior)
            causes = frozenset(self.cause_of[name] for name in key)
            self.fitted[key] = replace(subset, key=key, causes=causes).lowered(self._cost_beyond(subset, key))
            return
        if least is not None and (not fits or fits[0].whitened > least.whitened):
            for one in sorted(subsets, key=lambda one: one.evidence.closed, reverse=True):
                if (started := self._from_subset(one, key)) is not None:
                    search_from(started)
        if fits:
            self.fitted[key] = self._entry(min(fits, key=lambda fit: fit.whitened), system, covariance)
        else:
            self.failed[key] = reasons[0]

    def _fast_slopes(self, model: Hypothesis) -> Slopes | None:
        """Derivatives by fast answers, where those of the simulator are rough."""
        return None if self.sketch is None or self.sketch.system.exact(model) else self.sketch.slopes

    def _from_subset(self, subset: Entry, key: Key) -> Hypothesis | None:
        """The subset at its best, with the term that it lacks at the start of its best trial."""
        assert subset.fit is not None and subset.covariance is not None and subset.system is not None
        (name,) = further_effects(key, subset.key)
        candidates = [c for c in subset.system.candidates(subset.model) if not c.reason and c.effect == name]
        own = self._signatures(subset.fit, subset.covariance, candidates) if candidates else []
        if not own or not own[0].values:
            return None
        start = screen(outside(subset.fit.movable, subset.fit.residual), own).starts[0]
        return subset.model.plus(candidates[0].term, start)

    def _entry(self, fit: BestFit, system: System, covariance: Covariance, *, with_forms: bool = False) -> Entry:
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

    def _finish(self) -> None:
        """Weigh the probable hypotheses against model-form errors, each with the numerical error of its own model."""
        entries = sorted(self.fitted.values(), key=self._log_posterior, reverse=True)
        finished: list[Entry] = []
        best = self._log_posterior(entries[0])
        for entry in entries:
            if self._log_posterior(entry) < best + np.log(THRESHOLDS.negligible_probability):
                break
            if finished and (self.limit.ended or self.limit.is_late()):
                break
            assert entry.fit is not None and entry.system is not None and entry.covariance is not None
            system, fit, covariance = entry.system, entry.fit, entry.covariance
            try:
                if system.costly(entry.model) and entry.key:
                    self.watch(f"numerical error with {' + '.join(entry.key)}", FINISH_PROGRESS)
                    slopes = self._fast_slopes(fit.model)
                    with suppress(OutOfTimeError):  # else with the numerical error of the baseline
                        system, covariance, fit = with_own_numerics(system, covariance, fit, slopes)
                self.fitted[entry.key] = self._entry(fit, system, covariance, with_forms=True)
                finished.append(self.fitted[entry.key])
            except OutOfTimeError:
                break
            except RunError as error:
                self.failed[entry.key] = str(error)
        if self.sketch is not None:
            # What was screened beside a model with another numerical error is screened again.
            before = self.screened
            self.screened = {key: one for key, one in before.items() if one[0].parent not in {e.key for e in finished}}
            try:
                for entry in finished:
                    self._screen_children(entry)
                    if not entry.key:
                        self._screen_children(entry, pairs=True)
            except OutOfTimeError:
                self.screened = before | self.screened

    # ---- numbers ----

    def _cost(self, effect: str, parameters: int) -> float:
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

    def _comparison(self) -> ComparedCauses:
        best = max(map(self._log_posterior, self.fitted.values()))  # no estimate is more probable than it
        unfitted = {key: one for key, one in self.screened.items() if key not in self.fitted}
        average = self.estimates.average_over_gains
        estimated = [average(*one, self._log_posterior, best) if key in self.left else one[0] for key, one in unfitted.items()]
        entries = [*self.fitted.values(), *(one.lowered(self._log_posterior(one) - best) for one in estimated)]
        posterior = posterior_of([(one.causes, one.evidence) for one in entries], self.prior)
        entries.sort(key=self._log_posterior, reverse=True)
        reasons = not_testable(self.library, [one for one in self.at_baseline if one.candidate.effect not in self.visible])
        compared = ComparedCauses(self.fitted[()], entries, self.prior, posterior, self.at_baseline, reasons, self.failed)
        return replace(compared, cause_of=self.cause_of, left=self.left, ended=self.limit.ended)
