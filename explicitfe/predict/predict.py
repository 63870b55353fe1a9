"""Measured curves predicted by the simulator: constants and effects of a model file, in the test of a dataset."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from explicitfe.effects import EFFECTS, Effect, MaterialEffect, Measurement
from explicitfe.effects.material.compressible import Compressible
from explicitfe.effects.material.fibres import Fibres
from explicitfe.effects.reading.cycle_drift import CycleDrift
from explicitfe.effects.tool.preload import Preload
from explicitfe.errors import InputError, Progress, RunError, nearest, silent
from explicitfe.materials.yeoh import Yeoh
from explicitfe.measured.course import Course, course_of
from explicitfe.measured.curve import Curve, programme_of, sd_of
from explicitfe.measured.read import read_dataset
from explicitfe.model.specimen import specimen_model
from explicitfe.predict.platens import UNIFORM, Platens
from explicitfe.predict.setup import is_uniform, setup_of
from explicitfe.predict.tissue import ModelFile, Numerics, parse_model, read_model
from explicitfe.results.folder import checked_target
from explicitfe.scenario.indentation import SpecimenTable, ToolTable
from explicitfe.scenario.sentences import explain
from explicitfe.scenario.table import validated
from explicitfe.solve import point
from explicitfe.solve.equilibrium import Relaxation, Stuck

SUMMARY = "predict.json"
UNITS = {"displacement_m": ("mm", 1e3), "force_N": ("N", 1.0), "nominal_stress_Pa": ("Pa", 1.0), "shear_stress_Pa": ("Pa", 1.0)}
ALONG, ACROSS = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)  # fibres, where the load is along z
DIRECTIONS = {"fibre": ALONG, "cross-fibre": ACROSS}
NOMINAL = 1e-5  # of stretch: a column that follows its programme so closely is the programme
CLOSE = 2e-3  # of a curve's peak: what halving the increments may change
HALVINGS = 5
CAREFUL, EARLY = 4, 1.2  # parts of the step in which a tool may lose contact; it may if 1.2 times the last fall would do
LIFTS = {"sphere": 1.5}  # power of the way with which the force of a tool falls to nothing; 1 for flat ones


@dataclass(frozen=True)
class Predicted:
    """What a model answers to one curve.

    Attributes
    ----------
    values : (k,) predicted column in SI, at the rows of the data.
    instants : number of states that were computed for it.
    iterations : of dynamic relaxation; 0 for a homogeneous state.
    seconds : that it took.
    assumed : what was supposed of the test, in words.
    """

    values: np.ndarray
    instants: int
    iterations: int
    seconds: float
    assumed: tuple[str, ...] = field(default=())


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
    model = read_model(model_path)
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
        "assumed": sorted({text for p in found.values() if isinstance(p, Predicted) for text in p.assumed}),
        "wall_s": time.perf_counter() - begin,
    }
    if target is not None:
        _write(target, summary, model, overwrite)
    return summary


EFFECTS_BY = {kind: name for name, kind in EFFECTS.items()}


# ---- one test ----


def experiments(curves: Sequence[Curve]) -> list[tuple[Curve, ...]]:
    """Curves that are one test each; cycles of one group, specimen and tool are one test, one after the other.

    What a tissue remembers goes on from cycle to cycle; each begins a row's step after the last one ended.
    """
    tests: dict[Any, list[Curve]] = {}
    for curve in curves:
        cycle = curve.conditions.get("cycle")
        key: Any = curve.id
        if isinstance(cycle, int | float) and not isinstance(cycle, bool):
            other = {k: v for k, v in curve.conditions.items() if k not in ("cycle", "preload_N", "first_force_N", "defect")}
            key = (curve.constants, curve.group, repr(curve.specimen), repr(curve.tool), json.dumps(other, sort_keys=True))
        tests.setdefault(key, []).append(curve)
    return [tuple(sorted(test, key=lambda c: c.conditions.get("cycle", 0))) for test in tests.values()]


def predict_test(
    test: Sequence[Curve],
    model: ModelFile,
    *,
    refinement: float | None = None,
    density: float | None = None,
    tolerance: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Predicted]:
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
        found = _homogeneous(test, law, effects)
        progress(1.0)
        return found
    return _under_a_tool(test, law, effects, _computed(model, refinement, density, tolerance).numerics, progress)


def _computed(model: ModelFile, refinement: float | None, density: float | None, tolerance: float | None) -> ModelFile:
    """The model with other numerics, where they are given."""
    given = {"refinement": refinement, "density": density, "tolerance": tolerance}
    data = model.numerics.model_dump() | {name: value for name, value in given.items() if value is not None}
    try:
        return model.model_copy(update={"numerics": validated(Numerics, data)})
    except ValidationError as error:
        raise InputError(explain(error, data, Numerics)) from None


def effects_of(curve: Curve, model: ModelFile) -> tuple[Effect, ...]:
    """The model's effects as they stand in the test of a curve: fibres turned, the preload that was measured."""
    found: list[Effect] = []
    for effect in model.effects.chosen:
        if isinstance(effect, Fibres) and curve.conditions.get("direction") in DIRECTIONS:
            effect = effect.model_copy(update={"direction": DIRECTIONS[curve.conditions["direction"]]})
        if isinstance(effect, Preload) and "preload_N" in curve.conditions:
            effect = effect.model_copy(update={"force_N": max(float(curve.conditions["preload_N"]), 0.0)})
        found.append(effect)
    return tuple(found)


