"""Measured curves predicted by the simulator: constants and effects of a model file, in the test of a dataset."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from explicitfe.effects import EFFECTS
from explicitfe.errors import InputError, Progress, RunError, nearest, silent
from explicitfe.measured.curve import PRINTED_UNITS, Curve, programme_of
from explicitfe.measured.read import read_dataset
from explicitfe.predict.experiment import CurveAnswer, effects_of, experiments
from explicitfe.predict.homogeneous import predict_homogeneous
from explicitfe.predict.tissue import Numerics, Tissue, parse_tissue, read_tissue
from explicitfe.predict.under_a_tool import predict_under_a_tool
from explicitfe.results.folder import checked_target
from explicitfe.scenario.sentences import explain
from explicitfe.scenario.table import validated

SUMMARY = "predict.json"


def predict(
    dataset_path: Path | str,
    model_path: Path | str,
    *,
    out: Path | str | None = None,
    curves: Sequence[str] = (),
    refinement: float | None = None,
    density: float | None = None,
    tolerance: float | None = None,
    processes: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Predict the curves of a dataset.

    Parameters
    ----------
    dataset_path : folder of the dataset, or its dataset.toml.
    model_path : model file, see :mod:`explicitfe.predict.tissue`.
    out : folder for predict.json and a CSV a curve; nothing is written if left out.
    curves : ids; all if left out.
    refinement : divides the element sizes; the model's own if left out.
    density : multiplies the numbers of instants of tests under a tool; the model's own if left out.
    tolerance : relative force residual of an equilibrium; the model's own if left out.
    processes : at most so many; one a core if left out.
    overwrite : replace an earlier prediction.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    JSON-able summary; a curve that was not reached has the status "failed", a message, and no prediction.

    Raises
    ------
    InputError : a file, a key or an option that cannot be used.
    """
    begin = time.perf_counter()
    model = read_tissue(model_path)
    dataset = read_dataset(dataset_path)
    if dataset.test == "trajectory":
        raise InputError(f"{dataset.path}: tests of specimens are predicted with a model file; this is a trajectory.")
    model = _computed(model, refinement, density, tolerance)
    target = None if out is None else checked_target(Path(out), overwrite, summary=SUMMARY, what="prediction")
    try:
        dataset = model.grouped(dataset)
    except InputError as error:
        raise InputError(f"{model_path}: {error}") from None
    known = [curve.id for curve in dataset.curves]
    for name in curves:
        if name not in known:
            raise InputError(f'{dataset.path}: there is no curve "{name}"; {nearest(name, known)}')
    wanted = set(curves or known)
    tests = [test for test in experiments(dataset.curves) if wanted & {curve.id for curve in test}]
    found = _all(tests, model, processes, progress)
    rows = {}
    for curve in dataset.curves:
        if curve.id in wanted:
            rows[curve.id] = _row(curve, found[curve.id])
    done = [row for row in rows.values() if row["status"] == "predicted"]
    sides: dict[str, list[float]] = {}
    for row in done:
        sides.setdefault(row["split"] or "all", []).append(row["nrmse"])
    summary: dict[str, Any] = {
        "dataset": dataset.name,
        "model": str(model_path),
        "effects": [EFFECTS_BY[type(effect)] for effect in model.effects.chosen],
        **model.numerics.model_dump(),
        "curves": rows,
        "error": {side: {"curves": len(values), "nrmse": float(np.mean(values))} for side, values in sides.items()},
        "assumed": sorted({text for p in found.values() if isinstance(p, CurveAnswer) for text in p.assumed}),
        "wall_s": time.perf_counter() - begin,
    }
    if target is not None:
        _write(target, summary, model, overwrite)
    return summary


EFFECTS_BY = {kind: name for name, kind in EFFECTS.items()}


# ---- one test ----


