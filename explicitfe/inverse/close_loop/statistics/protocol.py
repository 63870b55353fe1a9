"""Estimated loading protocol: the noise-free course of a recorded imposed column, and its covariance.

A machine imposes ramps, holds, cycles, equal steps or a smooth motion, and the recorded column is this motion with independent
noise. A model that is driven by the noisy rows answers to a motion that never took place: effects that depend on the history
(backlash, lag, friction, relaxation) smooth the noise and so lower chi² without being present. A model must therefore be
driven by an estimate of the motion, and the error of this estimate is a systematic error of the answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import norm

from explicitfe.inverse.close_loop.statistics.noise import MEDIAN_OF_ABSOLUTE_NORMAL
from explicitfe.inverse.close_loop.statistics.polyline import (
    SMALLEST_DECREASE,
    corners_by_segments,
    fit_values,
    penalty_of_corner,
    prune,
    refine,
    tangent_basis,
)

Form = Literal["column", "polyline", "spline", "rows"]

# A fit whose chi2 has a smaller probability than this is rejected.
LEAST_PROBABILITY_OF_FIT = 1e-4
# Fits with more parameters than this share of the rows describe the noise: each row then stays free.
MOST_PARAMETERS_PER_ROW = 0.5
# Parameters of the largest spline, and corners of the longest polyline, that are computed.
MOST_SPLINE_PARAMETERS = 100
MOST_CORNERS = 200
# A spline gets so many times the intervals that its criterion chooses, so that its bias (of fourth order) is below its error.
MORE_INTERVALS = 1.5
# A stated noise is used to choose the form if the roughness of the column agrees with it within so many standard errors.
AGREEMENT_SDS = 3.0
# In fewer rows than this, deviations beyond the stated noise are unequal steps, each set on its own, rather than more noise.
FEWEST_ROWS_AGAINST_STATED_NOISE = 30
# An estimated noise that changes by less than this share is final.
SMALL_CHANGE_OF_NOISE = 0.1
# A corner between two rows of a column without noise is a knot if the column would miss it by so many times its tolerance.
CUT_CORNER_SDS = 3.0
# Noise below this share of the range of the column changes the answer by less than any load cell resolves: there is none.
LEAST_NOISE_RANGE_SHARE = 1e-5


@dataclass(frozen=True, eq=False)
class EstimatedProtocol:
    """Estimated noise-free course of the imposed column of one curve.

    The measured column is the answer to the true motion. The covariance of its rows about the answer to ``fitted`` is that of
    its own noise plus that of the estimate: with s (k,) the slope of the answer by the imposed value, add the columns
    ``s[:, None] * modes`` as systematic errors, and ``(s * row_sd)**2`` to the variances. The noise of the imposed rows about
    the estimate must not be added again: it did not act on the specimen, and it has been averaged out of the estimate.

    Attributes
    ----------
    form : "column" where the column has no noise, "polyline", "spline", or "rows" where neither describes it.
    time_s, values : (m,) knots and their values in SI, linear in between. A polyline has knots at its corners only, which lie
        between rows as well; the other forms have one at each row, and a column also at corners between rows.
    fitted : (k,) values at the rows.
    modes : (k, q) SI, columns with which the estimate is uncertain: the truth is fitted + modes @ z, with z standard normal.
    row_sd : independent standard deviation of each value of ``fitted``; 0 unless each row stays free ("rows").
    noise_sd : standard deviation of a row, as stated or else as estimated.
    estimated_sd : standard deviation of a row by the residual of the fit, or by the roughness of the column without a fit.
    chi2, free : sum of squares of the residual over ``noise_sd``, and its degrees of freedom; both 0 where there is no fit.
    """

    form: Form
    time_s: np.ndarray
    values: np.ndarray
    fitted: np.ndarray
    modes: np.ndarray
    row_sd: float
    noise_sd: float
    estimated_sd: float
    chi2: float
    free: int

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Imposed values (n,) SI at times (n,)."""
        return np.interp(time_s, self.time_s, self.values)

    @property
    def probability(self) -> float:
        """Probability that noise of ``noise_sd`` leaves a larger or a smaller chi2, two-sided; 1 where there is no fit."""
        if self.free == 0:
            return 1.0
        above = float(chi2_distribution.sf(self.chi2, self.free))
        return 2.0 * min(above, 1.0 - above)

    def with_noise(self, sd: float) -> EstimatedProtocol:
        """The same estimate with another standard deviation of the rows, such as ``estimated_sd``."""
        share = sd / self.noise_sd
        return replace(self, modes=share * self.modes, row_sd=share * self.row_sd, noise_sd=sd, chi2=self.chi2 / share**2)