def has_waits(effects: Sequence[Effect]) -> bool:
    """Whether anything happens to the material while nothing moves."""
    return any(isinstance(effect, MaterialEffect) and effect.values(1.0) != effect.values(0.0) for effect in effects)


def _starts(test: Sequence[Curve]) -> list[float]:
    """Time at which each curve of a test begins, s."""
    starts = [0.0]
    for before, curve in pairwise(test):
        starts.append(starts[-1] + float(before.time_s[-1] + (curve.time_s[1] - curve.time_s[0])))
    return starts


def cycle_of(curve: Curve) -> float:
    """Number of a repeat or cycle; 1 where the dataset gives none."""
    number = curve.conditions.get("repeat", curve.conditions.get("cycle", 1))
    return float(number) if isinstance(number, int | float) else 1.0


# ---- homogeneous ----


def _homogeneous(test: Sequence[Curve], law: Yeoh, effects: Sequence[Effect]) -> list[Predicted]:
    begin = time.perf_counter()
    material: list[MaterialEffect] = []
    readings: list[CycleDrift] = []
    for effect in effects:
        if isinstance(effect, MaterialEffect):
            material.append(effect)
        elif isinstance(effect, Compressible):
            law = law.model_copy(update={"poisson": effect.poisson})
        elif isinstance(effect, CycleDrift):
            readings.append(effect)
        else:
            raise InputError(f'curve "{test[0].id}": {effect.about.title} needs a tool, and this is a homogeneous state.')
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(test, _starts(test), strict=True)])
    way = np.concatenate([programme_of(curve) for curve in test])
    row = np.searchsorted(time_s, time_s)
    if len(test) == 1:
        time_s, way = _with_corner(test[0])
        row = np.searchsorted(time_s, test[0].time_s)
    stress, count = _followed(test[0].kind, law, material, time_s, way)
    answers = stress[row]
    found = []
    seconds = (time.perf_counter() - begin) / len(test)
    for curve in test:
        values, answers = answers[: len(curve.time_s)], answers[len(curve.time_s) :]
        for effect in readings:
            values = effect.read_force(values, curve.time_s, cycle_of(curve))
        found.append(Predicted(values, count, 0, seconds))
    return found


