"""What candidates explain and how likely that is by chance, against brute force and known distributions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest
from synthetic import BOTH_WAYS, ROWS, UPWARD, Linear, Planted, elastic, fitted, programme, white

from explicitfe.close_loop.statistics.covariance import measured_rows, outside
from explicitfe.close_loop.statistics.fingerprints import (
    FAILED,
    NOT_SIGNIFICANT,
    NOT_TESTABLE,
    SIGNIFICANT,
    fingerprints,
    holm,
    lack_of_fit,
    largest_drop,
    scores,
)
from explicitfe.close_loop.statistics.refit import refit
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.effects.effect import Sought

SD = 0.01
D = programme(3)
TEST = np.repeat(np.arange(3.0), ROWS) - 1.0
WAVES = {"size": BOTH_WAYS, "waves": Sought((1.0, 2.0, 3.0), 0.5, 5.0)}
EFFECTS = {
    "rate": Planted(lambda: D * TEST),
    "waves": Planted(lambda k: np.sin(np.pi * k * D), WAVES),
}
# The level of a Kolmogorov-Smirnov test: one run of the suite in a thousand would fail, but the seeds are fixed.
KS = 1e-3


def by_name(scored):
    return {score.candidate.effect: score for score in scored}


def test_outside_is_orthogonal():
    """(1 - J J^+) columns; a column of J leaves nothing, nor does one of a J of less than full rank."""
    rng = np.random.default_rng(1)
    J, columns = rng.standard_normal((50, 4)), rng.standard_normal((50, 3))
    J = np.column_stack([J, J[:, 0] + J[:, 1]]) * [1.0, 1e4, 1e-4, 1.0, 1.0]
    left = outside(J, columns)
    np.testing.assert_allclose((J / np.linalg.norm(J, axis=0)).T @ left, 0.0, atol=1e-10)
    np.testing.assert_allclose(columns - left, J @ np.linalg.lstsq(J, columns, rcond=1e-10)[0], atol=1e-9)
    np.testing.assert_allclose(outside(J, J[:, 1]), 0.0, atol=1e-8)
    np.testing.assert_allclose(outside(J[:, :0], columns), columns)


def test_explained_is_the_best_amplitude():
    """max over 0 <= a <= limit of |r|^2 - |r - a s|^2, on a grid so fine that the maximum is missed by (step / 2)^2 |s|^2."""
    rng = np.random.default_rng(2)
    secants, r, limits = rng.standard_normal((20, 6)), rng.standard_normal(20), np.array([0.01, 0.1, 0.3, 1.0, 3.0, 10.0])
    drop = largest_drop(secants.T @ r, (secants**2).sum(axis=0), limits)
    for k, limit in enumerate(limits):
        a = np.linspace(0.0, limit, 2001)
        drops = r @ r - ((r[:, None] - a * secants[:, [k]]) ** 2).sum(axis=0)
        missed = (0.5 * limit / 2000) ** 2 * (secants[:, k] ** 2).sum()
        assert drops.max() <= drop[k] + 1e-12 and drop[k] <= drops.max() + missed + 1e-12
    assert largest_drop(np.array([-1.0]), np.array([2.0]), np.array([5.0]))[0] == 0.0


def test_secants_are_whitened_and_what_the_constants_cannot_imitate():
    """Of strength 1 along "waves" 2: (1 - X X^+) sin(2 pi d) / sd; -0.1 goes ten times into the largest."""
    system = elastic(np.random.default_rng(3), effects=EFFECTS)
    _, _, prints = fitted(system, white(system))
    waves = prints[1]
    number = waves.values.index((1.0, 2.0))
    column = EFFECTS["waves"].column(2.0)
    wanted = (column - system.X @ np.linalg.lstsq(system.X, column, rcond=None)[0]) / SD
    np.testing.assert_allclose(waves.secants[:, number], wanted, atol=1e-6 * np.abs(wanted).max())
    small = waves.values.index((-0.1, 1.0))
    assert (waves.limits[small], waves.plausible[small]) == (pytest.approx(1000.0), pytest.approx(10.0))
    assert waves.visible == pytest.approx(max((waves.secants[:, k] ** 2).sum() for k in range(waves.secants.shape[1])))


def test_holm_by_hand():
    """0.01 x 4, 0.02 x 3, then no less than before: 0.03 x 2 = 0.06, 0.06 from the largest."""
    assert holm([0.03, 0.01, 0.06, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06])
    assert holm([0.5, 0.4]) == pytest.approx([0.8, 0.8]) and holm([]) == []
    assert holm([0.9, 0.6, 0.7]) == [1.0, 1.0, 1.0]


@pytest.fixture(scope="module")
def by_chance() -> tuple[np.ndarray, np.ndarray]:
    """300 measurements of the model itself with noise of the stated sd: p of one candidate's search over six trials, and of the
    lack of fit.
    """
    system = elastic(np.random.default_rng(0), effects={"waves": EFFECTS["waves"]})
    covariance = white(system)
    _, candidates, prints = fitted(system, covariance)
    chances, lacks = [], []
    for seed in range(300):
        rng = np.random.default_rng(1000 + seed)
        now = system.measuring(system.X @ [2.0, 1.0] + SD * rng.standard_normal(len(system.X)))
        fit = refit(now, now.start(), covariance)
        chances.append(scores(fit, prints, candidates, seed, draws=2000)[0].p)
        lacks.append(lack_of_fit(fit, covariance).p)
    return np.array(chances), np.array(lacks)


def test_p_of_a_search_is_uniform_by_chance(by_chance):
    """The bootstrap repeats the search over shapes and signs, so its p is uniform: Kolmogorov-Smirnov over 300 seeds."""
    assert kstest(by_chance[0], "uniform").pvalue > KS
    # 300 draws, 5 % expected: +- 3 sqrt(0.05 x 0.95 / 300)
    assert np.mean(by_chance[0] < 0.05) == pytest.approx(0.05, abs=0.038)


def test_p_of_lack_of_fit_is_uniform_by_chance(by_chance):
    """|projection|^2 of unit noise on smooth functions outside the model's span is chi2 with their number."""
    assert kstest(by_chance[1], "uniform").pvalue > KS


