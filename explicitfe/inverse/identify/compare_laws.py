"""Comparison of material laws: information criteria, held-out error, stability, and the model-form error of a fitted law.

AICc (Hurvich & Tsai 1989) and BIC (Schwarz 1978) are computed for normal errors of unknown variance, which is at least the stated
noise. Rows with correlated errors count as fewer: the number is that of the law with the smallest residual, and at least 30.

The model-form error of the initial shear modulus has two parts. The first is the spread between laws: the interval holds 95 % of
the model-averaged distribution, a sum of the normal distributions of all laws weighted by AICc (Burnham & Anderson 2002,
chapter 4). The second is the difference between the fit to the whole range and the fit to its lower half, if it is significant
(Hausman's 1978 test).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from explicitfe.fem.materials.homogeneous import Mode, principal_stretches
from explicitfe.fem.materials.stability import STRETCHES_IN_USE, Loss, loss_of_stability
from explicitfe.inverse.identify.fit import CONFIDENCE_LEVEL, Fit, least_squares_fit
from explicitfe.inverse.identify.forward import PointResponse, UniformResponse
from explicitfe.inverse.identify.laws import FitLaw
from explicitfe.inverse.identify.observed import Observed
from explicitfe.platform.errors import RunError

LOWER_SHARE = 0.5  # The lower part of the range, for the test of the range.
SHARE_FOR_FITTING = 0.7  # With one curve only, the part of the range above this share is held out.
MOST_FOLDS = 6  # Curves are held out one by one, or in so many groups.
FEWEST_ROWS_PER_CONSTANT = 3
SIGNIFICANT_SDS = 2.576  # a probability of 1 %
NORMAL_QUANTILE = float(norm.ppf(0.5 + 0.5 * CONFIDENCE_LEVEL))
# Differences of the shear modulus below this share are numerical.
NEGLIGIBLE_SHARE = 1e-3
# A smooth misfit of the best law also counts as correlation: fewer effective rows than these are not used in the criteria.
LEAST_EFFECTIVE_ROWS = 30
SMALLEST_MEAN_SQUARE = 1e-18  # of the residual over the largest value, where the noise is unknown


@dataclass(frozen=True)
class LawFit:
    """A law in the comparison.

    Attributes
    ----------
    fit : None where the law could not be fitted; ``problem`` says why.
    observed : the fitted curves with the models of the law.
    aicc, bic : information criteria; only their differences mean something.
    weight : Akaike weight among the compared laws.
    held_out : rms error of held-out rows over the largest value; None where no rows can be held out.
    loss : loss of stability within the stretches of the data.
    """

    law: FitLaw
    observed: Sequence[Observed]
    fit: Fit | None
    problem: str = ""
    aicc: float = np.inf
    bic: float = np.inf
    weight: float = 0.0
    held_out: float | None = None
    loss: Loss | None = None


@dataclass(frozen=True)
class RangeTest:
    """Initial shear modulus from the lower half of the range, with its standard error [Pa]; ``significant`` if it differs."""

    shear_modulus_Pa: float
    sd_Pa: float
    significant: bool


def fit_stable(
    observed: Sequence[Observed], law: FitLaw, poisson: float, stretches: tuple[float, float]
) -> tuple[Fit, Loss | None]:
    """Fit a law with constants of any sign; with bounds at 0 if it then loses stability within the stretches of the data.

    Returns
    -------
    fit : without profile intervals.
    loss : where the law with these constants loses stability within ``stretches``, None for a stable one.
    """
    fit = least_squares_fit(observed, law=law.of_any_sign(), profile=False)
    loss = loss_of_stability(law.at(fit.constants, poisson), stretches)
    if loss is not None and law.of_any_sign() is not law:
        fit = least_squares_fit(observed, law=law, profile=False)
        loss = loss_of_stability(law.at(fit.constants, poisson), stretches)
    return fit, loss


def compared(fits: Sequence[LawFit]) -> list[LawFit]:
    """The same with criteria and weights, in the same order."""
    done = [row.fit for row in fits if row.fit is not None]
    if not done:
        return list(fits)
    best = min(done, key=lambda fit: fit.mean_square)
    rows = min(max(best.widening.effective, LEAST_EFFECTIVE_ROWS), best.count)
    criteria = []
    for row in fits:
        if row.fit is None:
            criteria.append((np.inf, np.inf))
            continue
        square = row.fit.mean_square
        variance = max(square, SMALLEST_MEAN_SQUARE) if row.fit.noise_estimated else max(square, 1.0)
        deviance = rows * (np.log(variance) + square / variance)
        k = len(row.fit.constants) - len(row.fit.at_bound) + 1
        correction = 2.0 * k * (k + 1.0) / max(rows - k - 1.0, 1.0)
        criteria.append((deviance + 2.0 * k + correction, deviance + k * np.log(max(rows, 2.0))))
    least = min(aicc for aicc, _ in criteria)
    weights = np.exp(-0.5 * (np.array([aicc for aicc, _ in criteria]) - least))
    weights /= weights.sum()
    return [
        replace(row, aicc=float(aicc), bic=float(bic), weight=float(weight))
        for row, (aicc, bic), weight in zip(fits, criteria, weights, strict=True)
    ]


def held_out_error(observed: Sequence[Observed], law: FitLaw) -> float | None:
    """Rms error of rows that the constants were not fitted to, over the largest value of their curve.

    With several curves each one is held out in turn; with one curve it is the part above 70 % of the range.
    None where too few rows remain for the fit.
    """
    if len(observed) > 1:
        folds = min(MOST_FOLDS, len(observed))
        parts = [
            ([o for k, o in enumerate(observed) if k % folds != fold], [o for k, o in enumerate(observed) if k % folds == fold])
            for fold in range(folds)
        ]
    else:
        share = load_share(observed[0])
        parts = [([observed[0].rows(share <= SHARE_FOR_FITTING)], [observed[0].rows(share > SHARE_FOR_FITTING)])]
    squares = []
    for fitted, held_out in parts:
        rows = sum(len(o.measured) for o in fitted)
        if rows < FEWEST_ROWS_PER_CONSTANT * len(law.constants) or not all(len(o.measured) for o in held_out):
            return None
        try:
            constants = least_squares_fit(fitted, law=law, profile=False).constants
        except RunError:
            return None
        largest = {o.id: float(np.abs(o.measured).max()) for o in observed}
        if len(observed) == 1:  # The contact is that of the fitted rows.
            held_out = [held_out[0].at_contact(fitted[0].contact(constants))]
        squares += [((o.predicted(constants) - o.measured) / largest[o.id]) ** 2 for o in held_out]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def range_test(observed: Sequence[Observed], fit: Fit) -> RangeTest | None:
    """Whether the lower half of the range leads to another initial shear modulus; None where it has too few rows."""
    lower = [o.rows(load_share(o) <= LOWER_SHARE) for o in observed]
    lower = [o for o in lower if len(o.measured) > 1 and np.abs(o.measured).max() > 0.0]
    if sum(len(o.measured) for o in lower) < FEWEST_ROWS_PER_CONSTANT * len(fit.constants):
        return None
    try:
        other = least_squares_fit(lower, fit.constants, law=fit.law, profile=False)
    except RunError:
        return None
    (modulus, sd), (part, part_sd) = fit.shear_modulus, other.shear_modulus
    part_sd *= max(other.widening.of_residual, fit.widening.of_residual)
    # The estimate from all rows is the efficient one: the variance of the difference is the difference of the variances.
    variance = max(part_sd**2 - (fit.widening.of_residual * sd) ** 2, 1e-3 * part_sd**2)
    difference = abs(part - modulus)
    significant = difference > SIGNIFICANT_SDS * np.sqrt(variance) and difference > NEGLIGIBLE_SHARE * modulus
    return RangeTest(part, part_sd, bool(significant))


def model_form_factor(fit: Fit, laws: Sequence[LawFit], test: RangeTest | None) -> float:
    """Factor by which the intervals of a fit must be wider to include the model-form error of the initial shear modulus."""
    modulus, sd = fit.shear_modulus
    half = fit.quantile * fit.widening.of_residual * sd
    needed = [half]
    rows = [(row.weight, row.fit) for row in laws if row.fit is not None]
    if len(rows) > 1:
        sds = [other.quantile / NORMAL_QUANTILE * other.widening.of_residual * other.shear_modulus[1] for _, other in rows]
        needed.append(_mixture_half_width(modulus, [weight for weight, _ in rows], [o.shear_modulus[0] for _, o in rows], sds))
    if test is not None and test.significant:
        needed.append(abs(modulus - test.shear_modulus_Pa) + fit.quantile * test.sd_Pa)
    if half <= 0.0 or max(needed) - half <= NEGLIGIBLE_SHARE * modulus:
        return 1.0
    return max(needed) / half


def _mixture_half_width(centre: float, weights: Sequence[float], means: Sequence[float], sds: Sequence[float]) -> float:
    """Half width of the interval around ``centre`` that holds 95 % of a mixture of normal distributions."""
    w, m, s = np.array(weights), np.array(means), np.maximum(sds, 1e-12 * abs(centre))

    def missing(half: float) -> float:
        inside = norm.cdf((centre + half - m) / s) - norm.cdf((centre - half - m) / s)
        return float(w @ inside) - CONFIDENCE_LEVEL

    farthest = float((np.abs(m - centre) + 10.0 * s).max())
    return float(brentq(missing, 0.0, farthest, xtol=1e-9 * abs(centre)))


def load_share(observed: Observed) -> np.ndarray:
    """Imposed load of each row (k,) over the largest one."""
    response = observed.model.response
    tension = isinstance(response, PointResponse) and response.kind != "shear"
    load = np.abs(observed.imposed - 1.0) if tension else np.abs(observed.imposed)
    if observed.contact_m is not None and not observed.model.by_force:  # Rows before contact have no load.
        load = np.maximum(observed.imposed - observed.contact_m, 0.0)
    return load / max(float(load.max()), 1e-300)


def stretches_in_data(observed: Sequence[Observed]) -> tuple[float, float]:
    """Smallest and largest principal stretch of homogeneous tests; under a tool those of ``STRETCHES_IN_USE``."""
    stretches = [1.0]
    for o in observed:
        response = o.model.response
        if isinstance(response, PointResponse) and response.kind == "shear":
            largest = float(np.abs(o.imposed).max())
            stretch = np.array([0.5 * (largest + np.sqrt(largest**2 + 4.0))])
            stretches += [*stretch, *(1.0 / stretch)]
        elif isinstance(response, PointResponse | UniformResponse):
            depth = o.measured if o.model.by_force else o.imposed
            mode: Mode = "uniaxial" if isinstance(response, UniformResponse) else response.kind
            along = 1.0 - depth / response.height_m if isinstance(response, UniformResponse) else depth
            stretches += principal_stretches(mode, np.array([along.min(), along.max()])).ravel().tolist()
        else:
            return STRETCHES_IN_USE
    return float(min(stretches)), float(max(stretches))
