"""``explicitfe close-loop``: from a dataset to a verdict, a model file and a report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.close_loop.next_test import next_experiment
from explicitfe.close_loop.report import REPORT_FILE, failure_report, mean_errors, summary_of, write
from explicitfe.close_loop.search import NOISE_SHARE, Outcome, Round, close
from explicitfe.close_loop.specimens.simulator import Simulator
from explicitfe.close_loop.specimens.specimens import COARSE, FINE, Specimens
from explicitfe.close_loop.split import Split, split
from explicitfe.close_loop.statistics.fingerprints import DISTINCT, LEVEL, lack_of_fit
from explicitfe.close_loop.statistics.noise import row_noise
from explicitfe.close_loop.statistics.refit import BestFit, refit
from explicitfe.close_loop.statistics.system import values_by_name
from explicitfe.close_loop.trajectories.close import close_trajectories
from explicitfe.close_loop.trajectories.levers import LEVERS
from explicitfe.effects import EFFECTS
from explicitfe.errors import InputError, Progress, RunError, nearest, silent
from explicitfe.measured.curve import PRINTED_UNITS, Curve, Dataset, programme_of
from explicitfe.measured.read import read_dataset
from explicitfe.predict.experiment import experiments
from explicitfe.results import provenance
from explicitfe.results.folder import checked_target

MODEL, BASELINE = "model.toml", "baseline.toml"
MAX_EFFECTS = 3
VARIED = (0.9, 1.1)  # factors of an assumed length in the table of what it moves
FEW_DATA = 10.0  # independent rows: fewer come with a warning
USUAL_RUNS = 20  # of each test in one turn of the loop; by how many there are, a waiting person sees that it goes on
MISSED = 2.0  # times the worst error of a fitted curve: a held-out curve is missed
AXES = {
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


def close_loop(
    dataset_path: Path | str,
    *,
    out: Path | str | None = None,
    holdout: Sequence[str] = (),
    constants_by: str | None = None,
    effects: Sequence[str] = (),
    max_effects: int = MAX_EFFECTS,
    processes: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Say what a model lacks, given measured curves.

    Parameters
    ----------
    dataset_path : folder of the dataset, or its dataset.toml.
    out : folder for report.html, report.json, pictures and model files; nothing is written if left out.
    holdout : ids of curves that are only predicted; chosen by the dataset or by a rule if left out.
    constants_by : condition, or "group", by which curves share their constants.
    effects : names of those that are considered; all if left out.
    max_effects : most effects (or terms of one) that are added.
    processes : at most so many; one a core if left out.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    What ``report.json`` holds. A fit that cannot be done has the verdict "failed" and a message.

    Raises
    ------
    InputError : a dataset or an option that cannot be used; nothing is written.
    """
    begin = time.perf_counter()
    dataset = read_dataset(dataset_path)
    known = LEVERS if dataset.test == "trajectory" else EFFECTS
    for name in effects:
        if name not in known:
            raise InputError(f"--effects {name}: there is no such effect; {nearest(name, known)}")
    if max_effects < 0:
        raise InputError(f"--max-effects {max_effects}: it must be 0 or more.")
    target = None if out is None else checked_target(Path(out), overwrite, summary=REPORT_FILE, what="report")
    if dataset.test == "trajectory" and constants_by is not None:
        raise InputError(f"{dataset.path}: a trajectory has no constants to group; leave --constants-by out.")
    if constants_by is not None:
        dataset = dataset.regrouped(constants_by)
    sides = split(dataset, holdout)
    if dataset.test == "trajectory":
        found, curves, files = close_trajectories(dataset, sides, effects, max_effects, processes, progress)
        found["provenance"] |= {"wall_s": time.perf_counter() - begin}
        if target is not None:
            write(target, found, curves, files)
        return found
    simulator = Simulator(processes)
    try:
        work = _Work(dataset, sides, simulator, constants_by, tuple(effects), max_effects, progress)
        found, curves, files = work.done()
    finally:
        simulator.close()
    found["provenance"] |= {"wall_s": time.perf_counter() - begin, "runs": simulator.runs}
    if target is not None:
        write(target, found, curves, files)
    return found


