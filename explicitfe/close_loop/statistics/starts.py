"""Searches from several starts: a fit with one effect more ends no worse than the model without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from explicitfe.close_loop.statistics.covariance import Covariance
from explicitfe.close_loop.statistics.refit import ROUGH_STALLED_CHI2_SHARE, BestFit, refit
from explicitfe.close_loop.statistics.system import Hypothesis, System, Term
from explicitfe.errors import RunError

# Where a fit gains less than this share of what its trial promised, the search began in the wrong place.
KEPT_PROMISE_SHARE = 0.5
# A search that gave up begins again with each coordinate moved by this share of its typical length, to either side.
MOVED_START_SHARE = 0.5
# The forward model is taken again at the parameters of a fit so often: they move little, and the model less.
MOST_RENEWALS = 2


def quality(fit: BestFit) -> tuple[bool, float]:
    """Smaller is better. A gross misfit is worse than any other; its chi2 is that of the rows alone."""
    return fit.by_rows is not None, fit.chi2


def refit_with(
    system: System, fit: BestFit, term: Term, starts: Sequence[Sequence[float]], covariance: Covariance, promised: float
) -> BestFit:
    """A model with a further term, the best of several starts.

    The first start comes from a trial, which is right where the answer is linear in the strength. Where the search keeps less
    than half of that trial's promise, it begins again: at other shapes, and at no strength at all, computed as with the effect.
    A search only goes downhill, so that its end is then no worse than the model without the effect.

    Parameters
    ----------
    fit : the model without the term, at its best.
    starts : values of the term's parameters to begin with, the most promising first.
    promised : by how much the trial lowers chi2.

    Raises
    ------
    RunError : the model cannot be computed from any start, or all searches ended worse than without the term.
    """
    ends: list[BestFit] = []
    reasons: list[str] = []

    def begin(values: Sequence[float]) -> None:
        try:
            ends.append(refit(system, fit.model.plus(term, values), covariance))
        except RunError as error:
            reasons.append(str(error))

    def kept() -> bool:
        best = min(ends, key=quality, default=None)
        if best is None or (best.by_rows is not None) > (fit.by_rows is not None):
            return False
        # Where the two are counted differently, the fit with the effect has become a good one.
        same = (best.by_rows is None) == (fit.by_rows is None)
        return not same or fit.chi2 - best.chi2 >= KEPT_PROMISE_SHARE * promised

    first, *others = starts
    begin(first)
    if not kept():
        none = (term.parameters[0].sought.none, *first[1:])
        for values in [none] if system.costly(fit.model.plus(term, first)) else [*others, none]:
            begin(values)
    if not ends:
        raise RunError(reasons[0])
    best = min(ends, key=quality)
    if quality(best) > quality(fit):
        raise RunError("the search for its best parameters gave up: every end fits worse than the model without it.")
    return best


def settled(system: System, fit: BestFit, covariance: Covariance) -> BestFit:
    """The fit itself, or where its search gave up the best of several.

    It begins again where it stopped, with new derivatives, and then to either side. Rough answers can stop a search that has
    arrived; two searches that end about as low confirm each other.
    """
    ends, best = [fit], fit
    for share in (0.0, -MOVED_START_SHARE, MOVED_START_SHARE):
        if best.converged:
            break
        try:
            ends.append(refit(system, _moved(best.model, share), covariance))
        except RunError:
            continue  # no model there: the next start may have one
        best = min(ends, key=quality)
        alike = [end for end in ends if (end.by_rows is None) == (best.by_rows is None)]
        as_low = sum(end.chi2 <= (1.0 + ROUGH_STALLED_CHI2_SHARE) * best.chi2 for end in alike)
        confirmed = as_low > 1 and not system.exact(best.model)
        best = replace(best, converged=best.converged or confirmed)
    return best


def _moved(model: Hypothesis, share: float) -> Hypothesis:
    """A model with each coordinate moved by a share of its typical length, inside its bounds."""
    low, high, typical = (np.array([getattr(p, key) for p in model.parameters]) for key in ("low", "high", "typical"))
    return model.at(np.clip(model.x + share * typical, low, high))


def renewed(system: System, fit: BestFit, covariance: Covariance, times: int = MOST_RENEWALS) -> tuple[System, BestFit]:
    """A fit with the forward model that is best at its own parameters, which is taken again as they move; and that model."""
    for _ in range(times):
        here = system.at(fit.model)
        if here is system:
            break
        system, fit = here, refit(here, fit.model, covariance, slopes=fit.slopes)
    return system, fit
