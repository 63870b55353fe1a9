"""The report of a search: its parts from where the search ended, and the folder on disk, which is written whole or not at all."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from explicitfe.close_loop import words
from explicitfe.close_loop.posterior import Posterior, sureness
from explicitfe.close_loop.search import Outcome, Round, numerical_shares
from explicitfe.close_loop.split import Split
from explicitfe.close_loop.statistics.intervals import intervals, intervals_beside_a_misfit
from explicitfe.close_loop.statistics.refit import BOUND_SHARE, BestFit
from explicitfe.close_loop.thresholds import THRESHOLDS, entries
from explicitfe.effects import EFFECTS
from explicitfe.measured.curve import Dataset
from explicitfe.results.folder import drawing, whole_folder
from explicitfe.results.loop_report import (
    CurveError,
    ErrorsOfModel,
    Estimate,
    LoopReport,
    MeanError,
    NoiseAndFloors,
    NumericalFloor,
    Parameters,
    ReportCurve,
    ReportedCandidate,
    ReportedLackOfFit,
    ReportedModel,
    ReportedNoise,
    ReportedRound,
    ReportedSeparation,
    ReportedSplit,
    ReportedThreshold,
    Side,
)
from explicitfe.results.verdict_text import JOINED_BY, NOTHING, OTHER, sentence

SUMMARY = "report.json"
# An error with several independent parts has a column for each, whose names differ in this.
PART_OF_AN_ERROR = r", part \d+"
SIDES: tuple[Side, Side] = ("fit", "holdout")
# Why a parameter is not determined, as the report says it.
WITHOUT_EFFECT = "its interval includes zero effect"
WHOLE_RANGE = "its interval is its whole range"


@dataclass(frozen=True, eq=False)
class LoopDocuments:
    """What a closed loop leaves.

    Attributes
    ----------
    report : the document.
    curves : of its pictures.
    files : name -> text of the models before and after.
    """

    report: LoopReport
    curves: list[ReportCurve] = field(default_factory=list)
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


def add_outcome(report: LoopReport, outcome: Outcome, before: BestFit, after: BestFit, last: Round) -> None:
    """Put into a report where the search ended; errors are still to come.

    Parameters
    ----------
    before, after : the baseline and the final model.
    last : the round of the final model.
    """
    covariance, first = last.covariance, outcome.rounds[0]
    add_verdict(report, outcome)
    report.remainder_where = words.where(last)
    report.n_eff = covariance.effective
    report.noise = NoiseAndFloors(
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
            for name, share in _in_whole(numerical_shares(covariance, last.fit, list(covariance.floors))).items()
        ],
    )
    report.baseline = ReportedModel(parameters=parameters(before, first))
    report.final = ReportedModel(parameters=parameters(after, last))
    report.undetermined = undetermined(after, report.final.parameters)
    unsure = {name.partition(".")[0] for name, why in report.undetermined.items() if why == WITHOUT_EFFECT}
    report.strength_undetermined = [effect for effect in report.effects if effect in unsure]
    report.separations = [
        ReportedSeparation(a=a, b=b, separation=apart) for one in outcome.rounds for a, b, apart in one.separations
    ]


def add_verdict(report: LoopReport, outcome: Outcome) -> None:
    """Put verdict, effects and rounds of an outcome into a report."""
    best = outcome.rounds[-1].best
    ambiguous = outcome.rounds[-1].ambiguous_with if outcome.verdict in ("ambiguous", "effect-found") else ()
    effects = list(outcome.effects) or ([outcome.rounds[0].best] if ambiguous and outcome.rounds[0].best else [])
    named = [*effects, *ambiguous, *outcome.nearest, *outcome.no_consequence, *([best] if best else [])]
    report.verdict = outcome.verdict
    report.remainder = outcome.remainder
    report.message = outcome.message
    report.effects = effects
    report.effect_titles = {name: words.title(name) for name in named}
    report.nearest = list(outcome.nearest)
    report.no_consequence = list(outcome.no_consequence)
    report.ambiguous_with = list(ambiguous)
    report.steps = [_reported(one) for one in outcome.rounds]


def _in_whole(shares: Mapping[str, float]) -> dict[str, float]:
    """Shares of the noise, those of independent parts of one error taken together."""
    squares: dict[str, float] = {}
    for name, share in shares.items():
        whole = re.sub(PART_OF_AN_ERROR, "", name)
        squares[whole] = squares.get(whole, 0.0) + share**2
    return {name: float(np.sqrt(square)) for name, square in squares.items()}


def parameters(fit: BestFit, judged: Round) -> Parameters:
    """Values with 95 % intervals; those that are shares of what other terms leave as shares of the whole.

    Parameters
    ----------
    judged : the round of the model, whose remainder widens the intervals because it is no noise.
    """
    remainder = judged.lack.chi2 if fit.by_rows is None else fit.by_rows
    worse = 1.0 if judged.at_floor else max(remainder / max(judged.lack.free, 1), 1.0)
    if judged.at_floor or judged.no_consequence:
        limits = iter(intervals(fit, judged.covariance, worse))
    else:
        limits = iter(intervals_beside_a_misfit(fit, judged.covariance, worse, not_rejected(judged)))
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


def not_rejected(judged: Round) -> list[BestFit]:
    """The models with one effect more that explain about as much as the best of them: these data do not say which it is."""
    alike = [fit for fit in judged.refits.values() if (fit.by_rows is None) == (judged.fit.by_rows is None)]
    gains = [judged.fit.chi2 - fit.chi2 for fit in alike]
    most = max(gains, default=0.0)
    return [fit for fit, gain in zip(alike, gains, strict=True) if gain >= THRESHOLDS.alike_gain_share * most and gain > 0.0]


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


def add_probabilities(report: LoopReport, outcome: Outcome, posterior: Posterior) -> None:
    """Put the probabilities of causes and verdict into a report, and the sentence that follows from them."""
    report.posterior = posterior.causes
    effects = {name for cause in report.posterior for name in cause.split(JOINED_BY)} - {NOTHING, OTHER}
    report.effect_titles |= {name: words.title(name) for name in sorted(effects)}
    report.something_else = posterior.something_else
    report.sure = sureness(outcome, posterior)
    report.sentence = sentence(report)


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
    report.steps = []
    report.posterior = {}
    report.ambiguous_with = []
    report.separations = []
    report.next_experiment = None
    report.proposed_tests = []
    report.sensitivity_to_assumed = {}
    report.warnings = []


def _reported(judged: Round) -> ReportedRound:
    """A round as the report has it, with the candidates that explain most first."""
    candidates = []
    for score in sorted(judged.scores, key=lambda s: (-s.drop, s.status)):
        name = score.candidate.effect
        fit = judged.refits.get(name)
        names = [p.name.rpartition(".")[2] for p in score.candidate.term.parameters]
        values = score.values if fit is None else fit.model.values[len(fit.model.x) - len(names) :]
        errors = judged.cv.get(name)
        candidates.append(
            ReportedCandidate(
                effect=name,
                status="failed" if name in judged.failures else score.status,
                chi2_drop=score.drop,
                chi2_drop_refitted=None if fit is None else judged.fit.chi2 - fit.chi2,
                p_holm=score.p_holm,
                p_is_bound=score.p_is_bound,
                cv_nrmse=float(np.mean(list(errors.values()))) if errors else None,
                parameters=dict(zip(names, values, strict=False)),
                reason=judged.failures.get(name) or judged.why_not.get(name, score.reason),
            )
        )
    without = judged.cv.get("")
    return ReportedRound(
        p_residual=judged.p,
        p_is_bound=judged.p_is_bound,
        chi2=judged.fit.chi2,
        lack_of_fit=ReportedLackOfFit(chi2=judged.lack.chi2, free=judged.lack.free, p=judged.lack.p),
        cv_nrmse=float(np.mean(list(without.values()))) if without else None,
        candidates=candidates,
        chosen=judged.chosen,
    )


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


def bound_warnings(stage: str, fit: BestFit) -> list[str]:
    """A sentence that names the parameters at a bound, if there are any."""
    names = ", ".join(dict.fromkeys(fit.at_bound))
    return [f"{stage}: {names} reached a bound; the data favour values beyond it or do not determine it."] if names else []


def write(target: Path, documents: LoopDocuments) -> None:
    """Write the page, its pictures, the models and the report into a folder, as a whole or not at all.

    Raises
    ------
    InputError : the folder cannot be written.
    """
    from explicitfe.view.report import page as loopreport

    report = documents.report
    with whole_folder(target, summary=SUMMARY) as folder:
        names, warnings = [SUMMARY, *documents.files], list(report.warnings)
        with drawing(warnings):
            names += loopreport.write(folder, report, documents.curves)
        report.warnings = warnings
        for name, text in documents.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        report.files = [str(target / name) for name in names]
        (folder / SUMMARY).write_text(report.text, encoding="utf-8")