def _with_corner(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Rows with the corner between ramp and hold, where the stretch is a programme and no measurement."""
    t, x = curve.time_s, programme_of(curve)
    rate, most = curve.conditions.get("rate_per_s"), curve.conditions.get("max_strain")
    if curve.kind != "uniaxial" or not rate or not most:
        return t, x
    sign = -1.0 if x[np.argmax(np.abs(x - 1.0))] < 1.0 else 1.0
    corner = most / rate
    programme = 1.0 + sign * np.minimum(rate * t, most)
    if np.abs(x - programme).max() > NOMINAL or not t[0] < corner < t[-1] or np.abs(t - corner).min() < 1e-9 * corner:
        return t, x
    at = int(np.searchsorted(t, corner))
    return np.insert(t, at, corner), np.insert(x, at, 1.0 + sign * most)


def _followed(
    kind: str, law: Yeoh, effects: Sequence[MaterialEffect], time_s: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, int]:
    """Stress [Pa] at the rows, with increments halved until that changes little; the number of instants."""

    def at(parts: int) -> np.ndarray:
        times = np.interp(np.arange((len(time_s) - 1) * parts + 1) / parts, np.arange(len(time_s)), time_s)
        ways = np.interp(times, time_s, way)
        times, ways = _rest(kind, times, ways)
        stress = point.shear(law, effects, times, ways) if kind == "shear" else point.uniaxial(law, effects, times, ways)
        return stress[len(times) - 1 - (len(time_s) - 1) * parts :: parts]

    if not any(effect.memory for effect in effects):
        return at(1), len(time_s)
    parts, now = 1, at(1)
    for _ in range(HALVINGS):
        before, parts = now, 2 * parts
        now = at(parts)
        if np.abs(now - before).max() <= CLOSE * np.abs(now).max():
            break
    return now, (len(time_s) - 1) * parts + 1


def _rest(kind: str, time_s: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The path from rest on: where the first row is strained already, that happens at once."""
    rest = 0.0 if kind == "shear" else 1.0
    if way[0] == rest:
        return time_s, way
    return np.concatenate([time_s[:1], time_s]), np.concatenate([[rest], way])


# ---- under a tool ----


def _under_a_tool(
    test: Sequence[Curve],
    law: Yeoh,
    effects: Sequence[Effect],
    numerics: Numerics,
    progress: Callable[[float], None],
) -> list[Predicted]:
    begin = time.perf_counter()
    first = test[0]
    by_force = first.imposed == "force_N"
    readings = [effect for effect in effects if isinstance(effect, Measurement)]
    physics = [effect for effect in effects if not isinstance(effect, Measurement)]
    setup = setup_of(first, law.poisson, numerics.refinement)
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(test, _starts(test), strict=True)])
    way = np.concatenate([true_way(programme_of(curve), curve, readings, by_force) for curve in test])
    tied = first.tool.shape == "bonded-disc"
    uniform = is_uniform(setup) and not by_force and all(isinstance(effect, UNIFORM) for effect in physics)
    sd = sd_of(first, first.imposed) or 0.0
    lifts = None if by_force or tied else LIFTS.get(first.tool.shape, 1.0)
    course = course_of(time_s, way, sd=sd, waits=has_waits(physics), density=numerics.density, touches=not tied)
    iterations = 0
    if uniform:
        size = first.specimen
        made = Platens.of(law, physics, 1e-3 * size.thickness_mm, 1e-6 * size.face_mm2)
        try:
            course, answers, lost = made.followed(course)
            lifts = lifts if lost else None
        except RunError:  # the simulator gets there by smaller steps
            uniform = False
    if not uniform:
        data = dict(setup.specimen)
        if data["symmetry"] == "sector" and any(isinstance(e, Fibres) and any(e.direction[:2]) for e in physics):
            data["symmetry"] = "quarter"
        specimen = SpecimenTable(**data, material=law.model_dump())
        # One thread: tests are shared out among processes, and what is predicted does not depend on the machine's cores.
        body = Relaxation(specimen_model(specimen, ToolTable(**setup.tool), physics), numerics.tolerance, threads=1)
        body.compile()
        course, answers, iterations = _driven(body, course, by_force, lifts is not None, first.id, progress)
    values = course.at(answers, time_s, lifts)
    seconds = (time.perf_counter() - begin) / len(test)
    found = []
    for curve in test:
        mine, values = values[: len(curve.time_s)], values[len(curve.time_s) :]
        instants, shared = len(course.time_s) // len(test), iterations // len(test)
        found.append(Predicted(reading(mine, curve, readings, by_force), instants, shared, seconds, setup.assumed))
    return found