def predict_test(
    test: Sequence[Curve],
    model: Tissue,
    *,
    refinement: float | None = None,
    density: float | None = None,
    tolerance: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[CurveAnswer]:
    """What a model answers to the curves of one test, see :func:`experiments`; options as for :func:`predict`.

    Raises
    ------
    InputError : an effect that does not go with the test, no constants for it.
    RunError : a state is not reached.
    """
    first = test[0]
    effects = effects_of(first, model)
    law = model.law(first)
    if first.kind in ("uniaxial", "shear"):
        found = predict_homogeneous(test, law, effects)
        progress(1.0)
        return found
    return predict_under_a_tool(test, law, effects, _computed(model, refinement, density, tolerance).numerics, progress)


def _computed(model: Tissue, refinement: float | None, density: float | None, tolerance: float | None) -> Tissue:
    """The model with other numerics, where they are given."""
    given = {"refinement": refinement, "density": density, "tolerance": tolerance}
    data = model.numerics.model_dump() | {name: value for name, value in given.items() if value is not None}
    try:
        return model.model_copy(update={"numerics": validated(Numerics, data)})
    except ValidationError as error:
        raise InputError(explain(error, data, Numerics)) from None


# ---- homogeneous ----


# ---- under a tool ----


# ---- all tests ----


def _job(test: Sequence[Curve], text: str) -> list[CurveAnswer] | str:
    try:
        return predict_test(test, parse_tissue(text))
    except RunError as error:
        return str(error)


def _all(
    tests: Sequence[Sequence[Curve]],
    model: Tissue,
    processes: int | None,
    progress: Progress,
) -> dict[str, CurveAnswer | str]:
    """Curve -> its prediction, or what went wrong."""
    found: dict[str, CurveAnswer | str] = {}

    def keep(test: Sequence[Curve], answer: list[CurveAnswer] | str) -> None:
        for number, curve in enumerate(test):
            found[curve.id] = answer if isinstance(answer, str) else answer[number]
        progress("predict", len(found) / sum(map(len, tests)))

    progress("predict", 0.0)
    # The first one here: it makes the machine code, which the other processes then only load.
    text = model.text
    keep(tests[0], _job(tests[0], text))
    rest = list(tests[1:])
    workers = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, len(rest))
    workers = min(workers, processes or workers)
    if workers > 1 and tests[0][0].tool is not None:
        try:
            with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
                jobs = {pool.submit(_job, test, text): test for test in rest}
                for job in as_completed(jobs):
                    keep(jobs[job], job.result())
            return found
        except BrokenProcessPool:  # no process can be started from where this one came from
            rest = [test for test in rest if test[0].id not in found]
    for test in rest:
        keep(test, _job(test, text))
    return found


def _row(curve: Curve, found: CurveAnswer | str) -> dict[str, Any]:
    unit, factor = PRINTED_UNITS[curve.predicted]
    measured = factor * curve.columns[curve.predicted]
    way_unit, way = {"displacement_m": ("mm", 1e3), "force_N": ("N", 1.0)}.get(curve.imposed, ("", 1.0))
    row: dict[str, Any] = {
        "status": "predicted",
        "split": curve.split,
        "constants": curve.constants,
        "quantity": curve.predicted.rsplit("_", 1)[0],
        "unit": unit,
        "imposed": curve.imposed if not way_unit else curve.imposed.rsplit("_", 1)[0],
        "imposed_unit": way_unit,
        "rows": {
            "time_s": curve.time_s.tolist(),
            "imposed": (way * programme_of(curve)).tolist(),
            "measured": measured.tolist(),
        },
    }
    if isinstance(found, str):
        return row | {"status": "failed", "message": found}
    values = factor * found.values
    row["rows"]["predicted"] = values.tolist()
    rmse = float(np.sqrt(np.mean((values - measured) ** 2)))
    largest = float(np.abs(measured).max())
    return row | {
        "rmse": rmse,
        "nrmse": rmse / largest if largest > 0.0 else None,
        "largest_measured": largest,
        "instants": found.instants,
        "iterations": found.iterations,
        "seconds": found.seconds,
    }


# ---- on disk ----


def _write(target: Path, summary: dict[str, Any], model: Tissue, overwrite: bool) -> None:
    """predict.json, model.toml and a CSV a curve."""
    try:
        target.mkdir(parents=True, exist_ok=True)
        for old in target.glob("*.csv") if overwrite else ():
            old.unlink()
        files = ["model.toml", SUMMARY]
        (target / "model.toml").write_text(model.text, encoding="utf-8")
        for name, row in summary["curves"].items():
            columns = row["rows"]
            way = f"{row['imposed']}_{row['imposed_unit']}" if row["imposed_unit"] else row["imposed"]
            head = ["time_s", way, *(f"{kind}_{row['quantity']}_{row['unit']}" for kind in columns if kind in SIDES)]
            lines = [",".join(f"{value:.9g}" for value in line) for line in zip(*columns.values(), strict=True)]
            (target / f"{name}.csv").write_text("\n".join([",".join(head), *lines]) + "\n", encoding="utf-8")
            files.append(f"{name}.csv")
        summary["files"] = [str(target / name) for name in files]
        text = json.dumps(summary, indent=1, allow_nan=False)
        (target / SUMMARY).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{target}: this cannot be written ({error.strerror}).") from None


SIDES = ("measured", "predicted")