def test_a_planted_effect_is_significant_and_of_its_size():
    """0.05 sin(2 pi d) of 0.01 noise in 120 rows explains 0.05^2 x 60 / 1e-4 = 1500 less its overlap with d and d^3; its
    amplitude is found within 3 sd / sqrt(60) = 0.004.
    """
    extra = 0.05 * np.sin(2.0 * np.pi * D)
    system = elastic(np.random.default_rng(4), effects=EFFECTS, extra=extra)
    fit, candidates, prints = fitted(system, white(system))
    scored = by_name(scores(fit, prints, candidates))
    left = extra - system.X @ np.linalg.lstsq(system.X, extra, rcond=None)[0]
    size = float(left @ left) / SD**2
    assert (scored["waves"].status, scored["rate"].status) == (SIGNIFICANT, NOT_SIGNIFICANT)
    assert scored["waves"].drop == pytest.approx(size, abs=6.0 * np.sqrt(size))  # sd of |rest + noise|^2 is 2 |rest|
    assert scored["waves"].values[1] == 2.0
    assert scored["waves"].values[0] == pytest.approx(0.05, abs=3.0 * SD * np.sqrt(1.0 / (size * SD**2)))
    assert lack_of_fit(fit, white(system)).excess == pytest.approx(size, abs=6.0 * np.sqrt(size))


def test_an_effect_of_the_other_sign_is_none():
    """A strength that only grows upwards explains nothing of what lies below."""
    effects = {"up": Planted(lambda: np.sin(2.0 * np.pi * D), {"size": UPWARD})}
    system = elastic(np.random.default_rng(5), effects=effects, extra=-0.05 * np.sin(2.0 * np.pi * D))
    fit, candidates, prints = fitted(system, white(system))
    (score,) = scores(fit, prints, candidates)
    assert (score.status, score.drop, score.p) == (NOT_SIGNIFICANT, 0.0, 1.0)


@pytest.mark.parametrize(("size", "status"), [(0.99, NOT_TESTABLE), (1.01, NOT_SIGNIFICANT)])
def test_what_stays_under_the_floors_is_not_testable(size, status):
    """|secant|^2 of the largest plausible strength just under and just over 25, with nothing there."""
    column = np.sin(2.0 * np.pi * D)
    system = elastic(np.random.default_rng(6))
    left = column - system.X @ np.linalg.lstsq(system.X, column, rcond=None)[0]
    column = np.sqrt(size * THRESHOLDS.visible_separation) * SD / np.linalg.norm(left) * column
    system.effects = {"small": Planted(lambda: column, {"size": BOTH_WAYS})}
    fit, candidates, prints = fitted(system, white(system))
    (score,) = scores(fit, prints, candidates)
    assert score.status == status
    assert ("under the floors" in score.reason) == (status == NOT_TESTABLE)


def test_what_the_constants_imitate_is_not_testable():
    """A column in the span of the model."""
    effects = {"same": Planted(lambda: 3.0 * D + D**3)}
    system = elastic(np.random.default_rng(7), effects=effects)
    fit, candidates, prints = fitted(system, white(system))
    assert scores(fit, prints, candidates)[0].status == NOT_TESTABLE


