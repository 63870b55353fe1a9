"""The comparison of sets of causes, on a linear system whose answers are given columns."""

from __future__ import annotations

import sys
from dataclasses import fields, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm
from synthetic import BOTH_WAYS, Linear, Planted, compared, elastic, programme, white

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.compared import ComparedCauses
from explicitfe.inverse.close_loop.comparison import compare
from explicitfe.inverse.close_loop.evidence import (
    Evidence,
    Posterior,
    Prior,
    cost_of_term,
    log_discrepancy,
    log_larger_noise,
    log_prior_of_strengths,
    posterior_of,
)
from explicitfe.inverse.close_loop.progress import SearchProgress
from explicitfe.inverse.close_loop.report import limit_warning
from explicitfe.inverse.close_loop.search import Comparing
from explicitfe.inverse.close_loop.statistics.budget import Budget, OutOfTimeError
from explicitfe.inverse.close_loop.statistics.covariance import measured_rows
from explicitfe.inverse.close_loop.statistics.lack_of_fit import LackOfFit
from explicitfe.inverse.close_loop.statistics.refit import BestFit, refit
from explicitfe.inverse.close_loop.statistics.signatures import NOISE_SDS, EstimatedFit, screen, signatures
from explicitfe.inverse.close_loop.statistics.system import Hypothesis, Parameter, Term
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.platform.host import stopping

TESTS, SD = 4, 0.01
D = programme(TESTS)
NONE: frozenset[str] = frozenset()


def bump(centre: float, width: float = 0.05) -> np.ndarray:
    """A bump (n,) at a place of the way."""
    return np.exp(-(((D - centre) / width) ** 2))


TEN = {f"bump-{k}": Planted(lambda k=k: bump(0.05 + 0.1 * k)) for k in range(10)}
# Two forms of one cause and a form of another: these data tell them apart, but not by much.
FORMS = {
    "near": Planted(lambda: bump(0.40), cause="hump"),
    "twin": Planted(lambda: bump(0.405), cause="hump"),
    "far": Planted(lambda: bump(0.80)),
}


def holding(seed: int, hidden: dict[str, float] | None = None, effects=TEN, **more) -> Linear:
    return elastic(np.random.default_rng(seed), tests=TESTS, sd=SD, effects=effects, hidden=hidden, **more)


@pytest.mark.parametrize("hidden", [{"bump-3": 0.1}, {"bump-3": 0.1, "bump-7": -0.1}, {"bump-2": 0.1, "bump-3": 0.05}])
def test_the_true_set_among_ten_candidates(hidden):
    """0.05 of a bump changes chi2 by 25 times the sum of its squares, 4 x 2.4: about 240, and some 20 are needed."""
    comparison, outcome = compared(holding(1, hidden))
    assert (outcome.verdict, set(outcome.effects)) == ("effect-found", set(hidden))
    assert next(iter(comparison.posterior.sets)) == frozenset(hidden)
    assert min(comparison.posterior.inclusion[name] for name in hidden) > 0.99
    found = dict(outcome.final.model.of_terms())
    errors = np.sqrt(np.diag(np.linalg.inv(outcome.final.fit.jacobian.T @ outcome.final.fit.jacobian)))[-len(hidden) :]
    for (name, _), error in zip(outcome.final.model.of_terms(), errors, strict=True):
        assert found[name]["size"] == pytest.approx(hidden[name], abs=4.0 * error)


def test_probabilities_sum_to_one():
    comparison, _ = compared(holding(2, {"bump-3": 0.03}))
    posterior = comparison.posterior
    assert sum(posterior.sets.values()) == pytest.approx(1.0, abs=1e-9)
    assert sum(p for _, p in comparison.probabilities()) == pytest.approx(1.0, abs=1e-9)
    assert sum(posterior.closed.values()) + posterior.something_else == pytest.approx(1.0, abs=1e-9)
    assert all(0.0 <= p <= 1.0 + 1e-9 for p in posterior.inclusion.values())


def test_forms_of_one_cause_are_summed():
    """Neither form alone is sure where the data do not tell them apart; their cause is."""
    comparison, outcome = compared(holding(1, {"near": 0.05}, FORMS))
    forms = comparison.forms_of("hump")
    assert {"near", "twin"} <= set(forms) and min(forms["near"], forms["twin"]) > 0.01
    assert (outcome.verdict, outcome.present) == ("effect-found", ("hump",))
    assert comparison.posterior.inclusion["hump"] == pytest.approx(sum(forms.values()), abs=0.01)