def estimate_protocol(
    time_s: np.ndarray, imposed: np.ndarray, stated_sd: float | None = None, nominal: Mapping[str, object] | None = None
) -> EstimatedProtocol:
    """Estimate the noise-free course of an imposed column.

    The form is the simplest one that the noise allows, by the criterion of Schwarz (1978): a continuous polyline with free
    corners (two parameters a segment; segments by dynamic programming, Bellman & Roth 1969, then nonlinear least squares), or a
    cubic spline. If neither fits, the estimate is the column itself with an independent error in each row.

    Parameters
    ----------
    time_s : (k,) strictly increasing [s].
    imposed : (k,) SI.
    stated_sd : standard deviation of a row; None if it is unknown, 0 for a nominal protocol. If the roughness of the column
        contradicts it, the form is chosen with the roughness; see ``probability`` and ``with_noise``.
    nominal : conditions of the curve (``rate_per_s``, ``max_strain``, ``hold_s``). Their corners are used where the rows do not
        determine a corner, as in a step between two rows.
    """
    time_s, imposed, nominal = np.asarray(time_s, dtype=float), np.asarray(imposed, dtype=float), nominal or {}
    rough, error = _roughness(time_s, imposed)
    smallest = LEAST_NOISE_RANGE_SHARE * float(np.ptp(imposed))
    if len(time_s) < 3 or stated_sd == 0.0 or rough <= smallest:
        return _without_noise(time_s, imposed, smallest, rough, nominal)
    agrees = stated_sd is not None and abs(np.log(rough / stated_sd)) < AGREEMENT_SDS * error
    best = _best_fit(time_s, imposed, stated_sd, 0.0, nominal) if stated_sd and agrees else None
    if stated_sd is None or rough < stated_sd or len(time_s) >= FEWEST_ROWS_AGAINST_STATED_NOISE:
        best = best or _fit_of_unknown_noise(time_s, imposed, rough, error, nominal)
    if best is None and stated_sd and not agrees:  # The roughness of a few rows may be wrong.
        best = _best_fit(time_s, imposed, stated_sd, 0.0, nominal)
    if best is None:
        sd = rough if stated_sd is None else stated_sd
        return EstimatedProtocol("rows", time_s, imposed, imposed, np.zeros((len(time_s), 0)), sd, sd, rough, 0.0, 0)
    return best.with_noise(best.estimated_sd if stated_sd is None else stated_sd)


def _without_noise(
    time_s: np.ndarray, imposed: np.ndarray, tolerance: float, rough: float, nominal: Mapping[str, object]
) -> EstimatedProtocol:
    """The column itself, with the corners that lie between its rows if it is a polyline within a tolerance."""
    knots, values = time_s, imposed
    straight = _polyline(time_s, imposed / tolerance, 0.0, nominal, np.inf) if len(time_s) > 2 and tolerance > 0.0 else None
    if straight is not None and _describes(straight[1], imposed / tolerance, 0.0):
        corners = straight[1]
        cut = np.abs(tolerance * corners.values - np.interp(corners.time_s, time_s, imposed)) > CUT_CORNER_SDS * tolerance
        knots = np.concatenate([time_s, corners.time_s[cut]])
        order = np.argsort(knots)
        knots, values = knots[order], np.concatenate([imposed, tolerance * corners.values[cut]])[order]
    return EstimatedProtocol("column", knots, values, imposed, np.zeros((len(time_s), 0)), 0.0, 0.0, rough, 0.0, 0)


