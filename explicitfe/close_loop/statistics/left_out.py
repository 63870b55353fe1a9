"""How well a model foretells tests that it was not fitted to, and whether one model does so better than another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from explicitfe.close_loop.statistics.covariance import Covariance, measured_rows
from explicitfe.close_loop.statistics.refit import UNSEEN_SHARE, BestFit, step_inside_bounds
from explicitfe.close_loop.statistics.system import System
from explicitfe.close_loop.thresholds import THRESHOLDS

# Test -> what a model leaves (m,) SI of its rows, with parameters from the other tests only.
Deviations = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Gain:
    """By how much a model foretells left-out tests better than another one.

    Attributes
    ----------
    chi2 : what the squares of the deviations fall by, over the covariance of their test.
    error : its standard error. The deviations of the two differ by D, to which the noise of a left-out test adds nothing, since
        neither model knows it. The gain is 2 r D - D D where r is what the first model leaves, so that noise of unit variance in
        r moves it by 2 |D|.
    """

    chi2: float
    error: float

    @property
    def none(self) -> bool:
        """Whether nobody would notice it.

        If the model is right the gain is |D|^2 on average, and -|D|^2 if there is no such effect, both with the same error 2 |D|:
        the gain is twice the logarithm of the odds between the two.
        """
        return self.chi2 <= THRESHOLDS.noticed_gain


def deviations(system: System, fit: BestFit, covariance: Covariance) -> Deviations:
    """What is left of each test where its parameters come from the other tests.

    The derivatives at the optimum give these parameters, because leaving one test out moves a good model little. A test whose
    constants no other one shares cannot be foretold and is not among them.
    """
    tests = list(dict.fromkeys(one.test for one in system.series))
    y = measured_rows(system.series)
    sd = np.concatenate([row.sd for row in covariance.rows])
    r = (y - fit.answer) / sd
    J = fit.slopes / sd[:, None]
    left = {}
    for test in tests:
        tested = covariance.rows_of(test)
        groups = {one.constants for one in system.series if one.test == test}
        others = {one.constants for one in system.series if one.test != test}
        if not groups <= others:
            continue
        free = np.linalg.norm(J[~tested], axis=0) > UNSEEN_SHARE * np.linalg.norm(J, axis=0)
        step = np.zeros(J.shape[1])
        step[free] = step_inside_bounds(J[~tested][:, free], r[~tested], fit.model, free)
        left[test] = ((r - J @ step) * sd)[tested]
    return left


def errors(system: System, left: Deviations) -> dict[str, float]:
    """Test -> rms deviation as a share of its curves' largest values, the mean over its series."""
    largest: dict[str, float] = {}
    for one in system.series:
        largest[one.curve] = max(largest.get(one.curve, 0.0), float(np.abs(one.measured).max()))
    means = {}
    for test, deviation in left.items():
        own = [one for one in system.series if one.test == test]
        parts = np.split(deviation, np.cumsum([len(one.measured) for one in own])[:-1])
        shares = [np.sqrt(np.mean(part**2)) / largest[one.curve] for one, part in zip(own, parts, strict=True)]
        means[test] = float(np.mean(shares))
    return means


def gain_of(covariance: Covariance, without: Deviations, within: Deviations) -> Gain:
    """By how much the deviations ``within`` a model are smaller than those ``without``, over the tests that both have."""
    chi2 = variance = 0.0
    for test in without:
        if test not in within:
            continue
        alone = covariance.of_test(test)
        r, other = alone.whiten(without[test]), alone.whiten(within[test])
        chi2 += float(r @ r - other @ other)
        variance += 4.0 * float((r - other) @ (r - other))
    return Gain(chi2, float(np.sqrt(variance)))
