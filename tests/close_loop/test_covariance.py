"""Whitening by the covariance, against its dense matrix."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import ramp

from explicitfe.inverse.close_loop.statistics.covariance import Covariance
from explicitfe.inverse.close_loop.statistics.noise import RowNoise, Scatter

SIZES = (9, 14, 6)


def covariance_with(scale: float = 0.05, offset: float = 0.02, floors: bool = True, correlation: float = 0.7) -> Covariance:
    rng = np.random.default_rng(11)
    # the last two are cycles of one test
    series = [ramp(k, rng.standard_normal(n) + 3.0, sd=0.1, test=f"t{min(k, 1)}") for k, n in enumerate(SIZES)]
    rows = [RowNoise(rng.uniform(0.05, 0.2, n), correlation, True) for n in SIZES]
    changes = {name: 0.1 * rng.standard_normal(sum(SIZES)) for name in ("mesh", "steps")} if floors else {}
    return Covariance(series, rows, Scatter(scale, offset, "stated", 0), changes)


def dense(covariance: Covariance) -> np.ndarray:
    """Sigma, entry by entry."""
    total = sum(SIZES)
    sigma = np.zeros((total, total))
    tests = np.concatenate([np.full(n, min(k, 1)) for k, n in enumerate(SIZES)])
    sizes = np.concatenate([one.measured for one in covariance.series])
    largest = np.concatenate([np.full(n, np.abs(one.measured).max()) for one, n in zip(covariance.series, SIZES, strict=True)])
    start = 0
    for row, n in zip(covariance.rows, SIZES, strict=True):
        # independent rows that say as much about anything smooth: times 1 + 2 r + 2 r^2 + ... = (1 + r) / (1 - r)
        more = (1.0 + row.correlation) / (1.0 - row.correlation)
        sigma[start : start + n, start : start + n] = np.diag(more * row.sd**2)
        start += n
    same = tests[:, None] == tests
    sigma += same * covariance.scatter.scale**2 * sizes[:, None] * sizes
    sigma += same * covariance.scatter.offset**2 * largest[:, None] * largest
    return sigma + sum(np.outer(d, d) for d in covariance.floors.values())


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"scale": 0.0},
        {"offset": 0.0},
        {"floors": False},
        {"scale": 0.0, "offset": 0.0, "floors": False},
        {"correlation": 0.0},
    ],
)
def test_norms_and_inner_products(how):
    """a . Sigma^-1 b by Cholesky. The numbers are of size 1e4 and the condition below 1e6: rounding is 1e-10 of the largest."""
    covariance = covariance_with(**how)
    columns = np.random.default_rng(12).standard_normal((sum(SIZES), 5))
    L = np.linalg.cholesky(dense(covariance))
    wanted = np.linalg.solve(L, columns)
    white = covariance.whiten(columns)
    np.testing.assert_allclose(white.T @ white, wanted.T @ wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted.T @ wanted).max())
    one = covariance.whiten(columns[:, 2])
    np.testing.assert_allclose(one, white[:, 2], rtol=0.0, atol=1e-12 * np.abs(one).max())


def test_what_has_the_covariance_becomes_white():
    """Whitened, its own square root has orthonormal rows: W Sigma W^T = 1."""
    covariance = covariance_with()
    W = covariance.whiten(np.eye(sum(SIZES)))
    np.testing.assert_allclose(W @ dense(covariance) @ W.T, np.eye(sum(SIZES)), atol=1e-9)


def test_numbers_for_reports():
    """n (1 - r) / (1 + r) rows; a floor of rows and numerics, without scatter; rows alone."""
    covariance = covariance_with()
    assert covariance.effective == pytest.approx(sum(SIZES) * 0.3 / 1.7)
    part = covariance.slices()[1]
    assert part == slice(9, 23)
    wanted = np.mean(covariance.rows[1].sd ** 2) + sum(np.mean(d[part] ** 2) for d in covariance.floors.values())
    nothing = np.zeros((sum(SIZES), 0))
    assert covariance.floor_of(1, nothing) == pytest.approx(np.sqrt(wanted))
    imitated = np.column_stack([3.0 * d for d in covariance.floors.values()])  # what constants can do is no floor
    assert covariance.floor_of(1, imitated) == pytest.approx(np.sqrt(np.mean(covariance.rows[1].sd ** 2)))
    alone = covariance_with(scale=0.0, offset=0.0, floors=False)
    column = np.random.default_rng(13).standard_normal(sum(SIZES))
    np.testing.assert_allclose(covariance.by_rows(column[:, None])[:, 0], alone.whiten(column), atol=1e-12)


def test_correlated_rows_weigh_as_much_as_they_say_about_something_smooth():
    """The variance of the mean of n AR(1) rows is sd^2 (1 + r) / (1 - r) / n, but for ends that count as 2 r / (n (1 - r^2))."""
    n, r = 400, 0.8
    place = np.arange(n)
    truth = (r ** np.abs(place[:, None] - place)).mean()
    assert RowNoise(np.ones(n), r, True).weight_sd[0] ** 2 / n == pytest.approx(truth, rel=2.5 * r / (n * (1.0 - r**2)) + 1e-12)


def test_the_scale_of_a_test_multiplies_what_a_model_answers():
    """A model that answers nothing is off by all there is, however large the scale may be."""
    covariance = covariance_with(scale=0.5, offset=0.0, floors=False)
    y = np.concatenate([one.measured for one in covariance.series])
    rows = np.concatenate([row.weight_sd for row in covariance.rows])
    nothing = covariance.at(np.zeros(len(y))).whiten(y)
    np.testing.assert_allclose(nothing @ nothing, ((y / rows) ** 2).sum(), rtol=1e-12)
    tenth = covariance.at(y / 1.1)
    assert tenth.whiten(y - y / 1.1) @ tenth.whiten(y - y / 1.1) < 0.1
    double = covariance.at(2.0 * y)
    assert double.whiten(y) @ double.whiten(y) > tenth.whiten(y) @ tenth.whiten(y)  # answering too much is no way out either


def test_slopes_with_the_scale_of_tests_are_those_of_chi2():
    """d chi2 = -2 r J dx, by central differences of 1e-5 whose own error is 1e-10 of the third derivative."""
    covariance = covariance_with(scale=0.1, offset=0.02, floors=True)
    y = np.concatenate([one.measured for one in covariance.series])
    answer, slopes = 0.8 * y + 0.05, np.column_stack([y, np.cos(np.arange(len(y)))])

    def chi2(step: np.ndarray) -> float:
        r = covariance.at(answer + slopes @ step).whiten(y - answer - slopes @ step)
        return float(r @ r)

    local = covariance.at(answer)
    wanted = -2.0 * local.whiten(y - answer) @ local.whiten(local.scaled_slopes(y - answer, slopes))
    numeric = [(chi2(1e-5 * e) - chi2(-1e-5 * e)) / 2e-5 for e in np.eye(2)]
    np.testing.assert_allclose(numeric, wanted, rtol=1e-5)