def test_two_effects_that_mask_each_other():
    """The sum of two bumps of opposite sign at 0.50 and 0.52 is nearly the slope of one, which is at right angles to each: either
    alone explains a small part of what both explain.
    """
    effects = {**TEN, "left": Planted(lambda: bump(0.50)), "right": Planted(lambda: bump(0.52))}
    system = holding(1, {"left": 0.3, "right": -0.3}, effects)
    comparison, outcome = compared(system)
    alone = {e.key: e.fit.whitened for e in comparison.entries if e.fit is not None}
    both = alone["left", "right"]
    for one in ("left", "right"):
        assert alone[()] - alone[(one,)] < 0.3 * (alone[()] - both)
    assert (outcome.verdict, set(outcome.effects)) == ("effect-found", {"left", "right"})


def test_a_subset_never_fits_better_than_its_superset():
    """Beyond 0.05 of chi2: the search of a fit ends where a step gains less than 0.02, and 1e-5 of chi2.

    Where nothing explains the data, all single effects and many larger sets are fitted.
    """
    hidden = {"bump-3": 0.1, "bump-7": 0.03}
    comparison, _ = compared(holding(3, hidden, extra=0.02 * np.sin(7.0 * D)), max_effects=3)
    fits = {e.key: e.fit.whitened for e in comparison.entries if e.fit is not None}
    pairs = [(one, other) for one in fits for other in fits if set(one) < set(other)]
    assert len(pairs) > 10
    for one, other in pairs:
        assert fits[other] <= fits[one] + 0.05 + 2e-5 * fits[one], (one, other)


@pytest.mark.slow
@pytest.mark.parametrize("strength", [0.0, 0.02, 0.1])
def test_a_hundred_draws_of_noise(strength):
    """A perfect model is accepted, a strong effect found, and a faint one never mistaken for another, in 97 of 100 draws."""
    right = 0
    for seed in range(100):
        _, outcome = compared(holding(seed, {"bump-3": strength}))
        if strength == 0.0:
            right += outcome.verdict == "no-missing-effect"
        elif strength == 0.1:
            right += outcome.verdict == "effect-found" and outcome.present == ("bump-3",)
        else:
            right += set(outcome.present) <= {"bump-3"} and outcome.verdict != "unexplained"
    assert right >= 97


def test_a_smooth_misfit_that_no_candidate_describes():
    comparison, outcome = compared(holding(1, None, {"bump-3": TEN["bump-3"]}, extra=0.1 * np.sin(7.0 * D)))
    assert (outcome.verdict, outcome.remainder) == ("unexplained", "unexplained")
    assert comparison.posterior.something_else > 0.9 and outcome.sure == comparison.posterior.something_else


def test_without_effects():
    """With none allowed the baseline alone is weighed against something else."""
    for strength, verdict in ((0.0, "no-missing-effect"), (0.1, "unexplained")):
        comparison, outcome = compared(holding(1, None, extra=strength * np.sin(7.0 * D)), max_effects=0)
        assert outcome.verdict == verdict and [e.key for e in comparison.entries] == [()]


def test_a_search_that_ends_at_its_budget(monkeypatch):
    """Hypotheses that were not fitted keep their estimates, which are exact for a linear system, and are named."""
    monkeypatch.setattr(Budget, "capacity", property(lambda self: np.inf if self.simulations is None else 0))
    system = holding(3, {"bump-3": 0.1, "bump-7": 0.03})
    whole, _ = compared(system)
    ended, outcome = compared(system, simulations=1)
    assert [e.key for e in ended.entries if e.fit is not None] == [()] and ("bump-3",) in ended.left and not whole.left
    assert outcome.final.key == () and sum(ended.posterior.sets.values()) == pytest.approx(1.0)
    # Estimates come as near as the best fit, which is the baseline, and no effect is claimed on them alone.
    assert 0.1 < ended.posterior.inclusion["bump-3"] < 0.99 and outcome.verdict in ("ambiguous", "unexplained")
    (sentence,) = limit_warning(ended)
    assert "bump-3" in sentence and "`simulations`" in sentence and limit_warning(whole) == []


def fits_before_the_limit(monkeypatch, count: int) -> None:
    """Let the budget be spent after so many fits."""
    done: list[object] = []
    fit = Comparing._fit
    monkeypatch.setattr(Comparing, "_fit", lambda self, *given: (done.append(given), fit(self, *given)))
    limited = property(lambda self: 0 if self.simulations is not None and len(done) >= count else np.inf)
    monkeypatch.setattr(Budget, "capacity", limited)


