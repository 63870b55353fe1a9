"""How much better one model foretells left-out tests than another, against noise of known size."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import ROWS, elastic, white

from explicitfe.close_loop.statistics.left_out import gain_of

TESTS, SEEDS = 3, 400


def gains(step: np.ndarray, true_share: float) -> np.ndarray:
    """(SEEDS, 2) gains and errors of a model that answers more by ``step`` (ROWS,), of which this share is really in the data."""
    system = elastic(np.random.default_rng(1), tests=TESTS)
    covariance = white(system, sd=1.0)
    rng = np.random.default_rng(2)
    rows = []
    for _ in range(SEEDS):
        without = {f"test-{k}": rng.standard_normal(ROWS) + true_share * step for k in range(TESTS)}
        gain = gain_of(covariance, without, {test: left - step for test, left in without.items()})
        rows.append((gain.chi2, gain.error))
    return np.array(rows)


@pytest.mark.parametrize("true_share", [0.0, 0.5, 1.0])
def test_the_error_of_a_gain_is_that_of_the_noise(true_share):
    """2 r D - D D with r = share D + noise: the mean (2 share - 1) D D with the standard deviation 2 |D|, which 400 draws know
    within 4 standard errors of 5 and 3.5 %.
    """
    step = 0.5 * np.sin(np.linspace(0.0, 6.0, ROWS))
    square = TESTS * float(step @ step)
    gain, error = gains(step, true_share).T
    np.testing.assert_allclose(error, 2.0 * np.sqrt(square), rtol=1e-12)
    assert gain.mean() == pytest.approx((2.0 * true_share - 1.0) * square, abs=4.0 * error[0] / np.sqrt(SEEDS))
    assert gain.std() == pytest.approx(error[0], rel=4.0 * 0.035)


def test_only_tests_that_both_models_foretell_count():
    system = elastic(np.random.default_rng(1), tests=TESTS)
    left = {"test-0": np.ones(ROWS), "test-1": np.ones(ROWS)}
    gain = gain_of(white(system, sd=1.0), left, {"test-1": np.zeros(ROWS)})
    assert gain.chi2 == pytest.approx(ROWS) and gain.error == pytest.approx(2.0 * np.sqrt(ROWS)) and not gain.none
