"""Weighted least squares of two constants, with intervals from the curvature at the optimum and from the profile likelihood.

Intervals from the noise alone are kept beside those that count what the residual shows (widening.py): quote the latter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import t as student

from explicitfe.errors import RunError
from explicitfe.identify.forward import CurveModel
from explicitfe.identify.widening import Widening, widening_of

NAMES = ("C10_Pa", "C20_Pa")
CONFIDENCE_LEVEL = 0.95
SMALLEST_C10_PA = 1e-3  # C10 must be above 0.
DERIVATIVE_STEP_SHARE = 1e-4  # Derivatives are central differences over this share of a constant.
# The fit is repeated at most so often: weights count errors of the imposed column by the model's slope, which the fit changes.
MOST_PASSES = 4
# The weights are settled when a pass moves no constant by more than this share of C10.
SETTLED_C10_SHARE = 1e-7
# The fit begins with the best of these ratios C20 / (C10 + C20).
FIRST_RATIOS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
# No row is exact: at zero force, where the slope is zero, a row would have infinite weight. Its noise is at least this share
# of the median.
LEAST_ROW_NOISE_SHARE = 1e-3

# The end of a profile interval is sought farther and farther out, by this factor each time; after so many times it is infinite.
WIDENING_FACTOR = 1.5
MOST_WIDENINGS = 12

ConstantsLike = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Observed:
    """Rows of one curve that are fitted or predicted.

    Attributes
    ----------
    id : of the curve.
    imposed, measured : (k,) SI.
    imposed_sd, measured_sd : noise of one row; None where it is unknown.
    model : it predicts ``measured`` from ``imposed``.
    """

    id: str
    imposed: np.ndarray
    measured: np.ndarray
    imposed_sd: float | None
    measured_sd: float | None
    model: CurveModel

    @property
    def noise_known(self) -> bool:
        """Whether the dataset states a noise other than zero."""
        return (self.imposed_sd or 0.0) > 0.0 or (self.measured_sd or 0.0) > 0.0

    def predicted(self, constants: ConstantsLike) -> np.ndarray:
        """What the model says (k,)."""
        return self.model(self.imposed, *map(float, constants))

    def sd(self, constants: ConstantsLike) -> np.ndarray:
        """Standard deviation of measured - predicted (k,), the imposed column's own error included."""
        slope = self.model.with_slope(self.imposed, *map(float, constants))[1]
        return np.hypot(self.measured_sd or 0.0, slope * (self.imposed_sd or 0.0))

    def errors(self, constants: ConstantsLike) -> dict[str, float]:
        """rmse in the unit of the measured column, and over its largest magnitude; the largest deviation."""
        residual = self.predicted(constants) - self.measured
        rmse = float(np.sqrt(np.mean(residual**2)))
        return {
            "rmse": rmse,
            "nrmse": rmse / float(np.abs(self.measured).max()),
            "largest": float(np.abs(residual).max()),
        }


