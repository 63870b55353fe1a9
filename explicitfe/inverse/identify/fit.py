"""Weighted least squares of the constants of a law, with intervals from the curvature and from the profile likelihood.

Intervals from independent noise alone are stored in addition to those that are widened by what the residual and the comparison of
laws show (widening.py, compare_laws.py): quote the latter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import t as student

from explicitfe.inverse.identify.forward import CurveModel
from explicitfe.inverse.identify.laws import SMALLEST_MODULUS_PA, YEOH, ConstantsLike, FitLaw
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.identify.widening import Widening, widening_of
from explicitfe.platform.errors import RunError

NAMES = YEOH.constants
CONFIDENCE_LEVEL = 0.95
DERIVATIVE_STEP_SHARE = 1e-4  # Derivatives are central differences over this share of a constant.
# The fit is repeated at most so often: weights count errors of the imposed column by the model's slope, which the fit changes.
MOST_PASSES = 4
# The weights are final when a pass moves no modulus by more than this share of the first one.
SETTLED_STEP_SHARE = 1e-7
# No row is exact: at zero force, where the slope is zero, a row would have infinite weight. Its noise is at least this share
# of the median.
LEAST_ROW_NOISE_SHARE = 1e-3
# Laws with more constants than this are fitted to a weaker tolerance from several starts, and have no profile intervals.
FEW_CONSTANTS = 3
FIT_TOLERANCE, TOLERANCE_OF_MANY = 1e-12, 1e-9
STARTS_OF_MANY = 2
MOST_EVALUATIONS = 200
# A modulus below this share of the shear modulus may belong at its bound 0.
NEAR_BOUND_SHARE = 0.02

# The data do not determine a direction of the constants with a singular value below this share of the largest one. A constant is
# affected if it is more than this part of such a direction.
SINGULAR_SHARE = 1e-7
UNDETERMINED_PART = 0.01

# The end of a profile interval is searched in steps that grow by this factor; after so many steps it is infinite.
WIDENING_FACTOR = 1.5
MOST_WIDENINGS = 12
FAR_CHI2 = 1e100


@dataclass(frozen=True)
class Fit:
    """Fitted constants and their uncertainty.

    Attributes
    ----------
    law : the fitted law.
    constants : (p,) of the law.
    covariance : (p, p) from the curvature; zero for constants at a bound.
    curvature, profile_of_noise : name -> (low, high), 95 %, from independent noise alone.
    profile : the same, widened by ``widening``; laws with many constants have it from the curvature.
    widening : factor of the intervals, and its causes.
    at_bound : names of constants that ended at a bound.
    undetermined : names of constants that the data do not determine: another value changes nothing if others change with it.
    chi2, count : weighted sum of squares, and rows less fitted contacts; chi2 is in units of the noise, stated or estimated.
    mean_square : of the weighted residual, with weights that are the same for all laws.
    noise_estimated : the dataset does not state the noise; it is estimated from the residual.
    sds : standard deviations of the rows, one array per curve.
    """

    law: FitLaw
    constants: np.ndarray
    covariance: np.ndarray
    curvature: dict[str, tuple[float, float]]
    profile_of_noise: dict[str, tuple[float, float]]
    profile: dict[str, tuple[float, float]]
    widening: Widening
    at_bound: tuple[str, ...]
    undetermined: tuple[str, ...]
    chi2: float
    count: int
    mean_square: float
    noise_estimated: bool
    sds: tuple[np.ndarray, ...]

    @property
    def sd(self) -> np.ndarray:
        """Standard errors (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> float | None:
        """Correlation of two constants; None where one is at its bound, and for laws with another number of constants."""
        if self.at_bound or len(self.constants) != 2:
            return None
        return float(self.covariance[0, 1] / np.sqrt(self.covariance[0, 0] * self.covariance[1, 1]))

    @property
    def free(self) -> int:
        """Degrees of freedom: rows minus fitted constants."""
        return self.count - len(self.constants) + len(self.at_bound)

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard errors."""
        if self.noise_estimated:
            return float(student.ppf(0.5 + 0.5 * CONFIDENCE_LEVEL, max(self.count - len(self.constants), 1)))
        return float(np.sqrt(chi2_distribution.ppf(CONFIDENCE_LEVEL, 1)))

    @property
    def shear_modulus(self) -> tuple[float, float]:
        """Initial shear modulus and its standard error from independent noise alone [Pa]."""
        gradient = self.law.shear_modulus_gradient()
        variance = max(float(gradient @ self.covariance @ gradient), 0.0)
        return self.law.shear_modulus_Pa(self.constants), float(np.sqrt(variance))

    @property
    def shear_modulus_interval(self) -> tuple[float, float]:
        """95 % interval of the initial shear modulus [Pa], as wide as those of the constants."""
        gradient, (modulus, sd) = self.law.shear_modulus_gradient(), self.shear_modulus
        if np.count_nonzero(gradient) == 1 and self.profile:
            low, high = self.profile[self.law.constants[0]]
            return float(gradient[0]) * low, float(gradient[0]) * high
        half = self.quantile * self.widening.factor * sd
        return max(modulus - half, 0.0), modulus + half


class Problem:
    """The weighted residual of some curves that share their constants.

    Parameters
    ----------
    observed : the curves.
    sds : standard deviations of their rows.
    law : the law of the models.
    """

    def __init__(self, observed: Sequence[Observed], sds: Sequence[np.ndarray], law: FitLaw = YEOH) -> None:
        self.observed = observed
        self.sds = sds
        self.law = law
        self._lower, self._upper = np.array(law.lower), np.array(law.upper)
        self._parts, self._sd = self.observed, np.concatenate(sds)
        if all(o.contact_m is None and o.model == observed[0].model for o in observed):
            imposed, measured = (np.concatenate([getattr(o, name) for o in observed]) for name in ("imposed", "measured"))
            self._parts = [replace(observed[0], imposed=imposed, measured=measured)]

    def residual(self, constants: ConstantsLike) -> np.ndarray:
        """(predicted - measured) / sd of all rows; curves with one model are predicted together."""
        return np.concatenate([o.predicted(constants) - o.measured for o in self._parts]) / self._sd

    def chi2(self, constants: ConstantsLike) -> float:
        """Sum of squares of the residual."""
        return float((self.residual(constants) ** 2).sum())

    def jacobian(self, constants: np.ndarray, columns: Sequence[int] | None = None) -> np.ndarray:
        """Derivatives of the residual (n, p), by central differences; one-sided at a bound."""
        rows = []
        for k in range(len(constants)) if columns is None else columns:
            share = DERIVATIVE_STEP_SHARE
            if self.law.moduli[k]:
                step = share * max(abs(constants[k]), share * constants[0], 1e-2 * constants[0] if constants[k] == 0.0 else 0.0)
            else:
                step = share * max(abs(constants[k]), 1.0)
            up, down = constants.copy(), constants.copy()
            up[k] = min(up[k] + step, self._upper[k])
            down[k] = max(down[k] - step, self._lower[k])
            rows.append((self.residual(up) - self.residual(down)) / (up[k] - down[k]))
        return np.stack(rows, axis=1)

    def minimise(self, start: np.ndarray, held: Mapping[int, float]) -> np.ndarray:
        """The best constants (p,) with some of them held.

        Raises
        ------
        RunError : the optimiser did not find any; that says nothing about the model.
        """
        full = np.array(start, dtype=float)
        for k, value in held.items():
            full[k] = value
        free = [k for k in range(len(full)) if k not in held]
        if not free:
            return full
        size = max(float(np.abs(full[self.law.moduli]).max()), SMALLEST_MODULUS_PA)
        unit = np.where(self.law.moduli, size, 1.0)[free]
        # At a stretch of 17 a unit of C30 is a force 80 000 times that of C10.
        norms = np.linalg.norm(unit * self.jacobian(full, free), axis=0)
        unit = np.where(
            norms > 0.0, unit * norms.min(where=norms > 0.0, initial=np.inf) / np.where(norms > 0.0, norms, 1.0), unit
        )
        low, high = self._lower[free] / unit, self._upper[free] / unit

        def at(z: np.ndarray) -> np.ndarray:
            constants = full.copy()
            constants[free] = np.clip(unit * z, self._lower[free], self._upper[free])
            return constants

        tolerance = FIT_TOLERANCE if len(full) <= FEW_CONSTANTS else TOLERANCE_OF_MANY
        solution = least_squares(
            lambda z: self.residual(at(z)),
            np.clip(full[free] / unit, low + 1e-9, high - 1e-9),
            bounds=(low, high),
            jac=lambda z: unit * self.jacobian(at(z), free),
            xtol=tolerance,
            ftol=tolerance,
            gtol=tolerance,
            max_nfev=MOST_EVALUATIONS,
        )
        if (solution.status <= 0 and len(full) <= FEW_CONSTANTS) or not np.isfinite(solution.x).all():
            raise RunError(f"the optimiser stopped after {solution.nfev} evaluations; this says nothing about the model.")
        return at(solution.x)

    def solve(self, start: np.ndarray) -> np.ndarray:
        """The best constants, at a bound where that is better or as good; see :meth:`minimise`."""
        best = self.law.ordered(self.minimise(start, {}))
        # The solver stays strictly inside its bounds.
        for k in range(1, len(best)):
            if self.law.moduli[k] and 0.0 < best[k] - self._lower[k] <= NEAR_BOUND_SHARE * best[0]:
                at_bound = self.minimise(best, {k: float(self._lower[k])})
                if self.chi2(at_bound) <= self.chi2(best) * (1.0 + 1e-9):
                    best = at_bound
        return best

    def profiled(self, number: int, value: float, start: np.ndarray) -> float:
        """chi2 with one constant held and the others at their best."""
        held = np.array(start, dtype=float)
        held[number] = value
        if not np.isfinite(self.chi2(held)):  # far outside, where the law has no finite stress
            return FAR_CHI2
        best = self.minimise(start, {number: value})
        at_bound = best.copy()
        for k in range(1, len(best)):
            if k != number and self.law.moduli[k] and 0.0 < best[k] - self._lower[k] <= NEAR_BOUND_SHARE * best[0]:
                at_bound[k] = self._lower[k]
        return min(self.chi2(best), self.chi2(at_bound))


def starts_of(observed: Sequence[Observed], law: FitLaw = YEOH, count: int = 1) -> list[np.ndarray]:
    """Constants to begin with: the shapes of the law whose scaled responses have the smallest residuals, the best one first."""
    errors: list[tuple[float, np.ndarray]] = []
    moduli = law.moduli
    for shape in law.shapes:
        top = bottom = total = 0.0
        for o in observed:
            # Forces and stresses are proportional to the moduli, whatever is imposed.
            o = o.at_contact(o.contact_m or 0.0)
            x, y = (o.measured, o.imposed) if o.model.by_force else (o.imposed, o.measured)
            unit = CurveModel(o.model.response)(x, *shape)
            weight = 1.0 / max(float((y**2).sum()), 1e-300)
            top += weight * float(unit @ y)
            bottom += weight * float(unit @ unit)
            total += weight * float(y @ y)
        if np.isfinite(bottom) and bottom > 0.0 and top > 0.0:
            errors.append((total - top**2 / bottom, np.where(moduli, top / bottom, 1.0) * np.array(shape)))
    if not errors:
        return [np.array(law.shapes[0])]
    return [constants for _, constants in sorted(errors, key=lambda pair: pair[0])[:count]]


def least_squares_fit(
    observed: Sequence[Observed], start: np.ndarray | None = None, *, law: FitLaw = YEOH, profile: bool = True
) -> Fit:
    """Fit the constants of a law within its bounds.

    Parameters
    ----------
    observed : curves that share the constants. Where one does not state its noise, every curve's rows are weighted by the
        curve's largest value and the noise is estimated from the residual.
    start : initial constants; chosen by :func:`starts_of` if omitted.
    law : the law of the models of ``observed``.
    profile : whether intervals of the profile likelihood are computed; without them ``Fit.profile`` is empty.

    Raises
    ------
    RunError : the optimiser failed.
    """
    estimated = not all(o.noise_known for o in observed)
    many = len(law.constants) > FEW_CONSTANTS
    starts = starts_of(observed, law, STARTS_OF_MANY if many else 1) if start is None else [np.asarray(start, dtype=float)]
    best = starts[0]
    sds: list[np.ndarray] = []
    for _ in range(1 if estimated else MOST_PASSES):
        sds = [
            np.full(len(o.measured), np.abs(o.measured).max()) if estimated else _with_least_noise(o.sd(best)) for o in observed
        ]
        problem = Problem(observed, sds, law)
        before, best = best, min((problem.solve(first) for first in starts), key=problem.chi2)
        starts = [best]
        if np.abs(best - before).max() < SETTLED_STEP_SHARE * best[0]:
            break
    problem = Problem(observed, sds, law)
    count = sum(len(o.measured) - (o.contact_m is not None) for o in observed)
    mean_square = problem.chi2(best) / count
    if estimated:
        scale = np.sqrt(max(problem.chi2(best) / max(count - len(best), 1), 1e-24))
        sds = [scale * s for s in sds]
        problem = Problem(observed, sds, law)
    bounded = [k for k in range(1, len(best)) if law.moduli[k] and best[k] == law.lower[k]]
    at_bound = tuple(law.constants[k] for k in bounded)
    J = problem.jacobian(best)
    inner = [k for k in range(len(best)) if k not in bounded]
    covariance = np.zeros((len(best), len(best)))
    # Moduli and exponents differ by many orders of magnitude.
    unit = np.maximum(np.abs(best[inner]), 1e-9)
    _, singular, directions = np.linalg.svd(unit * J[:, inner], full_matrices=False)
    known = singular > SINGULAR_SHARE * singular.max(initial=0.0)
    inverse = (directions[known].T / singular[known] ** 2) @ directions[known]
    covariance[np.ix_(inner, inner)] = np.outer(unit, unit) * inverse
    free_directions = np.abs(directions[~known]).max(axis=0, initial=0.0)
    undetermined = tuple(law.constants[k] for k, part in zip(inner, free_directions, strict=True) if part > UNDETERMINED_PART)
    chi2 = problem.chi2(best)
    residuals = [(o.measured - o.predicted(best)) / sd for o, sd in zip(observed, sds, strict=True)]
    widening = widening_of(residuals, chi2, count - len(best) + len(at_bound), noise_estimated=estimated)
    fit = Fit(
        law, best, covariance, {}, {}, {}, widening, at_bound, undetermined, chi2, count, mean_square, estimated, tuple(sds)
    )
    curvature = {name: _around(fit, k, 1.0) for k, name in enumerate(law.constants)}
    for k in bounded:  # The interval is one-sided: beyond the bound the law has no constant.
        slope = float(np.linalg.norm(J[:, k]))
        curvature[law.constants[k]] = (law.lower[k], law.lower[k] + fit.quantile / slope if slope > 0.0 else np.inf)
    fit = replace(fit, curvature=curvature)
    return with_intervals(observed, fit) if profile else fit


def with_intervals(observed: Sequence[Observed], fit: Fit, model_form: float = 1.0) -> Fit:
    """The fit with its 95 % intervals, wider by a factor for the model-form error."""
    fit = replace(fit, widening=replace(fit.widening, model_form=model_form))
    if len(fit.constants) > FEW_CONSTANTS:
        wider = {name: _around(fit, k, fit.widening.factor) for k, name in enumerate(fit.law.constants)}
        return replace(fit, profile_of_noise=dict(fit.curvature), profile=wider)
    problem = Problem(observed, fit.sds, fit.law)
    of_noise = _profile(problem, fit, 1.0)
    wider = of_noise if fit.widening.factor == 1.0 else _profile(problem, fit, fit.widening.factor)
    return replace(fit, profile_of_noise=of_noise, profile=wider)


def contact_interval(observed: Observed, fit: Fit, number: int) -> tuple[float, float]:
    """Displacement of first contact of a curve and half of its 95 % interval, as wide as those of the constants [m]."""
    best = np.array(fit.constants)
    contact, touching = observed.contact(best), observed.at_contact(observed.contact(best))
    slope = observed.contact_slope(touching.imposed, best)
    change = np.zeros(len(best))
    for k in np.flatnonzero(fit.sd):
        step = np.zeros(len(best))
        step[k] = 0.1 * fit.sd[k]
        change[k] = (observed.contact(best + step) - observed.contact(best - step)) / (2.0 * step[k])
    variance = 1.0 / float(((slope / fit.sds[number]) ** 2).sum()) + change @ fit.covariance @ change
    return contact, fit.quantile * fit.widening.factor * float(np.sqrt(variance))


def profile_curve(observed: Sequence[Observed], fit: Fit, number: int, values: np.ndarray) -> np.ndarray:
    """Increase of chi2 above its minimum, one constant held at each of the values and the others at their best."""
    problem = Problem(observed, fit.sds, fit.law)
    least = problem.chi2(fit.constants)
    return np.array([problem.profiled(number, float(v), fit.constants) - least for v in values])


def _around(fit: Fit, number: int, factor: float) -> tuple[float, float]:
    """Interval of a constant by the curvature, within its bounds."""
    undetermined = fit.law.constants[number] in fit.undetermined
    half = np.inf if undetermined else factor * fit.quantile * float(fit.sd[number])
    low = 0.0 if number == 0 else fit.law.lower[number]
    return max(low, float(fit.constants[number]) - half), min(fit.law.upper[number], float(fit.constants[number]) + half)


def _profile(problem: Problem, fit: Fit, factor: float) -> dict[str, tuple[float, float]]:
    """Name -> (low, high), where chi2 has increased by (factor * quantile)^2 with the other constants at their best.

    An end may be infinite.
    """
    least, threshold = problem.chi2(fit.constants), (factor * fit.quantile) ** 2
    limits = {}
    for k, name in enumerate(fit.law.constants):
        best, bottom, top = float(fit.constants[k]), fit.law.lower[k], fit.law.upper[k]

        def rise(value: float, k: int = k) -> float:
            return problem.profiled(k, value, fit.constants) - least - threshold

        half = factor * max(fit.curvature[name][1] - best, 1e-6 * float(fit.constants[0] if fit.law.moduli[k] else 1.0))
        ends = []
        for side in (-1.0, 1.0):
            far, near = best, best
            for step in range(MOST_WIDENINGS):
                far = min(max(best + side * half * WIDENING_FACTOR**step, bottom), top)
                if rise(far) >= 0.0 or far in (bottom, top):
                    break
                near = far
            if far in (bottom, top) and rise(far) < 0.0:
                ends.append(0.0 if k == 0 and far == bottom else far)
            elif rise(far) < 0.0:
                ends.append(side * np.inf)
            else:
                ends.append(float(brentq(rise, near, far, xtol=1e-6 * max(abs(best), half), rtol=1e-9)))
        limits[name] = (ends[0], ends[1])
    return limits


def _with_least_noise(sd: np.ndarray) -> np.ndarray:
    return np.maximum(sd, LEAST_ROW_NOISE_SHARE * float(np.median(sd)))
