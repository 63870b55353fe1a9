"""Fits, intervals and leaving tests out, on a linear system: the normal equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from synthetic import UPWARD, WIDE, Linear, Planted, elastic, programme, split_up, white

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.statistics import refit as refit_module
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows
from explicitfe.inverse.close_loop.statistics.intervals import intervals, intervals_beside_a_misfit, left_out_error
from explicitfe.inverse.close_loop.statistics.noise import RowNoise, Scatter
from explicitfe.inverse.close_loop.statistics.refit import _update, derivatives, refit, settled
from explicitfe.inverse.close_loop.statistics.system import Hypothesis
from explicitfe.platform.errors import RunError

SD = 0.01


def correlated(system: Linear) -> Covariance:
    rows = [RowNoise(np.full(len(one.measured), SD), 0.4, True) for one in system.series]
    rng = np.random.default_rng(9)
    floor = {"mesh": 0.01 * rng.standard_normal(sum(len(one.measured) for one in system.series))}
    return Covariance(system.series, rows, Scatter(0.0, 0.01, "stated", 0), floor)


def test_a_linear_fit_solves_the_normal_equations():
    """x = (X^T Sigma^-1 X)^-1 X^T Sigma^-1 y. The search ends where another step would gain less than 0.02 of chi2, so less than
    sqrt(0.02) = 0.14 standard errors off; on a linear system its first step lands within its damping of 1e-3, the second one
    within 1e-6 of the way of 300 standard errors.
    """
    system = elastic(np.random.default_rng(1))
    covariance = correlated(system)
    fit = refit(system, system.start(), covariance)
    W, y = covariance.whiten(system.X), covariance.whiten(measured_rows(system.series))
    wanted = np.linalg.solve(W.T @ W, W.T @ y)
    error = np.sqrt(np.diag(np.linalg.inv(W.T @ W)))
    assert fit.converged and fit.at_bound == ()
    assert np.abs(fit.model.x - wanted).max() < 0.14 * error.max()
    np.testing.assert_allclose(fit.jacobian, W, rtol=1e-6, atol=1e-8 * np.abs(W).max())
    assert fit.chi2 == pytest.approx(float((y - W @ fit.model.x) @ (y - W @ fit.model.x)), rel=1e-9)


def test_a_target_is_met_instead_of_the_rows():
    """An answer of the system itself: chi2 falls to less than the 0.02 that a step must gain."""
    system = elastic(np.random.default_rng(2))
    target = system.X @ [0.7, 3.0]
    fit = refit(system, system.start(), white(system), target=target)
    assert fit.chi2 < 0.02
    # 0.02 of chi2 is 0.14 standard errors; that of x1 is 0.003
    np.testing.assert_allclose(fit.model.x, [0.7, 3.0], atol=1e-3)


def test_bounds_hold_and_are_named():
    """The truth x0 = 2 lies above its bound of 1.5: the other parameter is at the constrained optimum."""
    system = elastic(np.random.default_rng(3), bounds=[(0.0, 1.5), (-WIDE, WIDE)])
    fit = refit(system, system.start(), white(system))
    wanted = lsq_linear(system.X, measured_rows(system.series), bounds=([0.0, -WIDE], [1.5, WIDE])).x
    assert fit.converged and fit.at_bound == ("x0",)
    np.testing.assert_allclose(fit.model.x, wanted, atol=1e-3)
    low, high = intervals(fit, white(system))[0]
    assert low < high == pytest.approx(1.5)


def test_intervals_are_the_analytic_ones_and_cover():
    """x +- 1.96 sqrt(diag (X^T X)^-1) sd. Of 200 seeds 95 +- 3 sqrt(0.95 x 0.05 / 200) = 5 % hold the truth, per parameter."""
    inside = np.zeros(2)
    for seed in range(200):
        system = elastic(np.random.default_rng(seed))
        fit = refit(system, system.start(), white(system))
        limits = intervals(fit, white(system))
        inside += [low <= truth <= high for truth, (low, high) in zip((2.0, 1.0), limits, strict=True)]
    half = 1.959964 * SD * np.sqrt(np.diag(np.linalg.inv(system.X.T @ system.X)))
    for k, (low, high) in enumerate(limits):
        np.testing.assert_allclose([low, high], fit.model.x[k] + half[k] * np.array([-1.0, 1.0]), rtol=1e-5)
    np.testing.assert_allclose(np.diff(intervals(fit, white(system), 4.0)), 2.0 * np.diff(limits), rtol=1e-9)
    assert np.abs(inside / 200 - 0.95).max() < 0.05


@pytest.mark.parametrize("by", [1e-12, 1e-6, 1e6])
def test_intervals_do_not_depend_on_units(by):
    """C20 in MPa or Pa: the same interval in the same unit."""
    system = elastic(np.random.default_rng(4))
    other = elastic(np.random.default_rng(4), bounds=[(-WIDE, WIDE), (-WIDE / by, WIDE / by)])
    other.X = system.X * [1.0, by]
    fit = refit(system, system.start(), white(system))
    scaled = refit(other, Hypothesis(other.base, (), fit.model.x / [1.0, by]), white(other))
    wanted, limits = intervals(fit, white(system))[1], intervals(scaled, white(other))[1]
    assert by * (limits[1] - limits[0]) == pytest.approx(wanted[1] - wanted[0], rel=1e-4)


def test_of_what_the_data_do_not_depend_on_nothing_is_known():
    """A column of zeros: the interval is all that the bounds allow."""
    system = elastic(np.random.default_rng(5), bounds=[(-WIDE, WIDE), (0.0, 7.0)])
    system.X = system.X * [1.0, 0.0]
    fit = refit(system, system.start(), white(system))
    assert intervals(fit, white(system))[1] == (0.0, 7.0)


def test_intervals_of_a_gross_misfit_are_those_of_the_rows_and_what_they_share():
    """Fitted by the rows alone, x = (J^T J)^-1 J^T y; with y off by worse x sd^2 a row and by an offset b of each test, its
    variance is worse sd^2 (J^T J)^-1 + (G b) (G b)^T, G = (J^T J)^-1 J^T. The whitened curvature would say 0 of b.
    """
    system = elastic(np.random.default_rng(6), extra=0.1 * np.cos(9.0 * np.pi * programme(3)))
    b = 0.02 * np.ones(len(system.X))
    covariance = replace(white(system), floors={"offset": b})
    fit = refit(system, system.start(), covariance)
    assert fit.by_rows is not None
    G = np.linalg.pinv(system.X)
    sd = np.sqrt(30.0 * SD**2 * np.diag(G @ G.T) + (G @ b) ** 2)
    for k, (low, high) in enumerate(intervals(fit, covariance, 30.0)):
        assert high - low == pytest.approx(2.0 * 1.959964 * sd[k], rel=1e-4)


def test_a_model_that_is_not_linear_is_fitted_too():
    """s (1 - e^(-d / l)), exact rows: the search ends within 0.14 standard errors of both."""
    d = programme(2)
    effects = {
        "rise": Planted(
            lambda length: 1.0 - np.exp(-d / length),
            {"size": Sought((0.5, 1.0), 0.0, 10.0), "length": Sought((0.1, 0.5), 0.01, 5.0, kind="log")},
        )
    }
    y = 0.3 * d + 1.2 * (1.0 - np.exp(-d / 0.2))
    system = Linear(split_up(y, 2, SD), d[:, None], effects)
    (candidate,) = system.candidates(system.start())
    fit = refit(system, system.start().plus(candidate.term, (0.5, 0.5)), white(system))
    assert fit.converged and fit.chi2 < 0.02
    np.testing.assert_allclose(fit.model.values, [0.3, 1.2, 0.2], rtol=0.02)


def test_a_start_that_cannot_be_computed_is_an_error():
    system = elastic(np.random.default_rng(7), fails=lambda model: True)
    with pytest.raises(RunError, match="cannot be computed"):
        refit(system, system.start(), white(system))


@pytest.mark.parametrize("largest, tried", [(10.0, [4.0]), (2.5, [4.0, 2.0]), (0.5, [4.0, 2.0, 1.0, 0.4])])
def test_an_effect_that_cannot_be_computed_at_its_start_begins_weaker(largest, tried):
    """The data want a strength of 0.3, and the search begins at 4, where the body is too soft: it begins with a weaker one."""
    d = programme(2)
    y = 0.3 * d**2 + d
    seen: list[float] = []

    def fails(model: Hypothesis) -> bool:
        if model.terms:
            seen.append(float(model.x[-1]))
        return bool(model.terms) and model.x[-1] > largest

    system = Linear(split_up(y, 2, SD), d[:, None], {"bend": Planted(lambda: d**2, {"size": UPWARD})}, fails=fails)
    (candidate,) = system.candidates(system.start())
    fit = refit(system, system.start().plus(candidate.term, (4.0,)), white(system))
    assert fit.converged
    np.testing.assert_allclose(fit.model.values, [1.0, 0.3], rtol=1e-3)
    assert seen[: len(tried)] == pytest.approx(tried)


def test_a_model_that_cannot_be_computed_at_any_strength_is_named():
    system = elastic(
        np.random.default_rng(7), effects={"bend": Planted(lambda: programme(1))}, fails=lambda model: bool(model.terms)
    )
    (candidate,) = system.candidates(system.start())
    with pytest.raises(RunError, match=r"x0 = 0, x1 = 0, bend\.size = 1\), nor with weaker effects"):
        refit(system, system.start().plus(candidate.term, (1.0,)), white(system))


def test_trials_that_cannot_be_computed_cost_few_runs(monkeypatch):
    """An answer exp(x) d that begins at x = -3 and ends at 2; above 2.5 nothing can be computed, and each failed trial is a run.

    The first step, by the derivative of exp(-3), is 147 long. A damping that grows by a factor of 10 from 1e-3 on fails five
    times before the step is shorter than 5.5; one that begins with 1 fails twice.
    """
    d = programme(1)
    growing = Planted(lambda: d, {"size": Sought((1.0,), 1e-9, 1e90, kind="log", none=1.0)})

    def failures() -> int:
        failed: list[bool] = []

        def fails(model: Hypothesis) -> bool:
            failed.append(bool(model.terms) and float(model.x[-1]) > 2.5)
            return failed[-1]

        system = Linear(split_up(np.exp(2.0) * d, 1, SD), np.zeros((len(d), 0)), {"growing": growing}, bounds=[], fails=fails)
        (candidate,) = system.candidates(system.start())
        fit = refit(system, system.start().plus(candidate.term, (np.exp(-3.0),)), white(system))
        assert fit.model.x[0] == pytest.approx(2.0, abs=1e-3)
        return sum(failed)

    few = failures()
    monkeypatch.setattr(refit_module, "DAMPING_AFTER_FAILURE", 0.0)
    assert few <= failures() - 3


def test_a_model_that_fails_where_the_search_wants_to_go_has_not_converged():
    """Everything above x0 = 0.5 cannot be computed, while the data want 2: the search says that it gave up."""
    system = elastic(np.random.default_rng(8), fails=lambda model: model.x[0] > 0.5)
    assert not refit(system, system.start(), white(system)).converged


def test_derivatives_stay_inside_the_bounds():
    """At the upper bound the step goes down; a linear answer has the same derivative both ways, to rounding / step = 1e-12."""
    seen = []
    system = elastic(np.random.default_rng(9), bounds=[(0.0, 2.0), (0.0, 1.0)], fails=lambda m: seen.append(m.x) or False)
    model = system.start().at(np.array([2.0, 1.0]))
    slopes = derivatives(system, model, system.rows(model))
    np.testing.assert_allclose(slopes, system.X, atol=1e-11)
    assert max(x[0] for x in seen) <= 2.0 and max(x[1] for x in seen) <= 1.0


def test_derivatives_are_kept_up_to_date_test_by_test():
    """Two tests with a constant each, and one in common: y = a + c and b + c. From derivatives that are off, a step along all of
    them mends both tests, and no test takes up the constant of the other.
    """
    true = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    off, step = 1.3 * true, np.array([1.0, -2.0, 0.5])
    slopes = _update(off, true @ step, step)
    assert slopes @ step == pytest.approx(true @ step, rel=1e-14)
    assert slopes[0, 1] == slopes[1, 0] == 0.0


# ---- leaving tests out ----


def left_out(system: Linear, test: int, rows: int) -> float:
    """Really without it: white rows, least squares of the others."""
    tested = np.zeros(len(system.X), dtype=bool)
    tested[test * rows : (test + 1) * rows] = True
    y = measured_rows(system.series)
    x = np.linalg.lstsq(system.X[~tested], y[~tested], rcond=None)[0]
    left = (y - system.X @ x)[tested]
    return float(np.sqrt(np.mean(left**2)) / np.abs(y[tested]).max())


def test_a_misfit_that_differs_from_test_to_test_widens_intervals():
    """Six tests whose stiffness scatters by 10 % although nobody says so: the rows know x0 hundred times better than that. Left
    out in turn, the tests say how well it is known: the interval holds the mean in 95 % of 60 seeds, less three standard errors.
    """
    tests, covered = 6, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        d = programme(tests)
        sizes = np.repeat(2.0 * (1.0 + 0.1 * rng.standard_normal(tests)), len(d) // tests)
        system = Linear(split_up(sizes * d + SD * rng.standard_normal(len(d)), tests, SD), d[:, None])
        fit = refit(system, system.start(), white(system))
        ((low, high),) = intervals(fit, white(system))
        assert high - low < 0.02
        ((low, high),) = intervals_beside_a_misfit(fit, white(system), 1.0, [])
        covered.append(low < 2.0 < high)
    assert np.mean(covered) > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / 60)


def test_constants_may_be_those_of_a_model_that_is_not_rejected():
    """The truth has a wave that the baseline takes for stiffness; the model with the wave has the true constants."""
    effects = {"wave": Planted(lambda: np.sin(2.0 * np.pi * programme(1)))}
    system = elastic(np.random.default_rng(5), tests=1, hidden={"wave": 0.1}, effects=effects)
    covariance = white(system)
    fit = refit(system, system.start(), covariance)
    other = refit(system, fit.model.plus(system.candidates(fit.model)[0].term, (0.1,)), covariance)
    limits = intervals_beside_a_misfit(fit, covariance, 1.0, [other])
    for (low, high), (first, last) in zip(limits, intervals(other, covariance)[:2], strict=True):
        assert low <= first and last <= high
    assert len(limits) == 2 and not all(a < x < b for (a, b), x in zip(intervals(fit, covariance), (2.0, 1.0), strict=True))


def test_cross_validation_is_really_leaving_a_test_out():
    """A linear system's derivatives are exact, whatever point they are taken at; white rows."""
    rng = np.random.default_rng(10)
    system = elastic(rng, tests=4, extra=np.repeat(rng.standard_normal(4), 40) * programme(4))
    fit = refit(system, system.start(), white(system))
    wanted = np.mean([left_out(system, k, 40) for k in range(4)])
    assert left_out_error(fit, white(system)) == pytest.approx(wanted, rel=1e-6)