def _driven(
    body: Relaxation, course: Course, by_force: bool, lifts: bool, name: str, progress: Callable[[float], None]
) -> tuple[Course, np.ndarray, int]:
    """The course, finer where the tool loses contact; force [N] or displacement [m] at its instants; iterations that took."""
    rest = body.settle()
    if isinstance(rest, Stuck):
        raise RunError(f'curve "{name}": the body does not come to rest before the tool moves.')
    answers: list[float] = []
    total = rest.iterations
    push = body.press if by_force else body.move
    number = cut = 0
    while number < len(course.time_s):
        if lifts and number > max(1, cut) and _leaves(answers, course, number):
            course, cut = course.split(number, CAREFUL), number + CAREFUL
        t, x = course.time_s[number], course.imposed[number]
        # until a tool that does not stick touches, the body is at rest
        idle = not any(answers) and (x <= 0.0 if lifts else x == 0.0 and not answers)
        reached = rest if idle else push(float(x), at_s=float(t - course.time_s[0]))
        if isinstance(reached, Stuck):
            unit, factor = ("N", 1.0) if by_force else ("mm", 1e3)
            place = ", ".join(f"{1e3 * c:.3g}" for c in reached.place_m)
            raise RunError(
                f'curve "{name}": the model stops at {factor * reached.reached:.3g} {unit} of {factor * x:.3g} {unit}, '
                f"{t:.3g} s ({reached.reason} at {place} mm); take another refinement."
            )
        total += reached.iterations
        answers.append(reached.displacement_m if by_force else reached.force_N)
        number += 1
        progress(number / len(course.time_s))
    return course, np.array(answers), total


def _leaves(force_N: Sequence[float], course: Course, number: int) -> bool:
    """Whether the tool may lose contact on the step to an instant, by the line through the last two."""
    before, last = force_N[number - 2], force_N[number - 1]
    pace = (before - last) / (course.time_s[number - 1] - course.time_s[number - 2])
    return 0.0 < last <= pace * (course.time_s[number] - course.time_s[number - 1]) * EARLY


def true_way(read: np.ndarray, curve: Curve, readings: Sequence[Measurement], by_force: bool) -> np.ndarray:
    """What was imposed indeed, where the machine read so."""
    for effect in reversed(readings):
        if by_force:
            # what is read is linear in the force
            zero, one = (effect.read_force(np.full(len(read), x), curve.time_s, cycle_of(curve)) for x in (0.0, 1.0))
            read = (read - zero) / (one - zero)
        else:
            read = effect.true_displacement(read)
    if by_force and curve.tool.shape != "bonded-disc":
        return np.maximum(read, 0.0)
    return read


def reading(true: np.ndarray, curve: Curve, readings: Sequence[Measurement], by_force: bool) -> np.ndarray:
    """What the machine reads, where it is so indeed."""
    for effect in readings:
        if by_force:
            true = true - (effect.true_displacement(true) - true)  # a shift
        else:
            true = effect.read_force(true, curve.time_s, cycle_of(curve))
    return true


# ---- all tests ----


def _job(test: Sequence[Curve], text: str) -> list[Predicted] | str:
    try:
        return predict_test(test, parse_model(text))
    except RunError as error:
        return str(error)


def _all(
    tests: Sequence[Sequence[Curve]],
    model: ModelFile,
    processes: int | None,
    progress: Progress,
) -> dict[str, Predicted | str]:
    """Curve -> its prediction, or what went wrong."""
    found: dict[str, Predicted | str] = {}

    def keep(test: Sequence[Curve], answer: list[Predicted] | str) -> None:
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


def _row(curve: Curve, found: Predicted | str) -> dict[str, Any]:
    unit, factor = UNITS[curve.predicted]
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


def _write(target: Path, summary: dict[str, Any], model: ModelFile, overwrite: bool) -> None:
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