def test_a_hypothesis_that_the_limit_left_is_not_ruled_out(monkeypatch):
    """The bump of the second effect has a place that none of its trials meets: a fit of it is as good as that of the first."""
    place = {"size": BOTH_WAYS, "place": Sought((0.33, 0.6), 0.05, 0.95)}
    system = holding(3, {"bump-3": 0.1}, {"bump-3": TEN["bump-3"], "movable": Planted(lambda place: bump(place), place)})
    system_fitted, _ = compared(system, max_effects=1)
    assert system_fitted.posterior.inclusion["movable"] > 0.01
    fits_before_the_limit(monkeypatch, 1)
    ended, outcome = compared(system, max_effects=1, simulations=1)
    assert ("movable",) in ended.left and outcome.final.key == ("bump-3",)
    assert 0.01 < ended.posterior.inclusion["movable"] < 0.5


def late(model: Hypothesis) -> np.ndarray:
    """The change by a load that acts late: it shows beside a hanging load, not beside a fixed one, and a little otherwise."""
    return bump(0.7) if "hanging" in model.effects else 0.0 * D if "fixed" in model.effects else 0.3 * bump(0.5)


class Hanging(Linear):
    """A system in which one effect depends on another."""

    def rows(self, model: Hypothesis) -> np.ndarray:
        planted = dict(self.effects)
        if "late" in model.effects:
            planted["late"] = replace(planted["late"], column=lambda: late(model))
        return Linear.rows(replace(self, effects=planted), model)


def test_a_cause_that_shows_beside_one_form_of_another():
    """The fixed load alone comes nearest, and a late load shows nothing with it; the hanging and the late load are true."""
    shared = bump(0.4) + 0.5 * bump(0.7)
    decoys = {f"decoy-{k}": Planted(lambda k=k: shared + 0.3 * bump(0.05 + 0.04 * k)) for k in range(8)}
    load = {
        "fixed": Planted(lambda: shared + 0.25 * bump(0.95), cause="load"),
        "hanging": Planted(lambda: bump(0.4), cause="load"),
    }
    effects = {**load, **decoys, "late": Planted(lambda: 0.3 * bump(0.5))}
    plain = holding(1, None, effects, extra=0.3 * (bump(0.4) + 0.6 * bump(0.7)))
    system = Hanging(**{one.name: getattr(plain, one.name) for one in fields(plain) if one.init})
    _, outcome = compared(system)
    assert outcome.verdict == "effect-found" and set(outcome.effects) == {"hanging", "late"}


def test_a_budget_leaves_fits_as_many_simulations_as_the_preparation():
    budget = Budget(60)
    for _ in range(50):
        budget.spend()
    budget.begin_fits()
    assert budget.capacity == 100 and not budget.reached()
    for _ in range(50):
        budget.spend()
    assert budget.reached() and not Budget().reached()


class Timed(Linear):
    """A system each of whose answers takes a second of a clock that is read where work can be left."""

    clock: ClassVar[list[float]] = [0.0]

    def answers(self, models):
        answers = []
        for model in models:
            stopping.check()
            self.clock[0] += 1.0
            stopping.check()
            answers.append(Linear.answers(self, [model])[0])
        return answers


def timed(monkeypatch, seconds: float) -> tuple[ComparedCauses, float]:
    """A search with a limit on the time, and when it ended."""
    Timed.clock[0] = 0.0
    monkeypatch.setattr(sys.modules[Budget.__module__], "time", SimpleNamespace(perf_counter=lambda: Timed.clock[0]))
    plain = holding(3, {"bump-3": 0.1, "bump-7": 0.03})
    system = Timed(**{one.name: getattr(plain, one.name) for one in fields(plain) if one.init})
    limit = Budget(minutes=seconds / 60.0)
    with stopping.checking(limit.check):
        return compare(system, max_effects=2, limit=limit), Timed.clock[0]


