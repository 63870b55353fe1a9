"""The report of a search: its parts from where the search ended, and the folder on disk, which is written whole or not at all."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.compared import ComparedCauses, Entry
from explicitfe.inverse.close_loop.evidence import Causes
from explicitfe.inverse.close_loop.split import Split
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, outside
from explicitfe.inverse.close_loop.statistics.intervals import intervals, intervals_beside_a_misfit, widened
from explicitfe.inverse.close_loop.statistics.refit import BOUND_SHARE, BestFit
from explicitfe.inverse.close_loop.statistics.signatures import Signature
from explicitfe.inverse.close_loop.thresholds import entries
from explicitfe.inverse.close_loop.verdict import Outcome, decision_on, numerical_shares
from explicitfe.inverse.measured.curve import Dataset
from explicitfe.results.documents.loop_report import (
    CurveError,
    ErrorsOfModel,
    Estimate,
    LoopReport,
    MeanError,
    NoiseAndFloors,
    NumericalFloor,
    Parameters,
    ReportCurve,
    ReportedCause,
    ReportedHypothesis,
    ReportedLackOfFit,
    ReportedModel,
    ReportedNoise,
    ReportedSplit,
    ReportedThreshold,
)
from explicitfe.results.documents.motion_report import MovingMarkers
from explicitfe.results.documents.report_part import Side
from explicitfe.results.documents.verdict_text import JOINED_BY, NOTHING, sentence

SUMMARY = "report.json"
# An error with several independent parts has a column for each, whose names differ in this.
PART_OF_AN_ERROR = r", part \d+"
SIDES: tuple[Side, Side] = ("fit", "holdout")
# Why a parameter is not determined, as the report says it.
WITHOUT_EFFECT = "its interval includes zero effect"
WHOLE_RANGE = "its interval is its whole range"
# The report lists at most so many hypotheses.
MOST_HYPOTHESES = 40
# Hypotheses that a warning names.
MOST_NAMED = 5
# Intervals of constants hold those of all models whose probability is at least this share of that of the final one.
ALIKE_SHARE = 0.05
# A residual with a smaller p-value is no noise, and widens the intervals.
SIGNIFICANT_P = 0.01
# The report names at most this many parts of the data: those with the largest misfit.
NAMED_PARTS = 3
# The first fifth of a test is called early, the last late; the lowest quarter of the load low, the highest high.
EARLY_SHARE, LOW_LOAD_SHARE = 0.2, 0.25
# A part is named if its mean square exceeds that of all rows by this factor, and if it is no smaller share of them than this.
CONCENTRATED_FACTOR, SMALLEST_PART_SHARE = 1.5, 0.05
# Causes with several forms; the name of a cause is that of its usual form.
CAUSES = {"viscoelastic": "relaxation", "stiffness-gradient": "stiffness that changes with depth"}


@dataclass(frozen=True, eq=False)
class LoopDocuments:
    """What a closed loop leaves.

    Attributes
    ----------
    report : the document.
    curves : of its pictures.
    markers : of its moving picture, for recordings of markers.
    files : name -> text of the models before and after.
    """

    report: LoopReport
    curves: list[ReportCurve] = field(default_factory=list)
    markers: list[MovingMarkers] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)


def new_report(dataset: Dataset, sides: Split, unit: str) -> LoopReport:
    """A report of which only the head is filled: the data, the split, the thresholds.

    Parameters
    ----------
    unit : of the predicted quantity, for people.
    """
    return LoopReport(
        dataset=dataset.name,
        title=dataset.title,
        unit=unit,
        split=ReportedSplit(
            fit=[c.id for c in sides.fit],
            holdout=[c.id for c in sides.holdout],
            left_out=sides.left_out,
            rule=sides.rule,
        ),
        thresholds={name: ReportedThreshold(value=value, unit=of_what) for name, value, of_what, _ in entries()},
    )


def add_outcome(report: LoopReport, outcome: Outcome) -> None:
    """Put into a report what was compared, the verdict and the models; errors are still to come."""
    comparison, final = outcome.comparison, outcome.final
    fit, covariance = final.fit, final.covariance
    assert fit is not None and covariance is not None and comparison.baseline.fit is not None
    named = outcome.verdict in ("effect-found", "ambiguous")
    report.verdict, report.remainder, report.cut_off = outcome.verdict, outcome.remainder, bool(comparison.ended)
    report.sure = None if report.cut_off else outcome.sure
    report.effects = list(outcome.effects) if named else []
    report.nearest = list(outcome.effects) if outcome.verdict == "unexplained" else []
    report.ambiguous_with = list(outcome.undecided)
    report.credible = [set_in_words(causes) for causes in outcome.credible] if outcome.verdict == "ambiguous" else []
    report.posterior = comparison.posterior.by_words
    report.something_else = comparison.posterior.something_else
    report.causes = _causes(comparison)
    report.hypotheses = _hypotheses(comparison)
    report.compared = len(comparison.entries)
    report.fitted = sum(one.fit is not None for one in comparison.entries)
    effects = {name for one in report.hypotheses for name in one.effects} | set(report.causes) | set(comparison.not_testable)
    report.effect_titles = {name: title_of(name) for name in sorted(effects)}
    lack = final.evidence.lack
    report.lack_of_fit = ReportedLackOfFit(chi2=lack.chi2, free=lack.free, p=lack.p)
    report.discrepancy = float(np.sqrt(max(lack.chi2 - lack.free, 0.0) / max(covariance.effective, 1.0)))
    report.remainder_where = where_concentrated(fit, covariance) if outcome.remainder == "unexplained" else ""
    report.n_eff = covariance.effective
    report.noise = _noise(final)
    report.baseline = ReportedModel(parameters=parameters(comparison.baseline, []))
    report.final = ReportedModel(parameters=parameters(final, _as_probable(outcome)))
    report.undetermined = undetermined(fit, report.final.parameters)
    unsure = {name.partition(".")[0] for name, why in report.undetermined.items() if why == WITHOUT_EFFECT}
    report.strength_undetermined = [effect for effect in report.effects if effect in unsure]
    report.sentence = sentence(report)


def _noise(final: Entry) -> NoiseAndFloors:
    """Noise of the rows, scatter of the tests and systematic errors of a model."""
    assert final.fit is not None and final.covariance is not None
    covariance = final.covariance
    return NoiseAndFloors(
        rows=[
            ReportedNoise(
                curve=one.id,
                sd=one.factor * float(np.sqrt(np.mean(row.sd**2))),
                rho=row.correlation,
                stated=row.stated,
                n=len(row.sd),
                n_eff=row.effective,
            )
            for one, row in zip(covariance.series, covariance.rows, strict=True)
        ],
        scale_sd=covariance.scatter.scale,
        offset_sd=covariance.scatter.offset,
        scatter_source=covariance.scatter.source,
        numerical=[
            NumericalFloor(what=name, share_of_noise=share)
            for name, share in _in_whole(numerical_shares(covariance, final.fit, list(covariance.floors))).items()
        ],
    )


def _causes(comparison: ComparedCauses) -> dict[str, ReportedCause]:
    """Each cause with the decision on it, the most probable first, then those that are not testable."""
    posterior = comparison.posterior
    inclusion = posterior.inclusion
    by_effect = {one.candidate.effect: one for one in comparison.signatures if one.values}
    reported: dict[str, ReportedCause] = {}
    for cause, p in inclusion.items():
        forms = comparison.forms_of(cause)
        strengths = {
            name: comparison.detectable(by_effect[name]) for name in by_effect if comparison.cause_of.get(name, name) == cause
        }
        usual = min(strengths, key=lambda name: (name != cause, name), default=None)
        reported[cause] = ReportedCause(
            title=title_of_cause(cause),
            decision=decision_on(p),
            probability=p,
            forms=forms,
            parameter=None if usual is None else by_effect[usual].candidate.term.parameters[0].name,
            detectable=None if usual is None else strengths[usual],
            detectable_share=None if usual is None else _share_of_largest(by_effect[usual], strengths[usual]),
        )
    for effect, reason in comparison.not_testable.items():
        cause = comparison.cause_of.get(effect, effect)
        if cause not in reported:
            reported[cause] = ReportedCause(title=title_of_cause(cause), decision="not-testable", reason=reason)
    return reported


def _share_of_largest(signature: Signature, strength: float) -> float:
    """A strength as a share of the largest plausible one of the same sign."""
    sought = signature.candidate.term.parameters[0].sought
    end = sought.high if strength > sought.none else sought.low
    x, none, largest = (sought.coordinate(v) for v in (strength, sought.none, end))
    return (x - none) / (largest - none) if largest != none else 1.0


def _hypotheses(comparison: ComparedCauses) -> list[ReportedHypothesis]:
    """The most probable hypotheses, and those that could not be computed."""
    base = comparison.baseline.fit
    assert base is not None
    reported = []
    for one, p in comparison.probabilities()[:MOST_HYPOTHESES]:
        chi2 = None if one.fit is None else one.fit.whitened
        names = [p.name for p in one.model.parameters[len(one.model.base) :]]
        reported.append(
            ReportedHypothesis(
                causes=sorted(one.causes),
                effects=list(one.key),
                probability=p,
                fitted=one.fit is not None,
                chi2=chi2,
                decrease=None if chi2 is None else base.whitened - chi2,
                bound=None if one.fit is not None else one.bound,
                parameters=dict(zip(names, one.model.values[len(one.model.base) :], strict=True)),
            )
        )
    return reported + [
        ReportedHypothesis(
            causes=sorted({comparison.cause_of.get(name, name) for name in key}), effects=list(key), fitted=False, reason=reason
        )
        for key, reason in comparison.failed.items()
    ]


def _as_probable(outcome: Outcome) -> list[BestFit]:
    """Fits of other hypotheses that are not much less probable: nothing decides between their constants."""
    entries = outcome.comparison.probabilities()
    least = max((p for one, p in entries if one is outcome.final), default=0.0) * ALIKE_SHARE
    return [one.fit for one, p in entries if one.fit is not None and one is not outcome.final and p >= least > 0.0]


def _in_whole(shares: Mapping[str, float]) -> dict[str, float]:
    """Shares of the noise, those of independent parts of one error taken together."""
    squares: dict[str, float] = {}
    for name, share in shares.items():
        whole = re.sub(PART_OF_AN_ERROR, "", name)
        squares[whole] = squares.get(whole, 0.0) + share**2
    return {name: float(np.sqrt(square)) for name, square in squares.items()}


def parameters(entry: Entry, others: Sequence[BestFit]) -> Parameters:
    """Values with 95 % intervals; those that are shares of what other terms leave as shares of the whole.

    Parameters
    ----------
    others : other models that are about as probable; the constants of the baseline may be those of each.
    """
    fit, covariance = entry.fit, entry.covariance
    assert fit is not None and covariance is not None
    lack = entry.evidence.lack
    remainder = lack.chi2 if fit.by_rows is None else fit.by_rows
    if lack.p > SIGNIFICANT_P and fit.by_rows is None:
        limits = iter(widened(intervals(fit, covariance), fit, others, covariance))
    else:
        limits = iter(intervals_beside_a_misfit(fit, covariance, max(remainder / max(lack.free, 1), 1.0), others))
    values = iter(fit.model.values)
    reported: Parameters = {}
    for p in fit.model.base:
        value, (low, high) = next(values), next(limits)
        estimate = Estimate(value=value, ci95=[low, high])
        if p.name in ("C10_Pa", "C20_Pa"):
            groups = reported.setdefault(p.name, {})
            assert isinstance(groups, dict)
            groups[p.group or "all"] = estimate
        else:
            reported[p.name] = estimate
    left: dict[str, float] = {}  # effect -> the share that its terms leave
    for term in fit.model.terms:
        shares = EFFECTS[term.effect].shares_of_remainder if term.effect in EFFECTS else ()
        for p in term.parameters:
            value, (low, high) = next(values), next(limits)
            by = 1.0
            if p.name.rpartition(".")[2] in shares:
                by = left.get(term.effect, 1.0)
                left[term.effect] = by * (1.0 - value)
            reported[p.name] = Estimate(value=by * value, ci95=[by * low, by * high])
    return reported


def undetermined(fit: BestFit, reported: Parameters) -> dict[str, str]:
    """Parameter of an effect that the data do not determine -> why: with its strength at none, or anywhere in its range."""
    why: dict[str, str] = {}
    for term in fit.model.terms:
        for number, p in enumerate(term.parameters):
            estimate = reported[p.name]
            assert isinstance(estimate, Estimate)
            low, high = estimate.ci95
            edge = BOUND_SHARE * (p.sought.high - p.sought.low)
            if number == 0 and low - edge <= p.sought.none <= high + edge:
                why[p.name] = WITHOUT_EFFECT
            elif low <= p.sought.low + edge and high >= p.sought.high - edge:
                why[p.name] = WHOLE_RANGE
    return why


def add_failure(report: LoopReport, message: str) -> None:
    """Put into a report that nothing could be fitted, and why."""
    report.verdict = "failed"
    report.remainder = "unexplained"
    report.remainder_where = ""
    report.message = message
    report.sentence = sentence(report)
    report.effects = []
    report.effect_titles = {}
    report.undetermined = {}
    report.strength_undetermined = []
    report.n_eff = 0.0
    report.baseline = ReportedModel(parameters={}, error=ErrorsOfModel())
    report.final = ReportedModel(parameters={}, error=ErrorsOfModel())
    report.posterior = {}
    report.ambiguous_with = []
    report.next_experiment = None
    report.proposed_tests = []
    report.sensitivity_to_assumed = {}
    report.warnings = []


def errors_of_model(curves: dict[str, CurveError]) -> ErrorsOfModel:
    """The errors of all curves, and their means over each side of the split."""
    fit, holdout = (_mean_error(curves, side) for side in SIDES)
    return ErrorsOfModel(fit=fit, holdout=holdout, curves=curves)


def _mean_error(curves: Mapping[str, CurveError], side: Side) -> MeanError | None:
    """The mean error of the curves of one side that could be computed; None if there is none."""
    errors = [(c.nrmse, c.rmse) for c in curves.values() if c.split == side and c.nrmse is not None and c.rmse is not None]
    if not errors:
        return None
    nrmse, rmse = (float(np.mean(column)) for column in zip(*errors, strict=True))
    return MeanError(nrmse=nrmse, rmse=rmse)


def limit_warning(comparison: ComparedCauses) -> list[str]:
    """A sentence on the limit that has ended a search, with the hypotheses that were not fitted and their probability."""
    if not comparison.ended:
        return []
    left = list(dict.fromkeys(comparison.left))
    mass = sum(p for one, p in comparison.probabilities() if one.key in left and one.fit is None)
    names = ", ".join(" + ".join(key) for key in left[:MOST_NAMED])
    more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
    open_ones = (
        f"not fitted, or not to the end: {names}{more}, with {100.0 * mass:.2g} % of the probability by estimates"
        if left
        else ("larger sets of effects were not compared")
    )
    return [f"{comparison.ended}; {open_ones}. Give a larger `simulations` or `minutes` to continue."]


def bound_warnings(stage: str, fit: BestFit) -> list[str]:
    """A sentence that names the parameters at a bound, if there are any."""
    names = ", ".join(dict.fromkeys(fit.at_bound))
    return [f"{stage}: {names} reached a bound; the data favour values beyond it or do not determine it."] if names else []


def title_of(effect: str) -> str:
    """An effect in words."""
    return EFFECTS[effect].about.title if effect in EFFECTS else effect.replace("-", " ")


def title_of_cause(cause: str) -> str:
    """A cause in words."""
    return CAUSES.get(cause) or title_of(cause)


def set_in_words(causes: Causes) -> str:
    """A set of causes as a key of the posterior."""
    return JOINED_BY.join(sorted(causes)) or NOTHING


def where_concentrated(fit: BestFit, covariance: Covariance) -> str:
    """Where the residual is concentrated: in which phase, early or late, at low or high load, in which curves."""
    # The square of what the constants cannot explain, row by row.
    squares = outside(fit.movable, fit.residual) ** 2
    early, low = EARLY_SHARE, LOW_LOAD_SHARE
    parts: dict[str, np.ndarray] = {}
    for one, part in zip(covariance.series, covariance.slices(), strict=True):
        load, duration = np.abs(one.measured), one.time_s[-1]
        masks = {
            **{f"in {name}": one.phase == name for name in ("loading", "unloading")},
            "in the hold": one.phase == "hold",
            "early": one.time_s < early * duration,
            "late": one.time_s > (1.0 - early) * duration,
            "at low load": load < low * load.max(),
            "at high load": load > (1.0 - low) * load.max(),
            f"in curve {one.id}": np.ones(len(load), dtype=bool),
        }
        for name, mask in masks.items():
            whole = parts.setdefault(name, np.zeros(len(squares), dtype=bool))
            whole[part] |= mask
    mean = float(squares.mean())
    smallest = SMALLEST_PART_SHARE
    concentrated = [
        (float(squares[mask].mean()) / mean, name)
        for name, mask in parts.items()
        if smallest * len(squares) <= mask.sum() < (1.0 - smallest) * len(squares)
        and squares[mask].mean() > CONCENTRATED_FACTOR * mean
    ]
    if not concentrated:
        return "The residual is spread over all curves."
    words = [f"{name} ({times:.1f} times the mean)" for times, name in sorted(concentrated, reverse=True)[:NAMED_PARTS]]
    return f"The residual is largest {', '.join(words)}."