def test_reasons_and_failures():
    """What the data lack is told; what cannot be computed is a failure, not an absence."""
    effects = {"lacking": Planted(lambda: D, reason="these data have no time"), "broken": Planted(lambda: D * TEST)}
    system = elastic(np.random.default_rng(8), effects=effects, fails=lambda model: "broken" in model.effects)
    fit, candidates, prints = fitted(system, white(system))
    scored = by_name(scores(fit, prints, candidates))
    assert (scored["lacking"].status, scored["lacking"].reason) == (NOT_TESTABLE, "these data have no time")
    assert scored["broken"].status == FAILED


def test_a_reference_takes_the_place_of_the_answer():
    """Secants from what is computed in another way: the constant that both have in common does not count."""
    system = elastic(np.random.default_rng(9), effects={"rate": EFFECTS["rate"]})
    covariance = white(system)
    fit, (plain,), (wanted,) = fitted(system, covariance)
    offset = Linear(system.series, system.X, {"rate": EFFECTS["rate"]})
    offset.rows = lambda model: Linear.rows(system, model) + (0.3 * D**2 if model.terms else 0.0)
    reference = replace(plain, reference=((0.0,),) * len(plain.trials))
    (moved,) = fingerprints(offset, fit, covariance, [reference])
    np.testing.assert_allclose(moved.secants, wanted.secants, atol=1e-8 * np.abs(wanted.secants).max())


# ---- constants at a bound, noise in the imposed column ----


def test_a_constant_at_its_bound_hides_nothing():
    """The truth lies at x1 = -1, where the bound is 0. The misfit has the shape of that constant, which cannot take it up: it is
    a lack of fit, and no candidate may count on x1 going down.
    """
    extra = -2.0 * D**3
    effects = {"up": Planted(lambda: D**5, {"size": UPWARD})}
    system = elastic(np.random.default_rng(10), extra=extra, effects=effects, bounds=[(-1e6, 1e6), (0.0, 1e6)])
    fit, candidates, prints = fitted(system, white(system))
    assert fit.at_bound == ("x1",)
    assert lack_of_fit(fit, white(system)).p < 1e-6
    # d^5 upwards with x1 downwards would do; alone it makes things worse
    (score,) = scores(fit, prints, candidates)
    assert score.status == NOT_SIGNIFICANT and score.drop < 5.0


def test_noise_of_the_imposed_column_is_no_lack_of_fit():
    """Rows at a way that is read with an error, predicted at what was read: residual and derivatives share that error. 40 seeds,
    of which one in a hundred may alarm: two or less in all but 0.7 % of the cases, three in 0.1 %.
    """
    alarms = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        truth = np.column_stack([D, D**3]) @ [2.0, 1.0]
        read = D + 0.004 * rng.standard_normal(len(D))
        system = elastic(rng, sd=SD)
        system.X = np.column_stack([read, read**3])
        system = system.measuring(truth)
        each = 0.004 * (2.0 + 3.0 * D**2)
        covariance = white(system)
        for k, row in enumerate(covariance.rows):
            row.sd[:] = each[k * ROWS : (k + 1) * ROWS]
        covariance = type(covariance)(system.series, covariance.rows, covariance.scatter)
        fit = refit(system, system.start(), covariance)
        assert len(measured_rows(system.series)) == len(fit.answer)
        alarms += lack_of_fit(fit, covariance).p < 0.01
    assert alarms <= 3


def test_a_curve_of_three_rows_has_no_lack_of_fit():
    """No smooth function is left outside the span of the model: p is 1, and no NaN."""
    d = np.array([0.0, 0.5, 1.0])
    system = elastic(np.random.default_rng(11), tests=1, rows=3)
    system.X = np.column_stack([np.ones(3), d])
    fit = refit(system, system.start(), white(system))
    lack = lack_of_fit(fit, white(system))
    assert (lack.free, lack.p) == (0, 1.0)


def test_what_is_a_function_of_the_programme_alone_shows_no_memory():
    """Three tests with one programme. A cube of it is nothing that is left beside polynomials of the programme; what one test
    has and another has not at the same place is. By chance p is as even beside these columns as without.
    """
    state = np.polynomial.legendre.legvander(2.0 * D - 1.0, 6)

    def p_of(extra: np.ndarray, seed: int) -> float:
        system = elastic(np.random.default_rng(seed), sd=SD, extra=extra)
        return lack_of_fit(fitted(system, white(system))[0], white(system), state).p

    assert min(p_of(0.5 * D**5, seed) for seed in range(5)) > 1e-3 and p_of(0.5 * D**5 * TEST, 5) < 1e-6
    assert kstest([p_of(0.0 * D, seed) for seed in range(100)], "uniform").pvalue > KS