def test_a_limit_on_the_time_ends_a_search_within_a_fit(monkeypatch):
    """It ends in the midst of a fit, and the report may take a tenth of the limit; the verdict names what was not fitted."""
    whole, all_s = timed(monkeypatch, 1e6)
    assert whole.ended == ""
    ends = 0
    for seconds in np.linspace(0.05, 0.95, 10) * all_s:
        try:
            ended, end_s = timed(monkeypatch, seconds)
        except OutOfTimeError:  # before the candidates were screened
            assert Timed.clock[0] <= seconds + 1.0, seconds
            continue
        ends += 1
        assert end_s <= 1.1 * seconds + 1.0 and "limit" in ended.ended
        (sentence,) = limit_warning(ended)
        assert "`minutes`" in sentence and "depends on the machine" in sentence
    assert ends > 2


def test_progress_counts_simulations_and_ends_at_one():
    """The share never decreases and stays below 1 until the end, also where showing it checks a limit that is reached."""
    seen: list[tuple[str, float]] = []

    def show(stage: str, share: float) -> None:
        seen.append((stage, float(share)))
        limit.check()

    limit = Budget(minutes=1e-9)
    progress = SearchProgress(show, limit, usual_runs=3.0)
    for share in (0.0, 0.4, 0.3, 0.95):
        progress.step("a step", share)
        for _ in range(20):
            limit.spend()
    assert max(share for _, share in seen) < 1.0
    progress.enter("trace", 1.0)
    shares = [share for _, share in seen]
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(set(shares)) > 40


def test_a_hypothesis_that_cannot_be_computed_is_listed():
    """bump-4 stands near bump-3 here, so that the two are worth a fit, which is impossible."""

    def fails(model) -> bool:
        return "bump-3" in model.effects and "bump-4" in model.effects

    system = holding(1, {"bump-3": 0.1}, effects={**TEN, "bump-4": Planted(lambda: bump(0.36))}, fails=fails)
    comparison, outcome = compared(system)
    assert outcome.present == ("bump-3",)
    assert not any(e.fit is not None and set(e.key) >= {"bump-3", "bump-4"} for e in comparison.entries)
    for key, reason in comparison.failed.items():
        assert set(key) >= {"bump-3", "bump-4"} and reason


def test_what_cannot_be_seen_is_not_testable():
    effects = {**TEN, "faint": Planted(lambda: 1e-4 * bump(0.5)), "barred": Planted(lambda: bump(0.5), reason="no hold")}
    comparison, outcome = compared(holding(1, None, effects))
    assert set(comparison.not_testable) == {"faint", "barred"} and comparison.not_testable["barred"] == "no hold"
    assert "not detectable" in comparison.not_testable["faint"] and outcome.verdict == "no-missing-effect"


def test_an_error_that_rows_share_is_no_effect():
    """The same bump counts as an effect, and as nothing where it is a systematic error of that size."""
    extra = 0.05 * bump(0.35)
    assert compared(holding(1, None, extra=extra))[1].present == ("bump-3",)
    assert compared(holding(1, None, extra=extra, shared={"protocol of all": extra}))[1].present == ()


def test_numerical_error_as_large_as_the_residual_limits_the_verdict():
    error = 0.05 * np.sin(7.0 * D)
    _, outcome = compared(holding(1, None, {}, extra=error, checked={"finer mesh": error}))
    assert outcome.verdict == "limited-by-numerics"


def test_a_cause_may_be_ambiguous():
    """Two causes that these data do not tell apart: both undecided, and the credible set holds both."""
    effects = {"one": Planted(lambda: bump(0.4)), "two": Planted(lambda: bump(0.4005))}
    _, outcome = compared(holding(1, {"one": 0.1}, effects))
    assert (outcome.verdict, set(outcome.undecided), outcome.present) == ("ambiguous", {"one", "two"}, ())
    assert {frozenset({"one"}), frozenset({"two"})} <= set(outcome.credible) and outcome.sure >= THRESHOLDS.credible_set


# ---- the parts ----


def test_screening_is_linear_least_squares():
    """Where an answer is linear, the screened decrease of chi2 is that of the fit, for one effect and for two."""
    system = holding(1, {"bump-3": 0.1, "bump-4": 0.1})
    covariance = white(system, SD)
    fit = refit(system, system.start(), covariance)
    tested = [c for c in system.candidates(fit.model) if not c.reason]
    known = {one.candidate.effect: one for one in signatures(fit, covariance, tested, system.changes(fit.model, tested))}
    for names in (("bump-3",), ("bump-3", "bump-4")):
        members = [known[name] for name in names]
        found = screen(fit.residual, members)
        columns = np.column_stack([system.X, *(TEN[name].column() for name in names)])
        y = measured_rows(system.series)
        left = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        assert found.gain == pytest.approx(fit.whitened - float(left @ left) / SD**2, rel=1e-4)
        assert found.bound >= found.gain * (1.0 - 1e-9)
        for (strength,), name in zip(found.starts, names, strict=True):
            assert strength == pytest.approx(0.1, abs=0.02), name