class _Work:
    """One closing of the loop on tests of specimens."""

    def __init__(
        self,
        dataset: Dataset,
        sides: Split,
        simulator: Simulator,
        constants_by: str | None,
        effects: tuple[str, ...],
        max_effects: int,
        progress: Progress,
    ) -> None:
        self.dataset, self.sides, self.simulator = dataset, sides, simulator
        self.max_effects, self.progress = max_effects, progress
        self.system = Specimens(dataset, sides.fit, simulator, COARSE, constants_by, effects)
        self.left_out = dict(sides.left_out)
        self._stage, self._since = ("trace", 0.0, 0.0), 0
        self._said: dict[str, float] = {}
        simulator.watch = self._ran

    def _at(self, stage: str, share: float, until: float) -> None:
        """Say that a stage has come to a share; runs from now on lead towards ``until``."""
        self._stage, self._since = (stage, share, until), self.simulator.runs
        self._say(stage, share)

    def _ran(self) -> None:
        stage, share, until = self._stage
        runs = (self.simulator.runs - self._since) / (USUAL_RUNS * len(self.system.tests))
        self._say(stage, share + (until - share) * float(-np.expm1(-runs)))

    def _say(self, stage: str, share: float) -> None:
        """Never less than before: a turn that took many runs may have been thought further than it was."""
        self._said[stage] = max(self._said.get(stage, 0.0), share)
        self.progress(stage, self._said[stage])

    def done(self) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, str]]:
        """The report, curves for its pictures, and texts of the model files."""
        self._at("trace", 0.0, 0.02)
        turn = 0.8 / (self.max_effects + 1)
        try:
            self._leave_out_what_fails()
            closed = close(
                self.system,
                max_effects=self.max_effects,
                single=len(self.system.tests) == 1,
                watch=lambda what, share: self._at("trace", share, min(share + turn, 1.0)),
            )
        except RunError as error:
            return self._head() | failure_report(str(error)), [], {}
        self._at("trace", 1.0, 1.0)
        with_effects = closed.verdict in ("effect-found", "ambiguous") and bool(closed.effects)
        last = closed.steps[-1] if with_effects else closed.steps[0]
        before, after = closed.steps[0].fit, last.fit
        if not self.system.exact(after.model):
            self._at("decide", 0.0, 0.4)
            self.system = replace(self.system, numerics=FINE)
            before = refit(self.system, before.model, last.covariance, slopes=before.slopes)
            self._at("decide", 0.4, 1.0)
            after = refit(self.system, after.model, last.covariance, slopes=after.slopes) if with_effects else before
            self._at("decide", 1.0, 1.0)
        self._at("predict", 0.0, 0.8)
        found = self._head() | summary_of(closed, before, after, last)
        curves = self._errors(found, before, after, last)
        found["sensitivity_to_assumed"] = self._sensitivity(closed, before, after, last)
        self._at("predict", 0.8, 1.0)
        found["next_experiment"] = self._next(closed)
        found["warnings"] = self._warnings(closed, before, after, found)
        self._at("predict", 1.0, 1.0)
        files = {BASELINE: self._file(before, "baseline"), MODEL: self._file(after, closed.verdict)}
        return found, curves, files

    def _leave_out_what_fails(self) -> None:
        """Curves that the simulator cannot follow, with the reason."""
        why = self.system.failing()
        self.left_out |= {name: f"the simulator cannot follow it: {reason}" for name, reason in why.items()}
        kept = tuple(c for c in self.system.curves if c.id not in why)
        if not kept:
            raise RunError(f"the simulator can follow none of the curves: {next(iter(why.values()))}")
        self.system = replace(self.system, curves=kept)

    def _file(self, fit: BestFit, verdict: str) -> str:
        model = self.system.tissue(fit.model)
        return model.model_copy(update={"title": f"{self.dataset.name}: {verdict}"}).text

    # ---- the report ----

    def _head(self) -> dict[str, Any]:
        unit, _ = PRINTED_UNITS[self.system.curves[0].predicted]
        return {
            "dataset": self.dataset.name,
            "title": self.dataset.title,
            "unit": unit,
            "split": {
                "fit": [c.id for c in self.system.curves],
                "holdout": [c.id for c in self.sides.holdout],
                "left_out": self.left_out,
                "rule": self.sides.rule,
            },
            "provenance": provenance()
            | {
                "dataset": str(self.dataset.path),
                "source": self.dataset.source,
                "constants_by": self.system.constants_by,
                "effects_considered": list(self.system.only) or list(EFFECTS),
                "max_effects": self.max_effects,
            },
        }

    def _errors(self, found: dict[str, Any], before: BestFit, after: BestFit, last: Round) -> list[dict[str, Any]]:
        """Errors of all curves before and after, put into the report; the curves for its pictures."""
        every = (*self.system.curves, *self.sides.holdout)
        tests = experiments(every)
        models = [self.system.tissue(fit.model) for fit in (before, after)]
        answers = self.simulator.run([(test, model.text) for model in models for test in tests])
        shown: dict[str, dict[str, Any]] = {}
        floors = {one.id: last.covariance.floor_of(k) for k, one in enumerate(last.covariance.series)}
        if self.sides.holdout:
            others = replace(self.system, curves=self.sides.holdout).series
            spread = last.covariance.scatter.scale  # equal tests differ by it: no model foretells which way
            for one, row in zip(others, row_noise(others), strict=True):
                floors[one.id] = float(np.sqrt(np.mean(row.sd**2) + spread**2 * np.mean(one.measured**2)))
        for side, part in (("baseline", answers[: len(tests)]), ("final", answers[len(tests) :])):
            rows: dict[str, dict[str, Any]] = {}
            for test, answer in zip(tests, part, strict=True):
                for number, curve in enumerate(test):
                    factor = PRINTED_UNITS[curve.predicted][1]
                    measured = factor * curve.columns[curve.predicted]
                    largest = float(np.abs(measured).max())
                    row = rows.setdefault(curve.id, {"split": curve.split})
                    if isinstance(answer, str):
                        rows[curve.id] = row | {"rmse": None, "nrmse": None, "floor": None, "message": answer}
                        continue
                    values = factor * answer[number]
                    rmse = float(np.sqrt(np.mean((values - measured) ** 2)))
                    floor = factor * floors[curve.id]
                    share = max(largest, 1e-300)
                    rows[curve.id] = row | {"rmse": rmse, "nrmse": rmse / share, "floor": floor / share}
                    here = shown.setdefault(curve.id, _shown(curve, measured, floor))
                    here["before" if side == "baseline" else "after"] = values
            found[side]["error"] = {name: mean_errors(rows, name) for name in ("fit", "holdout")} | {"curves": rows}
        return [shown[c.id] for c in every if len(shown.get(c.id, {})) and {"before", "after"} <= set(shown[c.id])]

    def _sensitivity(self, closed: Outcome, before: BestFit, after: BestFit, last: Round) -> dict[str, Any]:
        """What each assumed length moves: constants, error and verdict, by a refit of both models."""
        found: dict[str, Any] = {}
        if closed.verdict == "failed":
            return found
        for factor in VARIED:
            for name, curves in self.system.assumed(factor).items():
                changed = replace(self.system, curves=curves, numerics=COARSE)
                plain = replace(last.covariance, floors={k: d for k, d in last.covariance.floors.items() if name not in k})
                table, _, key = name.partition(".")
                row: dict[str, Any] = {"value": float(getattr(getattr(curves[0], table), key))}
                try:
                    first = closed.steps[0].fit
                    one = refit(changed, first.model, plain, slopes=first.slopes)
                    other = refit(changed, last.fit.model, plain, slopes=last.fit.slopes) if after is not before else one
                except RunError as error:
                    found.setdefault(name, []).append(row | {"verdict": "failed", "message": str(error)})
                    continue
                kept = closed.verdict
                if after is not before and one.chi2 - other.chi2 < DISTINCT:
                    kept = "no-missing-effect" if lack_of_fit(one, plain).p > LEVEL else "unexplained"
                if after is before and closed.verdict == "no-missing-effect" and lack_of_fit(one, plain).p <= LEVEL:
                    kept = "unexplained"
                effects = list(closed.effects) if kept == closed.verdict else []
                row |= {"verdict": kept, "effects": effects, "parameters": values_by_name(other.model)}
                row["error_fit"] = float(np.mean(_errors_of(changed, other)))
                found.setdefault(name, []).append(row)
        return {name: sorted(rows, key=lambda r: r["value"]) for name, rows in found.items()}

    def _next(self, closed: Outcome) -> dict[str, Any] | None:
        """A test that would tell apart what these data cannot."""
        step = closed.steps[-1]
        if not step.ambiguous_with or step.best is None:
            return None
        found = []
        for rival in (name for name in step.ambiguous_with if name in step.refits):
            pair = step.refits[step.best], step.refits[rival]
            tool = replace(self.system, numerics=COARSE)
            found.append(next_experiment(tool, *pair, step.covariance, (step.best, rival)))
        known = [entry for entry in found if entry is not None]
        # the hardest pair decides
        return min(known, key=lambda entry: entry["separation"]) if known else None

    def _warnings(self, closed: Outcome, before: BestFit, after: BestFit, found: dict[str, Any]) -> list[str]:
        notes = []
        for when, fit in (("before", before), ("after", after)):
            if fit.at_bound:
                notes.append(
                    f"{when}: {', '.join(dict.fromkeys(fit.at_bound))} ended at a bound: the data want more, or do not care."
                )
            if not fit.converged:
                notes.append(f"{when}: the search for the best parameters stopped before it settled.")
        if not self.sides.holdout:
            notes.append("no curve is held out: errors are those of curves that were fitted.")
        doubted = [r["curve"] for r in found["noise"]["rows"] if not r["stated"]]
        if doubted:
            notes.append(f"noise not stated, or rows rougher than stated: estimated from the rows of {', '.join(doubted)}.")
        if found["n_eff"] < FEW_DATA:
            notes.append(f"n_eff is {found['n_eff']:.1f}: so few independent rows show only what is very strong.")
        if len({c.group for c in self.system.curves}) > 1 and found["noise"]["scatter_source"] == "unknown":
            notes.append(
                "several specimens, no repeats and no repeat_sd_fraction: scatter between them would count as an effect."
            )
        if len(self.system.tests) == 1:
            notes.append("one test only: nothing that it shows can be confirmed by another, so no effect is claimed.")
        for entry in found["noise"]["numerical"]:
            if entry["share_of_noise"] > NOISE_SHARE and "assumed" not in entry["what"]:
                share = f"{entry['share_of_noise']:.2g}"
                notes.append(f"with {entry['what']} the answer changes by {share} of the noise, beyond the constants: a floor.")
        held = [
            name
            for name, row in found["final"]["error"]["curves"].items()
            if row["split"] == "holdout" and row["rmse"] is not None
        ]
        errors = found["final"]["error"]
        if closed.verdict in ("effect-found", "no-missing-effect") and errors["fit"]:
            usual = max(row["nrmse"] for row in errors["curves"].values() if row["split"] == "fit" and row["nrmse"] is not None)
            far = [name for name in held if (errors["curves"][name]["nrmse"] or 0.0) > MISSED * usual]
            if far:
                notes.append(f"held out and missed by more than any fitted curve: {', '.join(far)}; the verdict stands.")
        for name, row in found["final"]["error"]["curves"].items():
            if row.get("message"):
                notes.append(f"{name}: {row['message']}")
        return notes


def _errors_of(system: Specimens, fit: BestFit) -> list[float]:
    ends = np.cumsum([len(one.measured) for one in system.series])[:-1]
    parts = np.split(fit.answer, ends)
    return [
        float(np.sqrt(np.mean((part - one.measured) ** 2)) / np.abs(one.measured).max())
        for one, part in zip(system.series, parts, strict=True)
    ]


def _shown(curve: Curve, measured: np.ndarray, floor: float) -> dict[str, Any]:
    label, factor = AXES[curve.imposed]
    return {
        "id": curve.id,
        "split": curve.split,
        "x_label": label,
        "y_label": Y_AXES[curve.predicted],
        "time_s": curve.time_s,
        "x": factor * programme_of(curve),
        "measured": measured,
        "sd": np.full(len(measured), floor),
    }
