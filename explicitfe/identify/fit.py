"""Weighted least squares of two constants, with intervals from the curvature at the optimum and from the profile likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import t as student

from explicitfe.errors import RunError
from explicitfe.identify.forward import CurveModel

NAMES = ("C10_Pa", "C20_Pa")
LEVEL = 0.95
SMALLEST = 1e-3  # Pa: C10 must be above 0
STEP = 1e-4  # of a constant, in derivatives
PASSES = 4  # errors of the imposed column count by the model's slope, which the fit changes


@dataclass(frozen=True)
class Observed:
    """Rows of one curve that are fitted or predicted.

    Attributes
    ----------
    id : of the curve.
    imposed, measured : (k,) SI.
    imposed_sd, measured_sd : of one row; None is unknown.
    model : predicts ``measured`` from ``imposed``.
    """

    id: str
    imposed: np.ndarray
    measured: np.ndarray
    imposed_sd: float | None
    measured_sd: float | None
    model: CurveModel

    @property
    def noise_known(self) -> bool:
        """Whether the dataset states a noise that is not zero."""
        return (self.imposed_sd or 0.0) > 0.0 or (self.measured_sd or 0.0) > 0.0

    def predicted(self, constants: Sequence[float]) -> np.ndarray:
        """What the model says (k,)."""
        return self.model(self.imposed, *map(float, constants))

    def sd(self, constants: Sequence[float]) -> np.ndarray:
        """Standard deviation of measured - predicted (k,), the imposed column's own error included."""
        slope = self.model.with_slope(self.imposed, *map(float, constants))[1]
        return np.hypot(self.measured_sd or 0.0, slope * (self.imposed_sd or 0.0))

    def errors(self, constants: Sequence[float]) -> dict[str, float]:
        """rmse in the unit of the measured column, and over its largest magnitude; the largest deviation."""
        rest = self.predicted(constants) - self.measured
        rmse = float(np.sqrt(np.mean(rest**2)))
        return {
            "rmse": rmse,
            "nrmse": rmse / float(np.abs(self.measured).max()),
            "largest": float(np.abs(rest).max()),
        }


@dataclass(frozen=True)
class Fit:
    """Constants that fit, and how well they are known.

    Attributes
    ----------
    constants : (2,) C10, C20 [Pa].
    covariance : (2, 2) Pa^2, from the curvature; of C10 alone where C20 is at its bound.
    curvature, profile : name -> (low, high) Pa, 95 %.
    at_bound : names of constants at a bound.
    chi2, count : weighted sum of squares and rows; with the noise unknown chi2 is in units of the estimated noise.
    noise_estimated : sds are not stated by the dataset, they are those of the residual.
    sds : one array a curve, of its rows.
    """

    constants: np.ndarray
    covariance: np.ndarray
    curvature: dict[str, tuple[float, float]]
    profile: dict[str, tuple[float, float]]
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
        """Of C10 and C20; none at a bound."""
        if self.at_bound:
            return None
        return float(self.covariance[0, 1] / np.sqrt(self.covariance[0, 0] * self.covariance[1, 1]))


class Problem:
    """The weighted residual of some curves that share their constants.

    Parameters
    ----------
    observed : the curves.
    sds : of their rows; found from the noise and the model at ``constants`` if left out.
    """

    def __init__(self, observed: Sequence[Observed], sds: Sequence[np.ndarray]) -> None:
        self.observed = observed
        self.sds = sds

    def residual(self, constants: Sequence[float]) -> np.ndarray:
        """(predicted - measured) / sd of all rows."""
        return np.concatenate([(o.predicted(constants) - o.measured) / s for o, s in zip(self.observed, self.sds, strict=True)])

    def chi2(self, constants: Sequence[float]) -> float:
        return float((self.residual(constants) ** 2).sum())

    def jacobian(self, constants: np.ndarray) -> np.ndarray:
        """Of the residual (n, 2) 1/Pa, by central differences; C20 from above where it is 0."""
        columns = []
        for k in range(2):
            step = STEP * max(abs(constants[k]), STEP * constants[0], 1e-2 * constants[0] if constants[k] == 0.0 else 0.0)
            up, down = constants.copy(), constants.copy()
            up[k] += step
            down[k] = max(down[k] - step, 0.0 if k else SMALLEST)
            columns.append((self.residual(up) - self.residual(down)) / (up[k] - down[k]))
        return np.stack(columns, axis=1)

    def solve(self, start: np.ndarray) -> np.ndarray:
        """The best constants.

        Raises
        ------
        RunError : the optimiser did not find any; that says nothing about the model.
        """
        unit = max(float(start[0]), SMALLEST)
        found = least_squares(
            lambda z: self.residual(unit * z),
            np.maximum(start / unit, [1e-6, 1e-9]),
            bounds=([SMALLEST / unit, 0.0], [np.inf, np.inf]),
            jac=lambda z: unit * self.jacobian(np.maximum(unit * z, [SMALLEST, 0.0])),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=200,
        )
        if found.status <= 0 or not np.isfinite(found.x).all():
            raise RunError(f"the optimiser gave up after {found.nfev} evaluations; this says nothing about the model.")
        best = unit * found.x
        # The solver stays strictly inside its bounds: is the bound itself better, or as good?
        edge = np.array([self.best_other(1, 0.0, best[0]), 0.0])
        return edge if self.chi2(edge) <= self.chi2(best) * (1.0 + 1e-9) else best

    def best_other(self, fixed: int, value: float, start: float) -> float:
        """The best of one constant while the other one, number ``fixed``, is held."""

        def at(other: float) -> np.ndarray:
            return np.array([value, other]) if fixed == 0 else np.array([other, value])

        unit = max(abs(start), 1e-3 * abs(value), SMALLEST)
        low = 0.0 if fixed == 0 else SMALLEST
        found = least_squares(
            lambda z: self.residual(at(unit * z[0])),
            [max(start, low + 1e-6 * unit) / unit],
            bounds=([low / unit], [np.inf]),
            jac="3-point",
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
        )
        other = unit * float(found.x[0])
        if fixed == 0 and self.chi2(at(0.0)) <= self.chi2(at(other)):
            return 0.0
        return other

    def profiled(self, number: int, value: float, start: float) -> tuple[float, float]:
        """chi2 with one constant held and the other one at its best, and that one."""
        other = self.best_other(number, value, start)
        return self.chi2([value, other] if number == 0 else [other, value]), other


