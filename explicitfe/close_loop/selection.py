"""Which of the effects that were fitted is added, and why each of the others is not."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from explicitfe.close_loop.statistics.covariance import Covariance
from explicitfe.close_loop.statistics.fingerprints import Score
from explicitfe.close_loop.statistics.refit import BestFit, cross_validation_errors
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
    """

    best: str | None
    cv: CrossValidation
    why_not: dict[str, str] = field(default_factory=dict)


def select(
    system: System,
    fit: BestFit,
    refits: dict[str, BestFit],
    allowed: Set[str],
    covariance: Covariance,
    numerical_chi2: float,
) -> Selection:
    """The effect to add: of the models that are about as good in cross-validation as the best one, that with the least chi2 for
    its size (BIC); none where left-out tests, BIC or the numerics speak against it.

    Parameters
    ----------
    fit : the model without a further effect.
    allowed : effects that may be added.
    numerical_chi2 : what numerics may change of chi2.
    """
    cv: CrossValidation = {"": cross_validation_errors(system, fit, covariance)}
    cv |= {name: cross_validation_errors(system, other, covariance) for name, other in refits.items()}
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
    against = _against(best, fit, refits[best], cv, size, numerical_chi2)
    if against:
        return Selection(None, cv, why_not | {best: against})
    return Selection(best, cv, why_not)


def why_not_fitted(score: Score, refitted: Sequence[Score]) -> str:
    """Why a significant candidate was not fitted, where others were that explain more."""
    top = max(refitted, key=lambda other: other.drop, default=None)
    if top is None:
        return "not fitted: no candidate could be"
    own, best = _chi2(score.drop), _chi2(top.drop)
    return f"not fitted: its trial lowers chi2 by {own}, that of {top.candidate.effect} by {best}, too far ahead to be reached"


def _why_another(name: str, best: str, cv: CrossValidation, near: Sequence[str]) -> str:
    """Why the best effect is preferred to another one."""
    if name not in near:
        return f"not added: left-out tests are missed by {_percent(cv[name])}, with {best} by {_percent(cv[best])}"
    return f"not added: {best} has the smaller chi2 for its number of parameters (BIC)"


def _against(best: str, fit: BestFit, fitted: BestFit, cv: CrossValidation, size: float, numerical_chi2: float) -> str:
    """What speaks against adding the best effect; "" if nothing does."""
    gain, more = fit.chi2 - fitted.chi2, len(fitted.model.x) - len(fit.model.x)
    if gain <= numerical_chi2:
        return f"not added: it lowers chi2 by {_chi2(gain)}, and numerics alone may change it by {_chi2(numerical_chi2)}"
    if not cv[""]:
        return ""
    if gain <= size * more:
        return f"not added: it lowers chi2 by {_chi2(gain)}, and its {more} parameters must by {_chi2(size * more)} (BIC)"
    missed = f"not added: left-out tests are missed by {_percent(cv[best])} with it, by {_percent(cv[''])} without"
    if fit.model.terms and len(cv[""]) >= THRESHOLDS.cross_validated_tests:
        # A further effect must not harm the tests that it was not fitted to. Far above the noise, where everything is
        # significant, it must help them.
        gain_share = 0.0 if fit.by_rows is None else THRESHOLDS.cross_validation_gain_share
        if not _mean(cv[best]) < (1.0 - gain_share) * _mean(cv[""]):
            return missed if not gain_share else f"{missed}, and {100.0 * gain_share:g} % less is asked for"
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