@pytest.mark.parametrize("visible", [2.0e3, 5.0e5])
def test_the_cost_of_a_strength_is_that_of_its_prior(visible):
    """A normal prior with half the largest plausible strength as its standard deviation, against data that say none."""
    strengths = np.linspace(-1.0, 1.0, 200_001)  # in the largest plausible strength
    integrand = np.exp(-0.5 * visible * strengths**2) * norm.pdf(strengths, scale=0.5)
    assert cost_of_term(1, 100.0, visible) == pytest.approx(-np.log(np.trapezoid(integrand, strengths)), rel=1e-6)
    assert cost_of_term(3, 100.0, 0.0) == pytest.approx(1.5 * np.log(100.0))


@pytest.mark.parametrize("measured", [0.0, 0.3, 2.5])
def test_cost_and_prior_of_a_strength_are_the_evidence_of_normal_laws(measured):
    """One strength with a normal prior and a normal likelihood: cost, prior and likelihood at the optimum give the integral."""
    largest, visible = 0.8, 2.0e3  # the largest plausible strength, and the decrease of chi2 by it
    term = Term("one", (Parameter("one.s", Sought((0.1, 0.3, largest), -5.0, 5.0), 0.3),))
    slope = np.array([[np.sqrt(visible) / largest]])
    model = Hypothesis((), (term,), np.array([measured]))
    fit = BestFit(model, np.zeros(1), slope, np.zeros(1), slope, (), True)
    strengths = np.linspace(-4.0, 4.0, 400_001)
    likelihood = np.exp(-0.5 * (slope[0, 0] * (strengths - measured)) ** 2)
    exact = np.log(np.trapezoid(likelihood * norm.pdf(strengths, scale=0.5 * largest), strengths))
    assert log_prior_of_strengths(fit) - cost_of_term(1, 100.0, visible) == pytest.approx(exact, rel=1e-5)


def test_a_discrepancy_costs_what_it_does_not_explain():
    """Monotone in chi2; against it where the residual is noise (chi2 = free), for it where it is many times that."""
    gains = [log_discrepancy(chi2, 10) for chi2 in (0.0, 10.0, 30.0, 100.0)]
    assert all(a < b for a, b in pairwise(gains)) and gains[1] < 0.0 < gains[2] and gains[3] > 20.0
    assert log_discrepancy(5.0, 0) == -np.inf


def test_the_prior_is_uniform_over_sizes_sets_and_forms():
    """Sum over all sets of one size is the same for each size."""
    prior = Prior(4, {"a": 2})
    assert np.exp(prior.log(NONE)) == pytest.approx(1.0)
    singles = 2 * np.exp(prior.log({"a"})) + sum(np.exp(prior.log({name})) for name in "bcd")
    pairs = sum(np.exp(prior.log({"a", name})) * 2 for name in "bcd") + 3 * np.exp(prior.log({"b", "c"}))
    assert (singles, pairs) == (pytest.approx(1.0), pytest.approx(1.0))


def test_the_posterior_of_two_hypotheses():
    """Without discrepancies it is the softmax of log evidence plus log prior."""
    lack = LackOfFit(0.0, 0, 1.0)
    entries = [(NONE, Evidence(-10.0, -np.inf, -np.inf, lack)), (frozenset({"a"}), Evidence(-8.0, -np.inf, -np.inf, lack))]
    posterior = posterior_of(entries, Prior(1, {"a": 1}))
    assert posterior.inclusion["a"] == pytest.approx(1.0 / (1.0 + np.exp(-2.0)))
    assert posterior.something_else == 0.0 and posterior.form == 0.0
    opened = [(NONE, replace(entries[0][1], other=50.0)), entries[1]]
    assert posterior_of(opened, Prior(1, {"a": 1})).something_else > 0.999


def test_the_posterior_in_words():
    posterior = Posterior({NONE: 0.5, frozenset({"a", "b"}): 0.3}, {NONE: 0.15, frozenset({"a"}): 0.05}, 0.0)
    assert posterior.by_words == {"nothing": 0.5, "a + b": 0.3, "other": 0.15, "a": 0.05}
    assert list(posterior.sets) == [NONE, frozenset({"a", "b"}), frozenset({"a"})]


