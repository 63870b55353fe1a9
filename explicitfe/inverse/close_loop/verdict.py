"""The verdict that follows from the probabilities of the causes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from explicitfe.inverse.close_loop.baseline import ASSUMED
from explicitfe.inverse.close_loop.compared import ComparedCauses, Entry
from explicitfe.inverse.close_loop.evidence import Causes, evidence_of, log_odds_of_other
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows, outside
from explicitfe.inverse.close_loop.statistics.refit import BestFit
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.results.documents.loop_report import Decision, Remainder, Verdict


@dataclass(frozen=True, eq=False)
class Outcome:
    """A verdict, and what it rests on.

    Attributes
    ----------
    verdict, remainder : what is missing, and what the final model leaves.
    final : the final model; the baseline where nothing is missing.
    present, undecided : causes by the decision on each.
    credible : the smallest collection of sets of causes that holds 95 %.
    sure : probability that the verdict is right.
    """

    verdict: Verdict
    remainder: Remainder
    comparison: ComparedCauses
    final: Entry
    present: tuple[str, ...]
    undecided: tuple[str, ...]
    credible: tuple[Causes, ...]
    sure: float

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects of the final model, each once."""
        return tuple(dict.fromkeys(self.final.key))


def decision_on(probability: float) -> Decision:
    """Decide on one cause."""
    if probability >= THRESHOLDS.decisive_probability:
        return "present"
    return "absent" if probability <= 1.0 - THRESHOLDS.decisive_probability else "undecided"


def conclude(comparison: ComparedCauses) -> Outcome:
    """The verdict: each cause is present, absent or undecided, and something that no candidate describes may prevail."""
    posterior = comparison.posterior
    inclusion = posterior.inclusion
    present = tuple(cause for cause, p in inclusion.items() if decision_on(p) == "present")
    undecided = tuple(cause for cause, p in inclusion.items() if decision_on(p) == "undecided")
    total, credible = 0.0, []
    for causes, p in posterior.sets.items():
        credible.append(causes)
        total += p
        if total >= THRESHOLDS.credible_set:
            break
    nothing = posterior.closed.get(frozenset(), 0.0)
    top = next(iter(posterior.sets))
    remainder: Remainder = "form" if posterior.form > THRESHOLDS.majority_probability else "at-floor"
    if posterior.something_else > THRESHOLDS.majority_probability:
        verdict: Verdict = "unexplained"
        # A smooth curve could stand for what every hypothesis leaves, so the model that leaves least says most.
        remainder, sure, wanted = "unexplained", posterior.something_else, comparison.nearest.causes
    elif present and comparison.best_of(frozenset(present)) is not None:
        verdict, wanted = "effect-found", frozenset(present)
        sure = posterior.sets.get(wanted, 0.0)
        remainder = "ambiguous" if undecided else remainder
    elif not undecided and top == frozenset():
        verdict, sure, wanted = "no-missing-effect", nothing, frozenset()
        if _is_limited_by_numerics(comparison.baseline):
            verdict = "limited-by-numerics"
    else:
        verdict, remainder, wanted = "ambiguous", "ambiguous", top
        sure = total
    final = comparison.best_of(wanted) or next(one for one in comparison.entries if one.fit is not None)
    return Outcome(verdict, remainder, comparison, final, present, undecided, tuple(credible), sure)


def numerical_shares(covariance: Covariance, fit: BestFit, names: list[str]) -> dict[str, float]:
    """Systematic error -> rms of its change, outside what the constants imitate, as a share of the noise of the rows."""
    if not names:
        return {}
    rows = covariance.by_rows(np.column_stack([fit.slopes, *(covariance.floors[name] for name in names)]))
    changes = outside(rows[:, : fit.slopes.shape[1]], rows[:, fit.slopes.shape[1] :])
    return {name: float(np.sqrt(np.mean(change**2))) for name, change in zip(names, changes.T, strict=True)}


def numerical_errors(covariance: Covariance) -> list[str]:
    """Names of the systematic errors that come from the numerics."""
    return [name for name in covariance.floors if not name.startswith((ASSUMED, "protocol of "))]


def _is_limited_by_numerics(baseline: Entry) -> bool:
    """Whether a residual would be significant without the numerical error, which is no small part of the noise."""
    fit, covariance = baseline.fit, baseline.covariance
    assert fit is not None and covariance is not None
    names = numerical_errors(covariance)
    shares = numerical_shares(covariance, fit, names)
    if float(np.linalg.norm(list(shares.values()))) <= THRESHOLDS.numerics_bound_share:
        return False
    exact = replace(covariance, floors={name: d for name, d in covariance.floors.items() if name not in names})
    residual = exact.whiten(measured_rows(covariance.series) - fit.answer)
    bare = replace(fit, residual=residual, jacobian=exact.whiten(fit.slopes))
    return evidence_of(bare, exact, 0).other + log_odds_of_other() > 0.0