@dataclass(frozen=True)
class Fit:
    """Constants that fit, and how well they are known.

    Attributes
    ----------
    constants : (2,) C10, C20 [Pa].
    covariance : (2, 2) Pa^2, from the curvature; of C10 alone where C20 is at its bound.
    curvature, profile_of_noise : name -> (low, high) Pa, 95 %, from independent noise alone.
    profile : the same from the profile likelihood, with what the residual shows beyond such noise.
    widening : by how much it makes intervals wider, and why.
    at_bound : names of constants that ended at a bound.
    chi2, count : weighted sum of squares and rows; with the noise unknown chi2 is in units of the estimated noise.
    noise_estimated : the dataset does not state the noise; it is estimated from the residual.
    sds : standard deviations of the rows, one array a curve.
    """

    constants: np.ndarray
    covariance: np.ndarray
    curvature: dict[str, tuple[float, float]]
    profile_of_noise: dict[str, tuple[float, float]]
    profile: dict[str, tuple[float, float]]
    widening: Widening
    at_bound: tuple[str, ...]
    chi2: float
    count: int
    noise_estimated: bool
    sds: tuple[np.ndarray, ...]

    @property
    def sd(self) -> np.ndarray:
        """Standard errors (2,) [Pa]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> float | None:
        """Correlation of C10 and C20; None where one is at its bound."""
        if self.at_bound:
            return None
        return float(self.covariance[0, 1] / np.sqrt(self.covariance[0, 0] * self.covariance[1, 1]))


class Problem:
    """The weighted residual of some curves that share their constants.

    Parameters
    ----------
    observed : the curves.
    sds : standard deviations of their rows.
    """

    def __init__(self, observed: Sequence[Observed], sds: Sequence[np.ndarray]) -> None:
        self.observed = observed
        self.sds = sds

    def residual(self, constants: ConstantsLike) -> np.ndarray:
        """(predicted - measured) / sd of all rows."""
        return np.concatenate([(o.predicted(constants) - o.measured) / s for o, s in zip(self.observed, self.sds, strict=True)])

    def chi2(self, constants: ConstantsLike) -> float:
        """Sum of squares of the residual."""
        return float((self.residual(constants) ** 2).sum())

    def jacobian(self, constants: np.ndarray) -> np.ndarray:
        """Derivatives of the residual (n, 2) 1/Pa, by central differences; by C20 from above where it is 0."""
        columns = []
        for k in range(2):
            share = DERIVATIVE_STEP_SHARE
            step = share * max(abs(constants[k]), share * constants[0], 1e-2 * constants[0] if constants[k] == 0.0 else 0.0)
            up, down = constants.copy(), constants.copy()
            up[k] += step
            down[k] = max(down[k] - step, 0.0 if k else SMALLEST_C10_PA)
            columns.append((self.residual(up) - self.residual(down)) / (up[k] - down[k]))
        return np.stack(columns, axis=1)

    def solve(self, start: np.ndarray) -> np.ndarray:
        """The best constants.

        Raises
        ------
        RunError : the optimiser did not find any; that says nothing about the model.
        """
        unit = max(float(start[0]), SMALLEST_C10_PA)
        solution = least_squares(
            lambda z: self.residual(unit * z),
            np.maximum(start / unit, [1e-6, 1e-9]),
            bounds=([SMALLEST_C10_PA / unit, 0.0], [np.inf, np.inf]),
            jac=lambda z: unit * self.jacobian(np.maximum(unit * z, [SMALLEST_C10_PA, 0.0])),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=200,
        )
        if solution.status <= 0 or not np.isfinite(solution.x).all():
            raise RunError(f"the optimiser gave up after {solution.nfev} evaluations; this says nothing about the model.")
        best = unit * solution.x
        # The solver stays strictly inside its bounds; the bound itself may be better, or as good.
        at_bound = np.array([self.best_other(1, 0.0, best[0]), 0.0])
        return at_bound if self.chi2(at_bound) <= self.chi2(best) * (1.0 + 1e-9) else best

    def best_other(self, fixed: int, value: float, start: float) -> float:
        """The best of one constant while the other one, number ``fixed``, is held."""

        def at(other: float) -> np.ndarray:
            return np.array([value, other]) if fixed == 0 else np.array([other, value])

        unit = max(abs(start), 1e-3 * abs(value), SMALLEST_C10_PA)
        low = 0.0 if fixed == 0 else SMALLEST_C10_PA
        solution = least_squares(
            lambda z: self.residual(at(unit * z[0])),
            [max(start, low + 1e-6 * unit) / unit],
            bounds=([low / unit], [np.inf]),
            jac="3-point",
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
        )
        other = unit * float(solution.x[0])
        if fixed == 0 and self.chi2(at(0.0)) <= self.chi2(at(other)):
            return 0.0
        return other

    def profiled(self, number: int, value: float, start: float) -> tuple[float, float]:
        """chi2 with one constant held and the other one at its best, and that one."""
        other = self.best_other(number, value, start)
        return self.chi2([value, other] if number == 0 else [other, value]), other


def start_of(observed: Sequence[Observed]) -> np.ndarray:
    """Constants to begin with: of a few ratios C20 / C10 the one whose scaled response misses the measured curves least."""
    least, constants = np.inf, np.array([1.0, 0.0])
    for q in FIRST_RATIOS:
        top = bottom = total = 0.0
        for o in observed:
            # Forces and stresses are proportional to the constants, whatever is imposed.
            x, y = (o.measured, o.imposed) if o.model.by_force else (o.imposed, o.measured)
            unit = CurveModel(o.model.response)(x, 1.0 - q, q)
            weight = 1.0 / max(float((y**2).sum()), 1e-300)
            top += weight * float(unit @ y)
            bottom += weight * float(unit @ unit)
            total += weight * float(y @ y)
        if bottom > 0.0 and top > 0.0 and total - top**2 / bottom < least:
            least, constants = total - top**2 / bottom, top / bottom * np.array([1.0 - q, q])
    return constants


def least_squares_fit(observed: Sequence[Observed], start: np.ndarray | None = None, *, profile: bool = True) -> Fit:
    """Fit C10 > 0 and C20 >= 0.

    Parameters
    ----------
    observed : curves that share the constants. Where one does not state its noise, every curve's rows weigh by the
        curve's largest value and the noise is estimated from the residual.
    start : constants to begin with; chosen by :func:`start_of` if left out.
    profile : whether intervals of the profile likelihood are computed; without them ``Fit.profile`` and its like are empty.

    Raises
    ------
    RunError : the optimiser failed.
    """
    estimated = not all(o.noise_known for o in observed)
    best = start_of(observed) if start is None else np.asarray(start, dtype=float)
    sds: list[np.ndarray] = []
    for _ in range(1 if estimated else MOST_PASSES):
        sds = [
            np.full(len(o.measured), np.abs(o.measured).max()) if estimated else _with_least_noise(o.sd(best)) for o in observed
        ]
        before, best = best, Problem(observed, sds).solve(best)
        if np.abs(best - before).max() < SETTLED_C10_SHARE * best[0]:
            break
    problem = Problem(observed, sds)
    count = sum(len(o.measured) for o in observed)
    if estimated:
        scale = np.sqrt(max(problem.chi2(best) / max(count - 2, 1), 1e-24))
        sds = [scale * s for s in sds]
        problem = Problem(observed, sds)
    at_bound = ("C20_Pa",) if best[1] == 0.0 else ()
    J = problem.jacobian(best)
    covariance = np.zeros((2, 2))
    if at_bound:
        covariance[0, 0] = 1.0 / float(J[:, 0] @ J[:, 0])
    else:
        covariance = np.linalg.pinv(J.T @ J)
    if estimated:
        quantile = student.ppf(0.5 + 0.5 * CONFIDENCE_LEVEL, max(count - 2, 1))
    else:
        quantile = np.sqrt(chi2_distribution.ppf(CONFIDENCE_LEVEL, 1))
    curvature = {
        name: (max(0.0, best[k] - quantile * np.sqrt(covariance[k, k])), best[k] + quantile * np.sqrt(covariance[k, k]))
        for k, name in enumerate(NAMES)
    }
    if at_bound:  # The interval is one-sided: below 0 there is no constant of the law.
        curvature["C20_Pa"] = (0.0, quantile / float(np.linalg.norm(J[:, 1])))
    chi2 = problem.chi2(best)
    residuals = [(o.measured - o.predicted(best)) / sd for o, sd in zip(observed, sds, strict=True)]
    widening = widening_of(residuals, chi2, count - 2 + len(at_bound), noise_estimated=estimated)
    fit = Fit(best, covariance, curvature, {}, {}, widening, at_bound, chi2, count, estimated, tuple(sds))
    if not profile:
        return fit
    of_noise = _profile(problem, fit, float(quantile), 1.0)
    wider = of_noise if widening.factor == 1.0 else _profile(problem, fit, float(quantile), widening.factor)
    return replace(fit, profile_of_noise=of_noise, profile=wider)


def profile_curve(observed: Sequence[Observed], fit: Fit, number: int, values: np.ndarray) -> np.ndarray:
    """Rise of chi2 above its least, one constant held at each of the values and the other one at its best."""
    problem = Problem(observed, fit.sds)
    least = problem.chi2(fit.constants)
    return np.array([problem.profiled(number, float(v), float(fit.constants[1 - number]))[0] - least for v in values])


def _profile(problem: Problem, fit: Fit, quantile: float, factor: float) -> dict[str, tuple[float, float]]:
    """Name -> (low, high), where chi2 has risen by the square of so many quantiles with the other constant at its best.

    An end may be infinite. Where the unit of chi2 is ``factor`` squared, all standard errors are so many times as large.
    """
    least, threshold = problem.chi2(fit.constants), (factor * quantile) ** 2
    limits = {}
    for k, name in enumerate(NAMES):
        best, other = float(fit.constants[k]), float(fit.constants[1 - k])
        bottom = 0.0 if k else SMALLEST_C10_PA

        def rise(value: float, k: int = k, other: float = other) -> float:
            return problem.profiled(k, value, other)[0] - least - threshold

        half = factor * max(fit.curvature[name][1] - best, 1e-6 * float(fit.constants[0]))
        ends = []
        for side in (-1.0, 1.0):
            far, near = best, best
            for step in range(MOST_WIDENINGS):
                far = max(best + side * half * WIDENING_FACTOR**step, bottom)
                if rise(far) >= 0.0 or far == bottom:
                    break
                near = far
            if far == bottom and rise(far) < 0.0:
                ends.append(bottom if k else 0.0)
            elif rise(far) < 0.0:
                ends.append(float("inf"))
            else:
                ends.append(float(brentq(rise, near, far, xtol=1e-6 * max(best, half), rtol=1e-9)))
        limits[name] = (ends[0], ends[1])
    return limits


def _with_least_noise(sd: np.ndarray) -> np.ndarray:
    return np.maximum(sd, LEAST_ROW_NOISE_SHARE * float(np.median(sd)))
