"""Least squares: the constants come back, the covariance is the curvature, profiles are right, bounds are said."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from identify_cases import LOADS_N, TRUTH, response

from explicitfe.inverse.identify.fit import NAMES, Problem, least_squares_fit, profile_curve
from explicitfe.inverse.identify.forward import CurveModel, PointResponse
from explicitfe.inverse.identify.laws import FIT_LAWS
from explicitfe.inverse.identify.observed import Observed

NOISE_M = 10e-6


@dataclass(frozen=True)
class Linear:
    """A model that is linear in its constants: y = C10 x + C20 x^2."""

    by_force: bool = False

    @property
    def response(self):
        return self

    def __call__(self, x, C10, C20):
        return C10 * x + C20 * x**2

    def with_slope(self, x, C10, C20):
        return self(x, C10, C20), C10 + 2.0 * C20 * x


def line(seed: int, sd: float | None = 0.1, truth=(2.0, 1.0), rows: int = 12) -> Observed:
    x = np.linspace(0.2, 2.0, rows)
    noise = 0.1 * np.random.default_rng(seed).standard_normal(rows)
    return Observed("line", x, Linear()(x, *truth) + noise, 0.0, sd, Linear())


def pressed(constants=TRUTH, sd=NOISE_M) -> Observed:
    model = CurveModel(response(), by_force=True)
    return Observed("simulated", LOADS_N, model(LOADS_N, *constants), 0.0, sd, model)


def test_exact_data_give_the_constants_back():
    fit = least_squares_fit([pressed()])
    assert fit.constants == pytest.approx(TRUTH, rel=1e-6)
    assert fit.chi2 < 1e-9
    assert fit.at_bound == ()


def test_linear_problem_has_its_closed_form():
    """Estimate (X^T X)^-1 X^T y, covariance sd^2 (X^T X)^-1, and the profile is the parabola, to the derivatives' accuracy."""
    seen = line(1)
    X = np.stack([seen.imposed, seen.imposed**2], axis=1)
    fit = least_squares_fit([seen], np.array([1.0, 1.0]))
    assert fit.constants == pytest.approx(np.linalg.solve(X.T @ X, X.T @ seen.measured), rel=1e-6)
    assert fit.covariance == pytest.approx(0.01 * np.linalg.inv(X.T @ X), rel=1e-6)
    for name in NAMES:
        assert fit.profile[name] == pytest.approx(fit.curvature[name], rel=1e-4)
    values = fit.constants[0] + fit.sd[0] * np.array([-2.0, 1.0])
    assert profile_curve([seen], fit, 0, values) == pytest.approx([4.0, 1.0], rel=1e-4)


def test_covariance_is_the_inverse_of_half_the_hessian_of_chi2():
    """At exact data the Gauss-Newton curvature is the whole: chi2 by second differences, over 1e-3 of a constant."""
    seen = pressed()
    fit = least_squares_fit([seen], profile=False)
    problem = Problem([seen], fit.sds)
    h = 1e-3 * fit.constants
    hessian = np.empty((2, 2))
    for i in range(2):
        for j in range(2):
            terms = [
                a * b * problem.chi2(fit.constants + a * h * np.eye(2)[i] + b * h * np.eye(2)[j])
                for a in (-1.0, 1.0)
                for b in (-1.0, 1.0)
            ]
            hessian[i, j] = sum(terms) / (4.0 * h[i] * h[j])
    assert np.linalg.inv(0.5 * hessian) == pytest.approx(fit.covariance, rel=1e-2)


def test_rows_that_err_in_force_count_by_the_slope():
    """sigma^2 = sigma_d^2 + (du/dF)^2 sigma_F^2."""
    seen = pressed()
    both = Observed("simulated", LOADS_N, seen.measured, 0.002, NOISE_M, seen.model)
    slope = response().at_force(LOADS_N, *TRUTH)[1]
    fit = least_squares_fit([both], profile=False)
    assert fit.sds[0] == pytest.approx(np.hypot(NOISE_M, 0.002 * slope), rel=1e-4)


def test_intervals_cover():
    """Linear problem, 400 seeds: 95 % intervals hold the truth in 95 +- 3.3 % (three binomial sds)."""
    hits = np.zeros((2, 2))
    for seed in range(400):
        fit = least_squares_fit([line(seed, sd=None if seed % 2 else 0.1)], np.array([2.0, 1.0]), profile=False)
        low, high = np.array([fit.curvature[name] for name in NAMES]).T
        hits[seed % 2] += (low <= [2.0, 1.0]) & (high >= [2.0, 1.0])
    assert (np.abs(hits / 200.0 - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 200.0)).all()


