"""The loop closed on tests of specimens; what is found is written back as a tissue."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TypeVar

import numpy as np

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.compared import Entry
from explicitfe.inverse.close_loop.comparison import compare
from explicitfe.inverse.close_loop.discovery.report import add_discovered_law
from explicitfe.inverse.close_loop.evidence import cost_of_term
from explicitfe.inverse.close_loop.next_test import next_tests, survivors
from explicitfe.inverse.close_loop.progress import RUNS_OF_A_STEP, SearchProgress
from explicitfe.inverse.close_loop.report import (
    SIGNIFICANT_P,
    LoopDocuments,
    add_failure,
    add_outcome,
    bound_warnings,
    errors_of_model,
    limit_warning,
    new_report,
)
from explicitfe.inverse.close_loop.specimens.lengths import with_assumed_lengths
from explicitfe.inverse.close_loop.specimens.series import determined
from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.inverse.close_loop.specimens.specimens import CORRECTED, Specimens
from explicitfe.inverse.close_loop.specimens.trials import COARSE
from explicitfe.inverse.close_loop.split import Split
from explicitfe.inverse.close_loop.statistics.budget import OutOfTimeError, SearchLimits
from explicitfe.inverse.close_loop.statistics.covariance import Covariance
from explicitfe.inverse.close_loop.statistics.lack_of_fit import lack_of_fit
from explicitfe.inverse.close_loop.statistics.noise import row_noise
from explicitfe.inverse.close_loop.statistics.refit import BestFit, refit
from explicitfe.inverse.close_loop.statistics.system import values_by_name
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.inverse.close_loop.verdict import Outcome, conclude, numerical_errors, numerical_shares
from explicitfe.inverse.measured.curve import PRINTED_UNITS, Curve, SpecimenDataset, programme_of
from explicitfe.inverse.measured.tables import RigLimits
from explicitfe.platform.errors import Progress, RunError
from explicitfe.platform.host import stopping
from explicitfe.results.documents.loop_report import (
    AssumedValue,
    CurveError,
    LoopReport,
    NextExperiment,
    ReportCurve,
    ReportedModel,
    Verdict,
)
from explicitfe.results.files import provenance

Found = TypeVar("Found")
MODEL_FILE, BASELINE_FILE = "model.toml", "baseline.toml"
PREDICT_PROGRESS = 0.3  # share of the stage "predict" at which its second part begins
# Fewer independent rows show only what is very strong. A held-out curve is missed if its error is so many times the worst one of
# the fitted curves.
FEW_DATA, MISSED_FACTOR = 10.0, 2.0
X_AXES = {
    "displacement_m": ("displacement (mm)", 1e3),
    "force_N": ("force (N)", 1.0),
    "stretch": ("stretch", 1.0),
    "shear_strain": ("shear", 1.0),
}
Y_AXES = {
    "displacement_m": "displacement (mm)",
    "force_N": "force (N)",
    "nominal_stress_Pa": "nominal stress (Pa)",
    "shear_stress_Pa": "shear stress (Pa)",
}


def close_specimens(
    dataset: SpecimenDataset,
    sides: Split,
    constants_by: str | None,
    effects: Sequence[str],
    limits: SearchLimits,
    progress: Progress,
) -> LoopDocuments:
    """The report, curves for its pictures, and the tissues before and after."""
    simulator = Simulator(limits.processes, limits.budget)
    try:
        with stopping.checking(limits.budget.check):
            documents = _SpecimenLoop(dataset, sides, simulator, constants_by, tuple(effects), limits, progress).close()
    finally:
        simulator.workers.close()
    documents.report.provenance["runs"] = limits.budget.spent
    return documents


class _SpecimenLoop:
    """One closing of the loop on tests of specimens."""

    def __init__(
        self,
        dataset: SpecimenDataset,
        sides: Split,
        simulator: Simulator,
        constants_by: str | None,
        effects: tuple[str, ...],
        limits: SearchLimits,
        progress: Progress,
    ) -> None:
        self.dataset, self.sides, self.simulator, self.limits = dataset, sides, simulator, limits
        self.system = Specimens(dataset, sides.fit, simulator, CORRECTED, constants_by, effects)
        self.progress = SearchProgress(progress, limits.budget, RUNS_OF_A_STEP * len(self.system.tests))
        self.omitted: list[str] = []  # what was not computed, because the limit on the time was reached

    # ---- the loop ----

    def close(self) -> LoopDocuments:
        """The report, curves for its pictures, and texts of the model files."""
        try:
            self.progress.step("", 0.0)
            self._leave_out_what_fails()
            limits = self.limits
            outcome = conclude(
                compare(self.system, max_effects=limits.max_effects, limit=limits.budget, watch=self.progress.step)
            )
        except (RunError, OutOfTimeError) as error:
            report = self._new_report()
            add_failure(
                report,
                str(error)
                if isinstance(error, RunError)
                else f"{error} before the effects were screened, so that nothing can be concluded. Give a larger `minutes`.",
            )
            return LoopDocuments(report)
        self.progress.enter("predict", 0.0, PREDICT_PROGRESS)
        comparison, before, after = outcome.comparison, outcome.comparison.baseline, outcome.final
        report = self._new_report()
        add_outcome(report, outcome)
        curves = self._add_errors(report, before, after)
        self.progress.enter("predict", PREDICT_PROGRESS)
        if comparison.ended and with_assumed_lengths(self.system.curves, 1.0):
            self.omitted.append("the effect of assumed lengths")
        elif not comparison.ended:
            report.sensitivity_to_assumed = self._unless_late(
                "the effect of assumed lengths", {}, self._sensitivity, before, after
            )
        report.proposed_tests = self._unless_late("next tests", [], self._proposed_tests, outcome)
        report.next_experiment = next(iter(report.proposed_tests), None)
        files = {BASELINE_FILE: self._tissue_text(before, "baseline"), MODEL_FILE: self._tissue_text(after, outcome.verdict)}
        held_out = self.sides.holdout
        law: dict[str, str] = {}
        files |= self._unless_late("a composed law", law, add_discovered_law, report, self.system, held_out, after)
        left = limit_warning(comparison)
        if self.omitted:
            left.append(f"not computed, because a limit was reached: {', '.join(self.omitted)}.")
        report.warnings = [*left, *self._warnings(report, before, after), *report.warnings]
        self.progress.enter("trace", 1.0)
        self.progress.enter("predict", 1.0)
        return LoopDocuments(report, curves, files=files)

    def _unless_late(self, what: str, nothing: Found, find: Callable[..., Found], *arguments: object) -> Found:
        """What is found until the limit on the time is reached, and ``nothing`` after it."""
        try:
            return find(*arguments)
        except OutOfTimeError:
            self.omitted.append(what)
            return nothing

    def _leave_out_what_fails(self) -> None:
        """Leave out the curves that the simulator cannot follow, with the reason."""
        why = self.system.failing()
        reasons = {name: f"simulation failed: {reason}" for name, reason in why.items()}
        self.sides = replace(self.sides, left_out=self.sides.left_out | reasons)
        followed = tuple(c for c in self.system.curves if c.id not in why)
        if not followed:
            raise RunError(f"no curve can be simulated: {next(iter(why.values()))}")
        self.system = replace(self.system, curves=followed)

    def _tissue_text(self, entry: Entry, title: str) -> str:
        tissue = self.system.tissue(entry.model)
        return tissue.model_copy(update={"title": f"{self.dataset.name}: {title}"}).text

    # ---- the report ----

    def _new_report(self) -> LoopReport:
        unit, _ = PRINTED_UNITS[self.system.curves[0].predicted]
        report = new_report(self.dataset, replace(self.sides, fit=self.system.curves), unit)
        report.provenance = provenance() | {
            "dataset": str(self.dataset.path),
            "source": self.dataset.source,
            "constants_by": self.system.constants_by,
            "effects_considered": list(self.system.only) or list(EFFECTS),
            "max_effects": self.limits.max_effects,
        }
        return report

    def _add_errors(self, report: LoopReport, before: Entry, after: Entry) -> list[ReportCurve]:
        """Put the errors of all curves before and after into the report, and return the curves for its pictures."""
        every = (*self.system.curves, *self.sides.holdout)
        system = replace(self.system, curves=every)
        assert after.covariance is not None and after.fit is not None
        floors = self._floors(after.covariance, after.fit.slopes)
        answers: list[dict[str, np.ndarray]] = []
        models: tuple[ReportedModel, ReportedModel] = (report.baseline, report.final)
        for model, entry in zip(models, (before, after), strict=True):
            errors: dict[str, CurveError] = {}
            answers.append({})
            for curve, answer in self._predictions(entry, system):
                if isinstance(answer, str):
                    errors[curve.id] = CurveError(split=curve.split, rmse=None, nrmse=None, floor=None, message=answer)
                    continue
                factor = PRINTED_UNITS[curve.predicted][1]
                measured = factor * curve.columns[curve.predicted]
                values = factor * answer
                rmse = float(np.sqrt(np.mean((values - measured)[determined(curve)] ** 2)))
                floor = factor * floors[curve.id]
                largest = max(float(np.abs(measured).max()), 1e-300)
                errors[curve.id] = CurveError(split=curve.split, rmse=rmse, nrmse=rmse / largest, floor=floor / largest)
                answers[-1][curve.id] = values
            model.error = errors_of_model(errors)
        first, final = answers
        return [_drawn(c, first[c.id], final[c.id], floors[c.id]) for c in every if c.id in first and c.id in final]

    def _predictions(self, entry: Entry, system: Specimens) -> list[tuple[Curve, np.ndarray | str]]:
        """Predictions of a model for all curves; after the limit on the time those of the fitted curves, which are known."""
        try:
            return system.at(entry.model).answers_or_reasons(entry.model, ramps=True)
        except OutOfTimeError as error:
            known: list[tuple[Curve, np.ndarray | str]] = []
            if isinstance(entry.system, Specimens):
                with suppress(OutOfTimeError):
                    known = entry.system.answers_or_reasons(entry.model, ramps=True)
            return [*known, *((curve, f"not predicted, because {error}") for curve in self.sides.holdout)]

    def _floors(self, covariance: Covariance, slopes: np.ndarray) -> dict[str, float]:
        """Curve -> rms [SI] that noise and numerics leave by themselves, of the fitted and of the held-out curves."""
        floors = {one.id: covariance.floor_of(k, slopes) for k, one in enumerate(covariance.series)}
        if self.sides.holdout:
            others = replace(self.system, curves=self.sides.holdout).series
            spread = covariance.scatter.scale  # equal tests differ by so much, and no model foretells in which direction
            for one, row in zip(others, row_noise(others), strict=True):
                floors[one.id] = float(np.sqrt(np.mean(row.sd**2) + spread**2 * np.mean(one.measured**2)))
        return floors

    def _sensitivity(self, before: Entry, after: Entry) -> dict[str, list[AssumedValue]]:
        """Assumed length -> what follows if it is smaller or larger, by a refit of both models."""
        share = THRESHOLDS.assumed_length_error_share
        rows: dict[str, list[AssumedValue]] = {}
        for factor in (1.0 - share, 1.0 + share):
            for name, curves in with_assumed_lengths(self.system.curves, factor).items():
                table, _, key = name.partition(".")
                value = float(getattr(getattr(curves[0], table), key))
                changed = replace(self.system.at(after.model), curves=curves)
                rows.setdefault(name, []).append(_with_assumed(value, name, changed, before, after))
        return rows

    def _proposed_tests(self, outcome: Outcome) -> list[NextExperiment]:
        """Tests that would settle best what is open; none where a run of a mesh is expensive and hardly anything is open.

        Nor are there any where something that no candidate describes is probable: what tells wrong causes apart settles nothing.
        """
        if outcome.verdict == "unexplained":
            return []
        settled = outcome.verdict in ("no-missing-effect", "effect-found") and outcome.sure > THRESHOLDS.majority_probability
        if settled and self.system.costly(outcome.final.model):
            return []
        assert outcome.final.covariance is not None
        causes = survivors(self.system, outcome.comparison)
        system = replace(self.system, numerics=COARSE, corrections={})  # tests are compared by differences of answers
        return next_tests(system, causes, outcome.final.covariance, self.dataset.rig or RigLimits())

    def _warnings(self, report: LoopReport, before: Entry, after: Entry) -> list[str]:
        notes = []
        for stage, fit in (("before", before.fit), ("after", after.fit)):
            assert fit is not None
            notes += bound_warnings(stage, fit)
            if not fit.converged:
                notes.append(f"{stage}: the fit did not converge.")
        if not self.sides.holdout:
            notes.append("no curve is held out: the errors are those of fitted curves.")
        doubted = [row.curve for row in report.noise.rows if row.curve is not None and not row.stated]
        if doubted:
            notes.append(f"noise not stated or larger than stated: estimated from the rows of {', '.join(doubted)}.")
        if report.n_eff is not None and report.n_eff < FEW_DATA:
            notes.append(f"only {report.n_eff:.1f} independent rows (n_eff): only strong effects are detectable.")
        if len({c.group for c in self.system.curves}) > 1 and report.noise.scatter_source == "unknown":
            notes.append(
                "several specimens without repeats or repeat_sd_fraction: scatter between specimens may be taken for an effect."
            )
        if len(self.system.tests) == 1:
            notes.append("one test only: how much equal tests differ is unknown, and no other test confirms the cause.")
        assert after.fit is not None and after.covariance is not None
        shares = numerical_shares(after.covariance, after.fit, numerical_errors(after.covariance))
        for what, share in shares.items():
            if share > THRESHOLDS.numerics_bound_share:
                notes.append(f"numerical error: {what} changes the prediction by {share:.2g} times the noise.")
        errors = report.final.error
        if report.verdict in ("effect-found", "no-missing-effect") and errors.fit:
            usual = max(c.nrmse for c in errors.curves.values() if c.split == "fit" and c.nrmse is not None)
            held = {name: c.nrmse for name, c in errors.curves.items() if c.split == "holdout" and c.rmse is not None}
            missed = [name for name, nrmse in held.items() if (nrmse or 0.0) > MISSED_FACTOR * usual]
            if missed:
                notes.append(f"held-out curves with a larger error than any fitted curve: {', '.join(missed)}.")
        notes += [f"{name}: {curve.message}" for name, curve in errors.curves.items() if curve.message]
        return notes


def _with_assumed(value: float, name: str, changed: Specimens, before: Entry, after: Entry) -> AssumedValue:
    """What follows if an assumed length has another value.

    Parameters
    ----------
    name : of the length, such as "tool.radius_mm".
    changed : the tests with this value.
    """
    assert before.fit is not None and after.fit is not None and after.covariance is not None
    floors = {k: d for k, d in after.covariance.floors.items() if name not in k}
    covariance = replace(after.covariance, floors=floors)
    try:
        one = refit(changed, before.model, covariance, slopes=before.fit.slopes)
        other = refit(changed, after.model, covariance, slopes=after.fit.slopes) if after.key else one
    except RunError as error:
        return AssumedValue(value=value, verdict="failed", message=str(error))
    gain = 0.5 * (one.whitened - other.whitened) - sum(
        cost_of_term(len(term.parameters), covariance.effective, 0.0) for term in after.model.terms
    )
    still = bool(after.key) and gain > 0.0
    open_end = lack_of_fit(other, covariance).p < SIGNIFICANT_P
    verdict: Verdict = "unexplained" if open_end else "effect-found" if still else "no-missing-effect"
    return AssumedValue(
        value=value,
        verdict=verdict,
        effects=sorted(set(after.key)) if still else [],
        parameters=dict(values_by_name(other.model)),
        error_fit=float(np.mean(_errors_of(changed, other))),
    )


def _errors_of(system: Specimens, fit: BestFit) -> list[float]:
    """Rms deviation of each series as a share of its largest value."""
    ends = np.cumsum([len(one.measured) for one in system.series])[:-1]
    parts = np.split(fit.answer, ends)
    return [
        float(np.sqrt(np.mean((part - one.measured) ** 2)) / np.abs(one.measured).max())
        for one, part in zip(system.series, parts, strict=True)
    ]


def _drawn(curve: Curve, before: np.ndarray, after: np.ndarray, floor: float) -> ReportCurve:
    """A curve for the report's pictures; answers are in the unit of the axis, and the floor is in SI."""
    label, factor = X_AXES[curve.imposed]
    _, y_factor = PRINTED_UNITS[curve.predicted]
    measured = y_factor * curve.columns[curve.predicted]
    return ReportCurve(
        id=curve.id,
        split=curve.split,
        x_label=label,
        y_label=Y_AXES[curve.predicted],
        time_s=curve.time_s,
        x=factor * programme_of(curve),
        measured=measured,
        before=before,
        after=after,
        sd=np.full(len(measured), y_factor * floor),
    )
