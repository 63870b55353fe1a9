"""close-loop for trajectories of sensors; the resulting model is written as a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from explicitfe.inverse.close_loop.comparison import compare
from explicitfe.inverse.close_loop.progress import SearchProgress
from explicitfe.inverse.close_loop.report import (
    LoopDocuments,
    add_failure,
    add_outcome,
    bound_warnings,
    errors_of_model,
    limit_warning,
    new_report,
)
from explicitfe.inverse.close_loop.split import Split
from explicitfe.inverse.close_loop.statistics.budget import OutOfTimeError, SearchLimits
from explicitfe.inverse.close_loop.statistics.refit import BestFit
from explicitfe.inverse.close_loop.statistics.system import Answer
from explicitfe.inverse.close_loop.trajectories.levers import title_of
from explicitfe.inverse.close_loop.trajectories.markers import remarks
from explicitfe.inverse.close_loop.trajectories.paths import moving_markers
from explicitfe.inverse.close_loop.trajectories.trajectories import AXIS_NAMES, Trajectories, trajectory_system
from explicitfe.inverse.close_loop.trajectories.vibration import features_of
from explicitfe.inverse.close_loop.verdict import conclude
from explicitfe.inverse.measured.curve import TrajectoryDataset
from explicitfe.platform.compiled.threads import cores
from explicitfe.platform.errors import InputError, Progress, RunError
from explicitfe.platform.host import stopping
from explicitfe.results.documents.loop_report import CurveError, LoopReport, ReportCurve
from explicitfe.results.documents.motion_report import MarkerMotion, MovingMarkers, ReportedRepeats
from explicitfe.results.documents.report_part import Side
from explicitfe.results.files import provenance

MM_PER_M = 1e3
SCENARIO_FILE, BASELINE_FILE = "scenario.toml", "baseline.toml"


def close_trajectories(
    dataset: TrajectoryDataset,
    sides: Split,
    effects: Sequence[str],
    limits: SearchLimits,
    progress: Progress,
) -> LoopDocuments:
    """The report, curves for its pictures, and the scenarios before and after.

    Raises
    ------
    InputError : no scenario to compare with, or one that cannot be used.
    """
    if dataset.scenario is None:
        raise InputError(f"{dataset.path}: the dataset has no scenario to compare with; add the key scenario.")
    shown = SearchProgress(progress, limits.budget)
    shown.step("", 0.0)
    system = trajectory_system(dataset, sides.fit, limits.processes or cores(), only=tuple(effects), budget=limits.budget)
    report = _new_report(dataset, sides, system.considered, limits.max_effects)
    late: list[str] = []
    try:
        with stopping.checking(limits.budget.check):
            comparison = compare(system, max_effects=limits.max_effects, rows=system.rows, limit=limits.budget, watch=shown.step)
            outcome = conclude(comparison)
            before, after = comparison.baseline.fit, outcome.final.fit
            assert before is not None and after is not None
            add_outcome(report, outcome)
            shown.enter("predict", 0.0)
            try:
                curves = _add_errors(report, system, sides, before, after)
            except OutOfTimeError as error:
                late = [f"held-out curves are not predicted, because {error}."]
                sides = replace(sides, holdout=())
                curves = _add_errors(report, system, sides, before, after)
            markers = _add_motion(report, system, sides, before, after) if system.placed else []
    except (RunError, OutOfTimeError) as error:
        report = _new_report(dataset, sides, system.considered, limits.max_effects)
        add_failure(
            report,
            str(error)
            if isinstance(error, RunError)
            else f"{error} before the effects were screened, so that nothing can be concluded. Give a larger `minutes`.",
        )
        return LoopDocuments(report)
    finally:
        system.runs.workers.close()
    shown.enter("trace", 1.0)
    shown.enter("predict", 1.0)
    report.effect_titles |= {name: title_of(name, system.levers) for name in report.effect_titles}
    report.next_experiment = None
    report.sensitivity_to_assumed = {}
    report.warnings = [*limit_warning(comparison), *late, *_of_markers(system, sides), *_warnings(sides, before, after)]
    files = {SCENARIO_FILE: system.scenario_text(after.model), BASELINE_FILE: system.scenario_text(before.model)}
    return LoopDocuments(report, curves, markers, files)


def _new_report(dataset: TrajectoryDataset, sides: Split, effects: Sequence[str], max_effects: int) -> LoopReport:
    report = new_report(dataset, sides, "mm")
    report.provenance = provenance() | {
        "dataset": str(dataset.path),
        "source": dataset.source,
        "scenario": str(dataset.scenario),
        "effects_considered": list(effects),
        "max_effects": max_effects,
    }
    return report


def _add_errors(report: LoopReport, system: Trajectories, sides: Split, before: BestFit, after: BestFit) -> list[ReportCurve]:
    """Put the rms over the sensors of each curve into the report, and return the coordinates for its pictures."""
    every = system.for_curves((*sides.fit, *sides.holdout))
    split: dict[str, Side] = dict.fromkeys((c.id for c in sides.holdout), "holdout")
    split |= dict.fromkeys((c.id for c in sides.fit), "fit")
    first, final = every.answers([before.model, after.model])
    if first is None or final is None:
        raise RunError("a curve cannot be computed with the final model.")
    rows = every.noise_of_rows(system.unforeseen_m)
    noise = {one.id: float(row.sd.mean()) for one, row in zip(every.series, rows, strict=True)}
    for model, answer in ((report.baseline, first), (report.final, final)):
        model.error = errors_of_model({name: _error_of(name, side, every, answer, noise) for name, side in split.items()})
    return [_drawn(name, side, every, first, final, noise) for name, side in split.items()]


def _add_motion(report: LoopReport, system: Trajectories, sides: Split, before: BestFit, after: BestFit) -> list[MovingMarkers]:
    """Put the features of the motion of each marker into the report, and return the motions for its moving picture."""
    every = system.for_curves((*sides.fit, *sides.holdout))
    moved, tables = [], []
    for curve in every.curves:
        split: Side = "fit" if curve in sides.fit else "holdout"
        one = moving_markers(every, curve, split, before.model, after.model)
        moved.append(one)
        for number, name in enumerate(one.names):
            axis = int(np.argmax(np.nanmax(one.measured[:, number], axis=0) - np.nanmin(one.measured[:, number], axis=0)))
            sides_of = {key: getattr(one, key)[:, number] for key in ("measured", "before", "after")}
            tables.append(
                MarkerMotion(
                    curve=curve.id,
                    marker=name,
                    axis=AXIS_NAMES[axis],
                    **{key: features_of(one.time_s, y[:, axis]) for key, y in sides_of.items()},
                    rms_before=_rms_distance(sides_of["before"], sides_of["measured"]),
                    rms_after=_rms_distance(sides_of["after"], sides_of["measured"]),
                )
            )
    report.motion = tables
    spread = system.repeats
    if spread is not None:
        # two repeats differ by the root of two times the scatter of one, along each axis
        factor = np.sqrt(2.0) * float(np.linalg.norm(spread.share))
        largest = {m.curve: float(np.nanmax(np.linalg.norm(m.measured, axis=2))) for m in moved}
        report.repeats = ReportedRepeats(pairs=spread.pairs, rms={name: factor * size for name, size in largest.items()})
    return moved


def _rms_distance(y: np.ndarray, measured: np.ndarray) -> float | None:
    """Rms distance of two paths (k, 3); None where they have no row in common."""
    square = np.sum((y - measured) ** 2, axis=1)
    return float(np.sqrt(np.nanmean(square))) if np.isfinite(square).any() else None


def _error_of(name: str, side: Side, every: Trajectories, answer: Answer, noise: dict[str, float]) -> CurveError:
    """The error of one curve over all its sensors.

    Parameters
    ----------
    noise : series -> mean noise of its rows [m].
    """
    columns = [(one, y) for one, y in zip(every.series, answer, strict=True) if one.curve == name]
    deviation = np.concatenate([MM_PER_M * (y - one.measured) for one, y in columns])
    largest = max(MM_PER_M * float(np.ptp(one.measured)) for one, _ in columns)
    rmse = float(np.sqrt(np.mean(deviation**2)))
    return CurveError(split=side, rmse=rmse, nrmse=rmse / largest, floor=_floor_mm(name, every, noise) / largest)


def _floor_mm(name: str, every: Trajectories, noise: dict[str, float]) -> float:
    """Rms of the noise of all sensors of a curve [mm]."""
    return MM_PER_M * float(np.sqrt(np.mean([noise[one.id] ** 2 for one in every.series if one.curve == name])))


def _drawn(name: str, side: Side, every: Trajectories, first: Answer, final: Answer, noise: dict[str, float]) -> ReportCurve:
    """The coordinate of a curve that moves most."""
    columns = [entry for entry in zip(every.series, first, final, strict=True) if entry[0].curve == name]
    most, before, after = max(columns, key=lambda entry: float(np.ptp(entry[0].measured)))
    return ReportCurve(
        id=f"{name}, {most.id.removeprefix(name).strip(' /:-')}",
        split=side,
        x_label="time (s)",
        y_label="position (mm)",
        time_s=most.time_s,
        x=most.time_s,
        measured=MM_PER_M * most.measured,
        before=MM_PER_M * before,
        after=MM_PER_M * after,
        sd=np.full(len(most.measured), _floor_mm(name, every, noise)),
    )


def _of_markers(system: Trajectories, sides: Split) -> list[str]:
    """What is wrong with the recordings of markers, and what is fitted in those that are held out."""
    notes = [
        note
        for c in (*sides.fit, *sides.holdout)
        if system.placed
        for note in remarks(c, system.placed[c.id], system.dataset.sensors)
    ]
    free = [c.id for c in sides.holdout if c.start_s is None]
    if free:
        notes.append(
            f"the start of the motion of {' and '.join(free)} is taken where it fits best; nothing else is fitted there."
        )
    return notes


def _warnings(sides: Split, before: BestFit, after: BestFit) -> list[str]:
    notes = [*bound_warnings("before", before), *bound_warnings("after", after)]
    if not sides.holdout:
        notes.append("no curve is held out; the errors are those of fitted curves.")
    if len(sides.fit) == 1:
        notes.append("only one curve is fitted; no effect is claimed, because no other curve can confirm it.")
    return notes