def _fit_of_unknown_noise(
    time_s: np.ndarray, imposed: np.ndarray, rough: float, error: float, nominal: Mapping[str, object]
) -> EstimatedProtocol | None:
    """The best fit with the noise that its own residual shows; None if that exceeds the roughness (relative error given)."""
    sd, best = rough, None
    for _ in range(3):
        fit = _best_fit(time_s, imposed, sd, error, nominal)
        if fit is None or fit.estimated_sd > rough * np.exp(AGREEMENT_SDS * error):
            return best
        best, sd_before, sd = fit, sd, fit.estimated_sd
        if abs(sd / sd_before - 1.0) < SMALL_CHANGE_OF_NOISE:
            break
    return best


def _roughness(time_s: np.ndarray, imposed: np.ndarray) -> tuple[float, float]:
    """Noise of a row by differences from neighbouring rows, and its relative standard error.

    Rows may be unequally spaced. Corners are outliers, which a median ignores; curvature vanishes in the fourth difference.
    """
    estimates = []
    for order in (2, 4):
        if len(time_s) < order + 3:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(np.arange(len(time_s)), order + 1)
        t = time_s[windows]
        weights = 1.0 / np.prod(np.where(np.eye(order + 1, dtype=bool), 1.0, t[:, :, None] - t[:, None, :]), axis=2)
        weights /= np.linalg.norm(weights, axis=1)[:, None]
        estimates.append(float(np.median(np.abs((weights * imposed[windows]).sum(axis=1)))) / MEDIAN_OF_ABSOLUTE_NORMAL)
    # The relative standard error of a median of n absolute values is 1.17 / sqrt(n) (Rousseeuw & Croux 1993). Of neighbouring
    # differences about half are independent.
    return (min(estimates) if estimates else 0.0), 1.17 / np.sqrt(max(len(time_s) / 2.0, 1.0))


def _best_fit(
    time_s: np.ndarray, imposed: np.ndarray, sd: float, sd_error: float, nominal: Mapping[str, object]
) -> EstimatedProtocol | None:
    """The polyline or spline of the smallest criterion, given the noise and its relative error; None if neither fits."""
    y = imposed / sd
    smooth = _spline(time_s, y)
    straight = _polyline(time_s, y, sd_error, nominal, np.inf if smooth is None else smooth[0])
    for _, fit in sorted((fit for fit in (smooth, straight) if fit is not None), key=lambda one: one[0]):
        if _describes(fit, y, sd_error):
            estimated = sd * float(np.sqrt(fit.chi2 / fit.free))
            values, fitted, modes = sd * fit.values, sd * fit.fitted, sd * fit.modes
            return replace(fit, values=values, fitted=fitted, modes=modes, noise_sd=sd, estimated_sd=estimated)
    return None


def _describes(fit: EstimatedProtocol, y: np.ndarray, sd_error: float) -> bool:
    """Whether the residual is white (ratio of von Neumann 1941), and no larger than the noise."""
    residual = y - fit.fitted
    square = max(float(residual @ residual), 1e-300)
    ratio = float((np.diff(residual) ** 2).sum()) / (2.0 * square) - 1.0
    if norm.cdf(ratio * np.sqrt(len(y))) < LEAST_PROBABILITY_OF_FIT:
        return False
    return _is_noise(fit.chi2, fit.free, sd_error)


def _is_noise(chi2: float, free: int, sd_error: float) -> bool:
    """Whether noise, of which the relative error of the standard deviation is given, explains a chi2."""
    return float(chi2_distribution.sf(chi2 * np.exp(-2.0 * AGREEMENT_SDS * sd_error), free)) > LEAST_PROBABILITY_OF_FIT


def _in_units_of_noise(
    form: Form, time_s: np.ndarray, values: np.ndarray, fitted: np.ndarray, y: np.ndarray, modes: np.ndarray
) -> EstimatedProtocol:
    """A fit to y (k,) of unit noise, with an orthonormal basis (k, q) of the changes of the rows by its parameters.

    The covariance of the fitted rows is the projector on these changes.
    """
    free = max(len(y) - modes.shape[1], 1)
    return EstimatedProtocol(form, time_s, values, fitted, modes, 0.0, 1.0, 1.0, float(((y - fitted) ** 2).sum()), free)