def test_intervals_cover_where_neighbouring_rows_err_alike():
    """Noise of a correlation of 0.9 from row to row: intervals that count it as independent hold the truth in less than half of
    all cases; as wide as the residual asks for they hold it in about nine of ten, the correlation being known from 200 rows only.
    """
    seeds, hits, narrow = 120, np.zeros(2), np.zeros(2)
    for seed in range(seeds):
        random = np.random.default_rng(seed)
        noise = random.normal(0.0, 0.05, 200)
        for k in range(1, 200):
            noise[k] = 0.9 * noise[k - 1] + np.sqrt(1.0 - 0.9**2) * noise[k]
        seen = line(seed, sd=0.05, rows=200)
        seen = replace(seen, measured=seen.model(seen.imposed, 2.0, 1.0) + noise)
        fit = least_squares_fit([seen], np.array([2.0, 1.0]), profile=False)
        error = np.abs(fit.constants - [2.0, 1.0])
        narrow += error <= 1.96 * fit.sd
        hits += error <= 1.96 * fit.widening.factor * fit.sd
    assert (narrow / seeds < 0.5).all() and (hits / seeds > 0.85).all()


def test_nothing_is_widened_where_noise_is_as_stated():
    """Chance asks for it in one fit of a hundred; in more than four of 100 seeds it would be a fault (p < 0.004)."""
    factors = [
        least_squares_fit([line(seed, rows=60)], np.array([2.0, 1.0]), profile=False).widening.factor for seed in range(100)
    ]
    assert sum(factor != 1.0 for factor in factors) <= 4


def test_a_widened_interval_is_so_many_times_as_wide():
    """Noise of three times what is stated, in a linear problem: both ends are three times as far away, or so.

    The misfit of 58 degrees of freedom scatters by 9 %, so that two standard deviations are allowed.
    """
    seen = line(4, sd=0.1, rows=60)
    fit = least_squares_fit([replace(seen, measured_sd=0.1 / 3.0)], np.array([2.0, 1.0]))
    assert fit.widening.misfit == pytest.approx(3.0, rel=0.2) and fit.widening.correlation == 0.0
    for name in NAMES:
        own, of_noise = np.ptp(fit.profile[name]), np.ptp(fit.profile_of_noise[name])
        assert own == pytest.approx(fit.widening.factor * of_noise, rel=1e-4)


def test_unknown_noise_is_that_of_the_residual():
    fit = least_squares_fit([line(3, sd=None, rows=400)], np.array([2.0, 1.0]))
    assert fit.noise_estimated
    assert fit.sds[0][0] == pytest.approx(0.1, rel=0.15)
    assert fit.profile["C10_Pa"] == pytest.approx(fit.curvature["C10_Pa"], rel=1e-4)


def test_bound_is_told_and_its_interval_one_sided():
    """Data that soften: C20 = 0 is the best that is allowed, and C10 is what it is without C20."""
    seen = line(5, truth=(2.0, -0.3))
    fit = least_squares_fit([seen], np.array([2.0, 0.5]))
    assert fit.at_bound == ("C20_Pa",)
    assert fit.constants[1] == 0.0
    assert fit.constants[0] == pytest.approx(seen.imposed @ seen.measured / (seen.imposed @ seen.imposed), rel=1e-6)
    assert fit.profile["C20_Pa"][0] == 0.0
    assert fit.profile["C20_Pa"][1] > 0.0
    assert fit.correlation is None


def test_fit_of_homogeneous_curves():
    """Shear and compression of one material together."""
    curves = []
    for kind, x in (("uniaxial", np.linspace(0.7, 0.98, 8)), ("shear", np.linspace(0.05, 0.6, 8))):
        model = CurveModel(PointResponse(kind, 0.499))
        curves.append(Observed(kind, x, model(x, *TRUTH), 0.0, 1.0, model))
    fit = least_squares_fit(curves)
    assert fit.constants == pytest.approx(TRUTH, rel=1e-6)
    assert fit.profile["C20_Pa"][0] < TRUTH[1] < fit.profile["C20_Pa"][1]


def test_constants_whose_forces_differ_by_many_orders_are_found() -> None:
    """At a stretch of 17 a unit of C30 is a stress 80 000 times that of C10."""
    law = FIT_LAWS["yeoh-3"]
    stretch = np.linspace(1.0, 17.0, 12)
    model = CurveModel(PointResponse("uniaxial", 0.499, law))
    truth = (1e4, 20.0, 0.05)
    observed = Observed("one", stretch, model(stretch, *truth), None, None, model)
    fit = least_squares_fit([observed], law=law.of_any_sign(), profile=False)
    np.testing.assert_allclose(fit.constants, truth, rtol=1e-6)
