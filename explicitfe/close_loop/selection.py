"""Which of the effects that were fitted is added, and why each of the others is not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from explicitfe.close_loop.statistics.covariance import Covariance
from explicitfe.close_loop.statistics.fingerprints import Score, lack_of_fit
from explicitfe.close_loop.statistics.left_out import Deviations, Gain, deviations, errors, gain_of
from explicitfe.close_loop.statistics.refit import BestFit
from explicitfe.close_loop.statistics.system import System
from explicitfe.close_loop.thresholds import THRESHOLDS

# Errors of left-out tests: effect -> test -> error; "" is the model without a further effect.
CrossValidation = dict[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class Selection:
    """What was decided among the effects that were fitted.

    Attributes
    ----------
    best : the effect to add; None where the data speak against all of them.
    cv : effect -> cross-validated error of each test.
    why_not : effect that is not the best -> the reason, in words.
    no_consequence : significant effects with which left-out tests are foretold no better, where nothing else is to be found.
    """

    best: str | None
    cv: CrossValidation
    why_not: dict[str, str] = field(default_factory=dict)
    no_consequence: tuple[str, ...] = ()


def select(
    system: System,
    fit: BestFit,
    refits: dict[str, BestFit],
    allowed: Set[str],
    covariance: Covariance,
    numerical_chi2: Mapping[str, float],
) -> Selection:
    """The effect to add: of the models that are about as good in cross-validation as the best one, that with the least chi2 for
    its size (BIC); none where left-out tests, BIC or the numerics speak against it.

    Parameters
    ----------
    fit : the model without a further effect.
    allowed : effects that may be added.
    numerical_chi2 : effect -> what numerics may change of what it gains.
    """
    left: dict[str, Deviations] = {"": deviations(system, fit, covariance)}
    left |= {name: deviations(system, other, covariance) for name, other in refits.items()}
    cv: CrossValidation = {name: errors(system, deviation) for name, deviation in left.items()}
    size = np.log(max(covariance.effective, 2.0))  # what a parameter more must gain (BIC)
    cost = {name: refits[name].chi2 + size * len(refits[name].model.x) for name in refits if name in allowed}
    if not cost:
        return Selection(None, cv)
    if not cv[""]:
        near = list(cost)
    else:
        first = min(cost, key=lambda name: _mean(cv[name]))
        near = [name for name in cost if _standard_errors_worse(cv[name], cv[first]) <= 1.0]
    best = min(near, key=cost.__getitem__)
    why_not = {name: _why_another(name, best, cv, near) for name in cost if name != best}
    gain = gain_of(covariance, left[""], left[best])
    if cv[""] and fit.by_rows is None and _of_no_consequence(gain, fit, refits[best], covariance):
        slight = [name for name in cost if gain_of(covariance, left[""], left[name]).none]
        return Selection(None, cv, why_not | {name: _no_consequence(name, cv) for name in slight}, tuple(slight))
    against = _against(best, fit, refits[best], cv, size, numerical_chi2[best])
    if against:
        return Selection(None, cv, why_not | {best: against})
    return Selection(best, cv, why_not)


def why_not_fitted(score: Score, refitted: Sequence[Score]) -> str:
    """Why a significant candidate was not fitted, where others were that explain more."""
    top = max(refitted, key=lambda other: other.promise, default=None)
    if top is None:
        return "not fitted: no candidate could be fitted"
    usual = score.candidate.variant_of
    if usual in {other.candidate.effect for other in refitted}:
        return f"not fitted: {usual}, the usual form of this mechanism, leaves no residual to explain"
    own, best = _chi2(score.promise), _chi2(top.promise)
    return f"not fitted: its screening fit reduces chi2 by {own}, that of {top.candidate.effect} by {best}"


def _of_no_consequence(gain: Gain, fit: BestFit, fitted: BestFit, covariance: Covariance) -> bool:
    """Whether an effect, significant as it is, changes nothing that anybody would notice in another test.

    Its gain on tests that were left out is no larger than the error of that gain. Something else may still be missing where the
    misfit is significant by itself and left-out tests get worse with the effect, or most of the misfit stays.
    """
    if not gain.none:
        return False
    lack = lack_of_fit(fit, covariance)
    if lack.p > THRESHOLDS.significance_p:
        return True
    left = lack_of_fit(fitted, covariance)
    return gain.chi2 >= -gain.error and left.excess <= THRESHOLDS.unexplained_excess_share * lack.excess


def _no_consequence(name: str, cv: CrossValidation) -> str:
    """What is said of an effect of no consequence."""
    errors = f"cross-validated error {_percent(cv[name])} with it, {_percent(cv[''])} without"
    return f"statistically significant, but the prediction of held-out tests does not improve: {errors}"


def _why_another(name: str, best: str, cv: CrossValidation, near: Sequence[str]) -> str:
    """Why the best effect is preferred to another one."""
    if name not in near:
        return f"not added: cross-validated error {_percent(cv[name])}, with {best} {_percent(cv[best])}"
    return f"not added: {best} has the smaller BIC"


def _against(best: str, fit: BestFit, fitted: BestFit, cv: CrossValidation, size: float, numerical_chi2: float) -> str:
    """What speaks against adding the best effect; "" if nothing does."""
    gain, more = fit.chi2 - fitted.chi2, len(fitted.model.x) - len(fit.model.x)
    if gain <= numerical_chi2:
        return f"not added: it reduces chi2 by {_chi2(gain)}, numerical errors may change chi2 by {_chi2(numerical_chi2)}"
    if not cv[""]:
        return ""
    if gain <= size * more:
        return f"not added: it reduces chi2 by {_chi2(gain)}; BIC requires {_chi2(size * more)} for {more} parameters"
    missed = f"not added: cross-validated error {_percent(cv[best])} with it, {_percent(cv[''])} without"
    if fit.model.terms and len(cv[""]) >= THRESHOLDS.cross_validated_tests:
        # A further effect must not harm the tests that it was not fitted to. Far above the noise, where everything is
        # significant, it must help them.
        gain_share = 0.0 if fit.by_rows is None else THRESHOLDS.cross_validation_gain_share
        if not _mean(cv[best]) < (1.0 - gain_share) * _mean(cv[""]):
            return missed if not gain_share else f"{missed}; a reduction by {100.0 * gain_share:g} % is required"
    return missed if _standard_errors_worse(cv[best], cv[""]) > 1.0 else ""


def _chi2(value: float) -> str:
    """Three digits, and never a power of ten."""
    return f"{value:.3g}" if abs(value) < 1e3 else f"{value:.0f}"


def _mean(errors: dict[str, float]) -> float:
    return float(np.mean(list(errors.values())))


def _percent(errors: dict[str, float]) -> str:
    return f"{100.0 * _mean(errors):.2f} %"


def _standard_errors_worse(one: dict[str, float], other: dict[str, float]) -> float:
    """By how many standard errors the errors of one model exceed those of another, test by test."""
    gap = np.array([one[test] - other[test] for test in one if test in other])
    if len(gap) < THRESHOLDS.cross_validated_tests:
        return 0.0  # too few tests speak neither for a model nor against it
    error = float(np.std(gap, ddof=1) / np.sqrt(len(gap)))
    if error == 0.0:
        return 0.0 if gap.mean() <= 0.0 else np.inf
    return float(gap.mean()) / error
