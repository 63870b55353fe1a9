"""95 % intervals of fitted parameters: from the curvature, and from what is left unexplained."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows
from explicitfe.inverse.close_loop.statistics.refit import UNSEEN_SHARE, BestFit, step_inside_bounds

QUANTILE_OF_95_PER_CENT = 0.975
# Where there are fewer tests, each curve is left out in so many parts, one after the other.
FEWEST_TESTS = 3
PARTS_OF_A_CURVE = 4


def intervals(fit: BestFit, covariance: Covariance, worse: float = 1.0) -> list[tuple[float, float]]:
    """95 % intervals of the values, from the curvature at the optimum.

    Where the misfit is gross the model was fitted by the noise of the rows alone.

    Parameters
    ----------
    covariance : the one that the model was fitted with.
    worse : multiplies the unit of chi2.
    """
    return _limits(fit, _by_curvature(fit, covariance, worse))


def intervals_beside_a_misfit(
    fit: BestFit, covariance: Covariance, worse: float, others: Iterable[BestFit]
) -> list[tuple[float, float]]:
    """95 % intervals of the values of a model that leaves more than noise.

    A misfit is no noise: it moves the parameters of all rows alike. So the data are asked themselves: parameters are found again
    without each of the tests, or without parts of the curves where there are few, and scatter (delete-a-group jackknife; Shao &
    Tu 1995). And other models explain the misfit in other ways, with other constants: as long as nothing speaks for one
    of them, the constants of the baseline may be those of each.

    Parameters
    ----------
    covariance, worse : as for :func:`intervals`.
    others : models with one effect more, at their best, that the data do not reject.
    """
    limits = _limits(fit, np.maximum(_by_curvature(fit, covariance, worse), _by_leaving_out(fit, covariance)))
    return widened(limits, fit, others, covariance)


def widened(
    limits: list[tuple[float, float]], fit: BestFit, others: Iterable[BestFit], covariance: Covariance
) -> list[tuple[float, float]]:
    """Intervals whose first ones, those of the baseline's constants, hold those of other models too."""
    for other in others:
        own = intervals(other, covariance)
        for k in range(len(fit.model.base)):
            limits[k] = min(limits[k][0], own[k][0]), max(limits[k][1], own[k][1])
    return limits


def _limits(fit: BestFit, half: np.ndarray) -> list[tuple[float, float]]:
    """The values at both ends of intervals of a half width (p,) in the coordinates."""
    limits = []
    for k, p in enumerate(fit.model.parameters):
        ends = np.clip([fit.model.x[k] - half[k], fit.model.x[k] + half[k]], p.low, p.high)
        low, high = (p.sought.value(float(x)) for x in ends)
        limits.append((min(low, high), max(low, high)))
    return limits


def _by_curvature(fit: BestFit, covariance: Covariance, worse: float) -> np.ndarray:
    """Half the width (p,) of the intervals of the coordinates."""
    gross = fit.by_rows is not None
    J = covariance.by_rows(fit.slopes) if gross else fit.jacobian
    size = np.linalg.norm(J, axis=0)
    shown = size > 0.0
    unit = J[:, shown] / size[shown]
    inverse = np.linalg.pinv(unit.T @ unit, rcond=1e-12)
    each = worse * np.diag(inverse)
    if gross:
        each = each + np.sum((inverse @ (unit.T @ covariance.at(fit.answer).shared)) ** 2, axis=1)
    variance = np.full(len(size), np.inf)  # where the data do not depend on a parameter
    variance[shown] = each / size[shown] ** 2
    return float(norm.ppf(QUANTILE_OF_95_PER_CENT)) * np.sqrt(variance)


def _by_leaving_out(fit: BestFit, covariance: Covariance) -> np.ndarray:
    """Half the width (p,) of the intervals of the coordinates, by a jackknife over tests or over parts of the curves.

    The derivatives at the optimum give the parameters without a part.
    """
    sd = np.concatenate([row.weight_sd for row in covariance.rows])
    r = (measured_rows(covariance.series) - fit.answer) / sd
    J = fit.slopes / sd[:, None]
    size = np.linalg.norm(J, axis=0)
    steps = []
    for part in _parts(covariance):
        kept = J[~part]
        free = np.linalg.norm(kept, axis=0) > UNSEEN_SHARE * size
        step = np.zeros(len(size))
        step[free] = step_inside_bounds(kept[:, free], r[~part], fit.model, free)
        steps.append(step)
    count = len(steps)
    variance = (count - 1.0) ** 2 / count * np.var(steps, axis=0, ddof=1)
    return float(student.ppf(QUANTILE_OF_95_PER_CENT, count - 1)) * np.sqrt(variance)


def _parts(covariance: Covariance) -> Sequence[np.ndarray]:
    """The rows (n,) of each part that is left out in turn."""
    tests = list(dict.fromkeys(one.test for one in covariance.series))
    if len(tests) >= FEWEST_TESTS:
        return [covariance.rows_of(test) for test in tests]
    parts = []
    for rows in covariance.slices():
        for piece in np.array_split(np.arange(rows.start, rows.stop), PARTS_OF_A_CURVE):
            part = np.zeros(covariance.slices()[-1].stop, dtype=bool)
            part[piece] = True
            parts.append(part)
    return parts


def left_out_error(fit: BestFit, covariance: Covariance) -> float:
    """Mean rms error of tests that are left out in turn, as a share of each curve's largest value.

    The parameters without a test come from the derivatives at the optimum.
    """
    sd = np.concatenate([row.weight_sd for row in covariance.rows])
    y = measured_rows(covariance.series)
    r, J = (y - fit.answer) / sd, fit.slopes / sd[:, None]
    errors = []
    for test in dict.fromkeys(one.test for one in covariance.series):
        out = covariance.rows_of(test)
        free = np.linalg.norm(J[~out], axis=0) > UNSEEN_SHARE * np.linalg.norm(J, axis=0)
        step = np.zeros(J.shape[1])
        step[free] = step_inside_bounds(J[~out][:, free], r[~out], fit.model, free)
        left = y - fit.answer - fit.slopes @ step
        parts = zip(covariance.series, covariance.slices(), strict=True)
        errors += [np.sqrt(np.mean(left[p] ** 2)) / np.abs(one.measured).max() for one, p in parts if one.test == test]
    return float(np.mean(errors))