def test_an_estimate_bounds_the_fit_by_the_error_that_it_has():
    """A change of norm 50 that is wrong by a tenth can lower chi2 by what 5 standard deviations along the misfit explain, and
    never by more than the misfit and the noise of one direction."""
    rows, misfit = 200, 20.0
    one = EstimatedFit(rows + misfit**2, 50.0, fast=True)
    along = misfit + NOISE_SDS
    assert one.possible_gain(0.1, rows) == pytest.approx(along**2 - (along - 5.0) ** 2)
    assert one.possible_gain(1.0, rows) == pytest.approx(along**2)
    assert EstimatedFit(rows, 0.0, fast=True).possible_gain(1.0, rows) == 0.0
    # The error is seen in the norm of the residual, as a share of the change or, for a faint one, of the residual itself.
    assert EstimatedFit(900.0, 50.0, fast=False).error_of(625.0) == pytest.approx(0.1)
    assert EstimatedFit(900.0, 1.0, fast=False).error_of(625.0) == pytest.approx(0.2)
    assert one.error_of(1e4) == 0.0


def test_the_evidence_of_a_gain_cannot_use_a_misfit_twice():
    """Where a smooth discrepancy takes up a misfit, explaining a hundredth of it changes little."""
    lack = LackOfFit(1e4, 20, 0.0)
    before = Evidence(-0.5 * 1e4, -np.inf, log_discrepancy(lack.chi2, lack.free), lack)
    assert before.best > -200.0
    assert before.with_gain(100.0).best == pytest.approx(before.best, abs=1.0)
    assert before.with_gain(1e4).best == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("rows", [30, 300, 3000])
@pytest.mark.parametrize("factor", [1.2, 3.0, 100.0])
def test_larger_noise_is_the_integral_over_its_factor(rows, factor):
    """Laplace's integral against a sum, where the noise is larger by more than the width of the integrand."""
    chi2 = rows * factor**2
    grid = np.linspace(np.log(factor) - 1.0, np.log(factor) + 1.0, 20001)
    grid = grid[grid >= 0.0]
    logs = -rows * grid - 0.5 * chi2 * np.exp(-2.0 * grid) + 0.5 * chi2
    exact = logsumexp(logs) + np.log((grid[1] - grid[0]) / np.log(1e4) * THRESHOLDS.larger_noise_odds)
    if exact > 3.0:  # else the noise is as large as stated, too
        assert log_larger_noise(chi2, rows) == pytest.approx(exact, abs=0.1)
    assert log_larger_noise(float(rows), rows) == 0.0


@pytest.mark.parametrize("strength", [0.0, 0.1])
def test_noise_that_is_larger_than_stated_is_noise(strength):
    """A misfit without shape is no sign that something else is missing, and hides no strong effect; one with a shape is."""
    hidden = {"bump-3": strength}
    system = elastic(np.random.default_rng(5), tests=TESTS, sd=0.02, effects=TEN, hidden=hidden)
    system = replace(system, series=[replace(one, noise_sd=0.01) for one in system.series])
    comparison, outcome = compared(system, sd=0.01)
    assert comparison.baseline.fit.whitened > 3.0 * comparison.baseline.evidence.rows
    assert (outcome.verdict, outcome.present) == (("effect-found", ("bump-3",)) if strength else ("no-missing-effect", ()))


def test_the_nearest_model_of_unexplained_data_leaves_least():
    """A smooth curve could stand for what each of them leaves."""
    comparison, outcome = compared(holding(1, {"bump-3": 1.0}, extra=0.1 * np.sin(7.0 * D)))
    left = {e.key: e.fit.whitened for e in comparison.entries if e.fit is not None}
    assert outcome.verdict == "unexplained" and "bump-3" in outcome.final.key
    assert left[outcome.final.key] < left["bump-3",] + 1e-6 and comparison.nearest is outcome.final


def test_a_gross_misfit_is_fitted_by_the_rows_alone():
    """Errors of lengths that are far too small for a misfit would draw the constants away from the data."""
    system = holding(2, None, extra=5.0 * D**2 - 5.0 * D**5)
    floor = {"assumed length": 0.05 * measured_rows(system.series)}
    plain = refit(system, system.start(), white(system))
    shared = refit(system, system.start(), replace(white(system), floors=floor))
    assert shared.by_rows == pytest.approx(plain.whitened) and shared.model.values == pytest.approx(plain.model.values)