def _spline(time_s: np.ndarray, y: np.ndarray) -> tuple[float, EstimatedProtocol] | None:
    """The smallest criterion of a cubic spline with knots after equal numbers of rows, and one with half as many knots more."""
    k, counts = len(y), [1]
    while int(MORE_INTERVALS * counts[-1]) + 3 <= min(MOST_PARAMETERS_PER_ROW * k, MOST_SPLINE_PARAMETERS):
        counts.append(counts[-1] + max(1, counts[-1] // 4))

    def knots_of(count: int) -> np.ndarray:
        inner = np.interp(np.arange(1, count) / count * (k - 1), np.arange(k), time_s)
        return np.concatenate([np.full(4, time_s[0]), inner, np.full(4, time_s[-1])])

    def criterion(count: int) -> float:
        fitted = make_lsq_spline(time_s, y, knots_of(count), k=3)(time_s)
        return float(((y - fitted) ** 2).sum()) + (count + 3) * float(np.log(k))

    if len(counts) == 1:
        return None
    best, count = min((criterion(count), count) for count in counts[:-1])
    knots = knots_of(int(MORE_INTERVALS * count))
    fitted = make_lsq_spline(time_s, y, knots, k=3)(time_s)
    basis, _ = np.linalg.qr(BSpline.design_matrix(time_s, knots, 3).toarray())
    return best, _in_units_of_noise("spline", time_s, fitted, fitted, y, basis)


def _polyline(
    time_s: np.ndarray, y: np.ndarray, sd_error: float, nominal: Mapping[str, object], rival: float
) -> tuple[float, EstimatedProtocol] | None:
    """The smallest criterion of a continuous polyline, and the polyline; None if a rival's criterion is smaller."""
    penalty = penalty_of_corner(len(y))
    bound, by_segments = corners_by_segments(time_s, y)
    if bound > rival or len(by_segments) > min(MOST_CORNERS, len(y) - 2):
        return None
    suggested = _nominal_corners(time_s, nominal)
    starts = [by_segments, suggested] if len(suggested) else [by_segments]
    refined = [refine(time_s, y, start) for start in starts]
    free = max(len(y) - 2 * len(refined[0][1]) - 2, 1)
    if not _is_noise(refined[0][0], free, sd_error):  # Fewer corners fit even less.
        return None
    polylines = [prune(time_s, y, one) for one in refined]
    criteria = [chi2 + (len(corners) + 1) * penalty for chi2, corners in polylines]
    # The nominal corners win if they are as good: a step between two rows has no time of its own.
    best = len(criteria) - 1 if criteria[-1] < min(criteria) + SMALLEST_DECREASE * len(y) else int(np.argmin(criteria))
    knots, values, fitted = fit_values(time_s, y, polylines[best][1])
    if 2 * len(knots) - 2 > MOST_PARAMETERS_PER_ROW * len(y):
        return None
    return criteria[best], _in_units_of_noise("polyline", knots, values, fitted, y, tangent_basis(time_s, knots))


def _nominal_corners(time_s: np.ndarray, nominal: Mapping[str, object]) -> np.ndarray:
    """Corners of a ramp, hold and return at the nominal rate."""
    rate, largest, hold = (
        float(value) if isinstance(value, int | float) and not isinstance(value, bool) else 0.0
        for value in (nominal.get(key) for key in ("rate_per_s", "max_strain", "hold_s"))
    )
    if rate <= 0.0 or largest <= 0.0:
        return np.zeros(0)
    ramp = largest / rate
    corners = time_s[0] + np.array([ramp, ramp + hold, 2.0 * ramp + hold] if hold > 0.0 else [ramp, 2.0 * ramp])
    return corners[(corners > time_s[0]) & (corners < time_s[-1])]