def start_of(observed: Sequence[Observed]) -> np.ndarray:
    """Constants to begin with: of a few ratios C20 / C10 the one whose scaled response misses the measured curves least."""
    best, found = np.inf, np.array([1.0, 0.0])
    for q in (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        top = bottom = total = 0.0
        for o in observed:
            # In forces or stresses the size of the constants is linear, whatever is imposed.
            x, y = (o.measured, o.imposed) if o.model.by_force else (o.imposed, o.measured)
            unit = CurveModel(o.model.response)(x, 1.0 - q, q)
            weight = 1.0 / max(float((y**2).sum()), 1e-300)
            top += weight * float(unit @ y)
            bottom += weight * float(unit @ unit)
            total += weight * float(y @ y)
        if bottom > 0.0 and top > 0.0 and total - top**2 / bottom < best:
            best, found = total - top**2 / bottom, top / bottom * np.array([1.0 - q, q])
    return found


def least_squares_fit(observed: Sequence[Observed], start: np.ndarray | None = None, *, profile: bool = True) -> Fit:
    """Fit C10 > 0 and C20 >= 0.

    Parameters
    ----------
    observed : curves that share the constants. Where one does not state its noise, every curve's rows weigh by the
        curve's largest value and the noise is estimated from the residual.
    start : where to begin; found if left out.
    profile : also the profile likelihood; without, ``Fit.profile`` is empty.

    Raises
    ------
    RunError : the optimiser failed.
    """
    estimated = not all(o.noise_known for o in observed)
    best = start_of(observed) if start is None else np.asarray(start, dtype=float)
    sds: list[np.ndarray] = []
    for _ in range(1 if estimated else PASSES):
        sds = [np.full(len(o.measured), np.abs(o.measured).max()) if estimated else _safe(o.sd(best)) for o in observed]
        before, best = best, Problem(observed, sds).solve(best)
        if np.abs(best - before).max() < 1e-7 * best[0]:
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
    quantile = student.ppf(0.5 + 0.5 * LEVEL, max(count - 2, 1)) if estimated else np.sqrt(chi2_distribution.ppf(LEVEL, 1))
    curvature = {
        name: (max(0.0, best[k] - quantile * np.sqrt(covariance[k, k])), best[k] + quantile * np.sqrt(covariance[k, k]))
        for k, name in enumerate(NAMES)
    }
    if at_bound:  # one-sided: the other side is not a constant of the law
        curvature["C20_Pa"] = (0.0, quantile / float(np.linalg.norm(J[:, 1])))
    fit = Fit(best, covariance, curvature, {}, at_bound, problem.chi2(best), count, estimated, tuple(sds))
    if not profile:
        return fit
    return Fit(**{**vars(fit), "profile": _profile(problem, fit, float(quantile) ** 2)})


def profile_curve(observed: Sequence[Observed], fit: Fit, number: int, values: np.ndarray) -> np.ndarray:
    """Rise of chi2 above its least, one constant held at each of the values and the other one at its best."""
    problem = Problem(observed, fit.sds)
    least = problem.chi2(fit.constants)
    return np.array([problem.profiled(number, float(v), float(fit.constants[1 - number]))[0] - least for v in values])


def _profile(problem: Problem, fit: Fit, threshold: float) -> dict[str, tuple[float, float]]:
    least = problem.chi2(fit.constants)
    limits = {}
    for k, name in enumerate(NAMES):
        best, other = float(fit.constants[k]), float(fit.constants[1 - k])
        bottom = 0.0 if k else SMALLEST

        def rise(value: float, k: int = k, other: float = other) -> float:
            return problem.profiled(k, value, other)[0] - least - threshold

        half = max(fit.curvature[name][1] - best, 1e-6 * float(fit.constants[0]))
        ends = []
        for side in (-1.0, 1.0):
            far, near = best, best
            for step in range(12):
                far = max(best + side * half * 1.5**step, bottom)
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


def _safe(sd: np.ndarray) -> np.ndarray:
    """No row is exact: a slope of zero, as at zero force, would give it infinite weight."""
    return np.maximum(sd, 1e-3 * float(np.median(sd)))