def test_cycles_are_left_out_with_their_test():
    """Two series of one test leave together."""
    system = elastic(np.random.default_rng(11), tests=3)
    system.series = [replace(one, test=name) for one, name in zip(system.series, ("a", "a", "b"), strict=True)]
    y, wanted = measured_rows(system.series), []
    for kept, parts in ((slice(80, 120), (slice(0, 40), slice(40, 80))), (slice(0, 80), (slice(80, 120),))):
        left = y - system.X @ np.linalg.lstsq(system.X[kept], y[kept], rcond=None)[0]
        wanted += [np.sqrt(np.mean(left[part] ** 2)) / np.abs(y[part]).max() for part in parts]
    assert left_out_error(refit(system, system.start(), white(system)), white(system)) == pytest.approx(np.mean(wanted), rel=1e-6)


# ---- searches that stop before they arrive ----

# Waves of any number in a ramp.
WAVES = {"wave": Planted(lambda n: np.sin(2.0 * np.pi * n * programme(3)), {"size": UPWARD, "n": Sought((1.0,), 0.5, 6.0)})}


def test_a_search_that_stopped_on_its_way_goes_on():
    """Rough answers allow eight steps, which are too few. The search goes on where it stopped, to the noise of 120 rows."""
    wave = 0.1 * np.sin(2.0 * np.pi * 1.4 * programme(3))
    system = elastic(np.random.default_rng(1), effects=WAVES, extra=wave, smooth=False)
    fit = refit(system, system.start(), white(system))
    (candidate,) = system.candidates(fit.model)
    once = refit(system, fit.model.plus(candidate.term, (0.1, 1.0)), white(system))
    assert not once.converged
    arrived = settled(system, once, white(system))
    assert arrived.converged and arrived.chi2 < 2.0 * 120 < once.chi2
    assert settled(system, arrived, white(system)) is arrived
