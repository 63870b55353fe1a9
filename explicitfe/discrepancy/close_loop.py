"""``explicitfe close-loop``: from a dataset to a verdict, a model file and a report."""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.discrepancy import words
from explicitfe.discrepancy.fingerprints import DISTINCT, LEVEL, lack_of_fit
from explicitfe.discrepancy.loop import NOISE_SHARE, Closed, Step, close, numerical_share
from explicitfe.discrepancy.nextexperiment import next_experiment
from explicitfe.discrepancy.noise import row_noise
from explicitfe.discrepancy.refit import Fitted, intervals, refit
from explicitfe.discrepancy.specimens import COARSE, FINE, Simulator, Specimens
from explicitfe.discrepancy.split import Split, split
from explicitfe.discrepancy.system import described
from explicitfe.effects import EFFECTS
from explicitfe.errors import InputError, RunError, nearest
from explicitfe.identify.dataset import Curve, Dataset, read_dataset
from explicitfe.identify.modelfile import ModelFile
from explicitfe.identify.predict import UNITS, experiments
from explicitfe.identify.selection import imposed
from explicitfe.identify.writing import checked_target
from explicitfe.results import provenance

Report = Callable[[str, float], None]
SUMMARY, MODEL, BASELINE = "report.json", "model.toml", "baseline.toml"
MAX_EFFECTS = 3
VARIED = (0.9, 1.1)  # factors of an assumed length in the table of what it moves
FEW_DATA = 10.0
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
    report: Report = lambda stage, share: None,
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
    report : called with the stage and the share of it that is done.

    Returns
    -------
    What ``report.json`` holds. A fit that cannot be done has the verdict "failed" and a message.

    Raises
    ------
    InputError : a dataset or an option that cannot be used; nothing is written.
    """
    begin = time.perf_counter()
    dataset = read_dataset(dataset_path)
    for name in effects:
        if name not in EFFECTS:
            raise InputError(f"--effects {name}: there is no such effect; {nearest(name, EFFECTS)}")
    if max_effects < 0:
        raise InputError(f"--max-effects {max_effects}: it must be 0 or more.")
    target = None if out is None else checked_target(Path(out), overwrite, summary=SUMMARY, what="report")
    if constants_by is not None:
        dataset = dataset.regrouped(constants_by)
    sides = split(dataset, holdout)
    simulator = Simulator(processes)
    try:
        work = _Work(dataset, sides, simulator, constants_by, tuple(effects), max_effects, report)
        found, curves, models = work.done()
    finally:
        simulator.close()
    found["provenance"] |= {"wall_s": time.perf_counter() - begin, "runs": simulator.runs}
    if target is not None:
        _write(target, found, curves, models)
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
        report: Report,
    ) -> None:
        self.dataset, self.sides, self.simulator = dataset, sides, simulator
        self.max_effects, self.report = max_effects, report
        self.system = Specimens(dataset, sides.fit, simulator, COARSE, constants_by, effects)
        self.left_out = dict(sides.left_out)
        self.warnings: list[str] = []

    def done(self) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, ModelFile]]:
        """The report, curves for its pictures, and the model files."""
        self.report("trace", 0.0)
        try:
            self._leave_out_what_fails()
            closed = close(
                self.system,
                max_effects=self.max_effects,
                single=len(self.system.tests) == 1,
                watch=lambda what, share: self.report("trace", share),
            )
        except RunError as error:
            return self._failed(str(error)), [], {}
        self.report("trace", 1.0)
        with_effects = closed.verdict in ("effect-found", "ambiguous") and bool(closed.effects)
        last = closed.steps[-1] if with_effects else closed.steps[0]
        before, after = closed.steps[0].fit, last.fit
        if not self.system.exact:
            self.report("decide", 0.0)
            self.system = replace(self.system, numerics=FINE)
            before = refit(self.system, before.model, last.covariance, slopes=before.slopes)
            self.report("decide", 0.4)
            after = refit(self.system, after.model, last.covariance, slopes=after.slopes) if with_effects else before
            self.report("decide", 1.0)
        self.report("predict", 0.0)
        found = self._told(closed, before, after, last)
        curves = self._errors(found, before, after, last)
        found["sensitivity_to_assumed"] = self._sensitivity(closed, before, after, last)
        self.report("predict", 0.8)
        found["next_experiment"] = self._next(closed)
        found["warnings"] = self._warnings(closed, before, after, found)
        self.report("predict", 1.0)
        models = {BASELINE: self._file(before, "baseline"), MODEL: self._file(after, closed.verdict)}
        return found, curves, models

    def _leave_out_what_fails(self) -> None:
        """Curves that the simulator cannot follow, with the reason."""
        why = self.system.failing()
        self.left_out |= {name: f"the simulator cannot follow it: {reason}" for name, reason in why.items()}
        kept = tuple(c for c in self.system.curves if c.id not in why)
        if not kept:
            raise RunError(f"the simulator can follow none of the curves: {next(iter(why.values()))}")
        self.system = replace(self.system, curves=kept)

    def _file(self, fit: Fitted, verdict: str) -> ModelFile:
        model = self.system.model(fit.model)
        return model.model_copy(update={"title": f"{self.dataset.name}: {verdict}"})

    # ---- the report ----

    def _failed(self, message: str) -> dict[str, Any]:
        return self._head() | {
            "verdict": "failed",
            "remainder": "unexplained",
            "remainder_where": "",
            "sentence": f"The fit failed: {message} This says nothing about what the model lacks.",
            "message": message,
            "effects": [],
            "effect_titles": {},
            "n_eff": 0.0,
            "baseline": {"parameters": {}, "error": {}},
            "final": {"parameters": {}, "error": {}},
            "steps": [],
            "ambiguous_with": [],
            "separations": [],
            "next_experiment": None,
            "sensitivity_to_assumed": {},
            "warnings": [],
        }

    def _head(self) -> dict[str, Any]:
        unit, _ = UNITS[self.system.curves[0].predicted]
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

    def _told(self, closed: Closed, before: Fitted, after: Fitted, last: Step) -> dict[str, Any]:
        covariance, first = last.covariance, closed.steps[0]
        numerical = numerical_share(covariance, last.fit, list(covariance.floors))
        rows = [
            {
                "curve": one.id,
                "sd": one.factor * float(np.sqrt(np.mean(row.sd**2))),
                "rho": row.correlation,
                "stated": row.stated,
                "n": len(row.sd),
                "n_eff": row.effective,
            }
            for one, row in zip(covariance.series, covariance.rows, strict=True)
        ]
        ambiguous = closed.steps[-1].ambiguous_with if closed.verdict in ("ambiguous", "effect-found") else ()
        best = closed.steps[-1].best
        effects = list(closed.effects) or ([first.best] if ambiguous and first.best else [])
        names = [*effects, *ambiguous, *closed.nearest, *([best] if best else [])]
        return self._head() | {
            "verdict": closed.verdict,
            "remainder": closed.remainder,
            "remainder_where": words.where(last),
            "sentence": words.sentence(closed),
            "message": closed.message,
            "effects": effects,
            "effect_titles": {name: words.title(name) for name in names},
            "nearest": list(closed.nearest),
            "n_eff": covariance.effective,
            "noise": {
                "rows": rows,
                "scale_sd": covariance.scatter.scale,
                "offset_sd": covariance.scatter.offset,
                "scatter_source": covariance.scatter.source,
                "numerical": [{"what": name, "share_of_noise": share} for name, share in numerical.items()],
            },
            "baseline": {"parameters": self._parameters(before, first)},
            "final": {"parameters": self._parameters(after, last)},
            "steps": [_told_step(step) for step in closed.steps],
            "ambiguous_with": list(ambiguous),
            "separations": [{"a": a, "b": b, "separation": apart} for step in closed.steps for a, b, apart in step.separations],
        }

    def _parameters(self, fit: Fitted, step: Step) -> dict[str, Any]:
        """Values with 95 % intervals; those of a series as the model file states them."""
        # What is left unexplained is no noise: it widens the intervals.
        worse = 1.0 if step.at_floor else max(step.lack.chi2 / max(step.lack.free, 1), 1.0)
        found: dict[str, Any] = {}
        left = 1.0
        for p, value, (low, high) in zip(fit.model.parameters, fit.model.values, intervals(fit, worse), strict=True):
            by = 1.0
            if p.name.startswith("viscoelastic.") and p.name.endswith(".g"):
                by, left = left, left * (1.0 - value)
            entry = {"value": by * value, "ci95": [by * low, by * high]}
            if len(found) < 2 * len(self.system.groups) and p.name in ("C10_Pa", "C20_Pa"):
                found.setdefault(p.name, {})[p.group or "all"] = entry
            else:
                found[p.name] = entry
        return found

    def _errors(self, found: dict[str, Any], before: Fitted, after: Fitted, last: Step) -> list[dict[str, Any]]:
        """Errors of all curves before and after, put into the report; the curves for its pictures."""
        every = (*self.system.curves, *self.sides.holdout)
        tests = experiments(every)
        models = [self.system.model(fit.model) for fit in (before, after)]
        answers = self.simulator.run([(test, model.text) for model in models for test in tests])
        shown: dict[str, dict[str, Any]] = {}
        floors = {one.id: last.covariance.floor_of(k) for k, one in enumerate(last.covariance.series)}
        if self.sides.holdout:
            others = replace(self.system, curves=self.sides.holdout).series
            floors |= {one.id: float(np.sqrt(np.mean(row.sd**2))) for one, row in zip(others, row_noise(others), strict=True)}
        for side, part in (("baseline", answers[: len(tests)]), ("final", answers[len(tests) :])):
            rows: dict[str, dict[str, Any]] = {}
            for test, answer in zip(tests, part, strict=True):
                for number, curve in enumerate(test):
                    factor = UNITS[curve.predicted][1]
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
            found[side]["error"] = {name: _mean(rows, name) for name in ("fit", "holdout")} | {"curves": rows}
        return [shown[c.id] for c in every if len(shown.get(c.id, {})) and {"before", "after"} <= set(shown[c.id])]

    def _sensitivity(self, closed: Closed, before: Fitted, after: Fitted, last: Step) -> dict[str, Any]:
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
                row |= {"verdict": kept, "effects": effects, "parameters": described(other.model)}
                row["error_fit"] = float(np.mean(_errors_of(changed, other)))
                found.setdefault(name, []).append(row)
        return {name: sorted(rows, key=lambda r: r["value"]) for name, rows in found.items()}

    def _next(self, closed: Closed) -> dict[str, Any] | None:
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

    def _warnings(self, closed: Closed, before: Fitted, after: Fitted, found: dict[str, Any]) -> list[str]:
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
                notes.append(f"{entry['what']} changes the answer by {share} of the noise, beyond the constants: a floor.")
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


def _told_step(step: Step) -> dict[str, Any]:
    rows = []
    for score in sorted(step.scores, key=lambda s: (-s.drop, s.status)):
        name = score.candidate.effect
        fit = step.refits.get(name)
        names = [p.name.rpartition(".")[2] for p in score.candidate.term.parameters]
        values = score.values if fit is None else fit.model.values[len(fit.model.x) - len(names) :]
        errors = step.cv.get(name)
        rows.append(
            {
                "effect": name,
                "status": "failed" if name in step.failures else score.status,
                "chi2_drop": score.drop,
                "chi2_drop_refitted": None if fit is None else step.fit.chi2 - fit.chi2,
                "p_holm": score.p_holm,
                "cv_nrmse": float(np.mean(list(errors.values()))) if errors else None,
                "parameters": dict(zip(names, values, strict=False)),
                "reason": step.failures.get(name, score.reason),
            }
        )
    without = step.cv.get("")
    return {
        "p_residual": step.p,
        "chi2": step.fit.chi2,
        "lack_of_fit": {"chi2": step.lack.chi2, "free": step.lack.free, "p": step.lack.p},
        "cv_nrmse": float(np.mean(list(without.values()))) if without else None,
        "candidates": rows,
        "chosen": step.chosen,
    }


def _mean(rows: dict[str, dict[str, Any]], side: str) -> dict[str, float] | None:
    mine = [row for row in rows.values() if row["split"] == side and row["rmse"] is not None]
    if not mine:
        return None
    return {key: float(np.mean([row[key] for row in mine if row[key] is not None])) for key in ("nrmse", "rmse")}


def _errors_of(system: Specimens, fit: Fitted) -> list[float]:
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
        "x": factor * imposed(curve),
        "measured": measured,
        "sd": np.full(len(measured), floor),
    }


def _write(target: Path, found: dict[str, Any], curves: list[dict[str, Any]], models: dict[str, ModelFile]) -> None:
    """A whole folder or nothing: written beside, then moved."""
    from explicitfe.view import loopreport

    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise InputError(f"{target}: this cannot be written ({error.strerror}).") from None
    try:
        beside.chmod(0o755)
        names = [SUMMARY, *loopreport.write(beside, found, curves), *models]
        for name, model in models.items():
            (beside / name).write_text(model.text, encoding="utf-8")
        found["files"] = [str(target / name) for name in names]
        (beside / SUMMARY).write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        old = None
        if target.exists():
            old = target.with_name(f".{target.name}-old-{beside.name[-8:]}")
            target.rename(old)
        beside.rename(target)
        if old is not None:
            shutil.rmtree(old)
    except OSError as error:
        raise InputError(f"{target}: this cannot be written ({error.strerror}).") from None
    finally:
        if beside.exists():
            shutil.rmtree(beside)
