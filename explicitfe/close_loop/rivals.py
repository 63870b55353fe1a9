"""The rivals of a round: which candidates are fitted, how they end, and how far their answers lie apart."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from explicitfe.close_loop.statistics.covariance import Covariance, measured_rows
from explicitfe.close_loop.statistics.fingerprints import Score, lack_of_fit
from explicitfe.close_loop.statistics.refit import BestFit, refit
from explicitfe.close_loop.statistics.starts import refit_with, renewed
from explicitfe.close_loop.statistics.system import System
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.errors import RunError


def gain_over(fit: BestFit, other: BestFit, covariance: Covariance) -> float:
    """By how much another model lowers the chi2 in which a fit was made: that of the rows alone where its misfit is gross."""
    if fit.by_rows is None:
        return fit.whitened - other.whitened
    rows = covariance.of_rows()
    return fit.by_rows - float(np.sum(rows.whiten(measured_rows(covariance.series) - other.answer) ** 2))


def worth_a_refit(
    system: System, fit: BestFit, significant: Sequence[Score], scored: Sequence[Score]
) -> tuple[list[Score], list[Score]]:
    """Candidates that may explain most when they are fitted, and others whose trial comes near the best one."""
    top = significant[0].promise
    # A candidate on a mesh costs more than all others together, and most where the model itself remembers.
    remembers = len(system.sketch(fit.model).terms) != len(fit.model.terms)
    share_on_a_mesh = 1.0 if remembers else THRESHOLDS.mesh_refit_share_of_best_drop
    near_drop = top - (THRESHOLDS.near_best_drop if fit.by_rows is None else THRESHOLDS.far_misfit)
    promising = [
        s
        for s in significant
        if (
            s.promise >= share_on_a_mesh * top
            if s.candidate.reference
            else s.promise > THRESHOLDS.refit_share_of_best_drop * top or s.promise > near_drop
        )
    ]
    near = [s for s in scored if s not in promising and s.values and s.promise > near_drop]
    return promising, near


def fits(
    system: System, fit: BestFit, covariance: Covariance, promising: Sequence[Score], near: Sequence[Score]
) -> tuple[dict[str, BestFit], dict[str, System], dict[str, str]]:
    """The model with each of the best candidates, fitted; the forward model of each; and why some cannot be."""
    most = THRESHOLDS.refitted_candidates
    if system.costly(fit.model) and fit.by_rows is None:
        most = THRESHOLDS.refitted_candidates_on_a_mesh
    others = [*promising[most:], *near]
    cheap = sorted((s for s in others if not s.candidate.reference), key=lambda s: -s.promise)
    # Those that take longest come last, when it is known how well the others do, and of two forms of one mechanism the usual one
    # comes first.
    chosen = sorted([*promising[:most], *cheap[:most]], key=lambda s: (s.candidate.dear, bool(s.candidate.variant_of)))
    top = max(s.promise for s in chosen)
    refits: dict[str, BestFit] = {}
    systems: dict[str, System] = {}
    failures: dict[str, str] = {}
    for score in chosen:
        name = score.candidate.effect
        model = fit.model.plus(score.candidate.term, score.values)
        least = min((other.chi2 for other in refits.values()), default=np.inf)
        usual = refits.get(score.candidate.variant_of)
        if system.costly(model) and (_far(fit, score, top, least) or (usual is not None and _leaves_nothing(usual, covariance))):
            continue
        try:
            # What a finer mesh changes depends on the effect: a volume that may change, a gradient of the stiffness. Corrected as
            # the model without it, a fit would end elsewhere.
            systems[name] = system.at(model)
            starts = (score.values, *score.others)
            refits[name] = refit_with(systems[name], fit, score.candidate.term, starts, covariance, score.promise)
        except RunError as error:
            failures[name] = str(error)
    least = min((other.chi2 for other in refits.values()), default=np.inf)
    for name in [name for name, one in refits.items() if one.chi2 <= least + THRESHOLDS.near_best_drop]:
        try:
            systems[name], refits[name] = renewed(systems[name], refits[name], covariance, times=1)
        except RunError as error:
            failures[name] = str(error)
            del refits[name]
    return refits, systems, failures


def _far(fit: BestFit, score: Score, top: float, least: float) -> bool:
    """Whether a fit would not bring a candidate near the least chi2 so far.

    Of one that takes long the trial itself has to promise it, or nearly as much as the best trial does.
    """
    if score.candidate.dear:
        left = fit.chi2 - score.promise
        return left > least + THRESHOLDS.visible_separation and score.promise < THRESHOLDS.dear_refit_share_of_best_drop * top
    return fit.chi2 - THRESHOLDS.refit_gain_over_trial * score.promise > least + THRESHOLDS.far_misfit


def excluded(best: str, refits: dict[str, BestFit], covariance: Covariance) -> set[str]:
    """Rivals that the data themselves exclude: they fit much worse than the best model, which leaves nothing unexplained.

    How far the answers of two models lie apart says what such data tell on average; these data may have told more.
    """
    chosen = refits[best]
    if not _leaves_nothing(chosen, covariance):
        return set()
    return {name for name, rival in refits.items() if rival.chi2 - chosen.chi2 >= THRESHOLDS.excluded_chi2}


def _leaves_nothing(fit: BestFit, covariance: Covariance) -> bool:
    """Whether no smooth curve would explain anything of what a model leaves."""
    return fit.by_rows is None and lack_of_fit(fit, covariance).p > THRESHOLDS.quiet_p


def separations_of(
    systems: dict[str, System], best: str, refits: dict[str, BestFit], clear: Set[str], covariance: Covariance
) -> list[tuple[str, str, float]]:
    """(best, rival, |y_best - y_rival|^2) with each rival fitted to the answer of the best model.

    Parameters
    ----------
    clear : rivals that the data exclude. Where runs are dear, how much worse these fit the data stands for the distance.
    """
    chosen = refits[best]
    separations = []
    for name, rival in refits.items():
        if name == best:
            continue
        apart = rival.chi2 - chosen.chi2
        known = apart > THRESHOLDS.far_misfit or (name in clear and systems[name].costly(rival.model))
        if not known:  # else the data themselves tell the models apart
            apart = refit(systems[name], rival.model, covariance, chosen.answer, rival.slopes).chi2
        separations.append((best, name, apart))
    return separations
