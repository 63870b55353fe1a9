"""Tests of specimens as the loop sees them: measured curves, the baseline's constants, candidates, the simulator's answers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from multiprocessing import get_context
from typing import Any
from zlib import crc32

import numpy as np
from scipy.interpolate import PchipInterpolator

from explicitfe.close_loop.statistics.noise import MEDIAN
from explicitfe.close_loop.statistics.system import Answer, Candidate, Hypothesis, Parameter, Scales, Series, candidate
from explicitfe.effects import EFFECTS, Effect
from explicitfe.effects.effect import MaterialEffect, Measurement, Sought
from explicitfe.effects.material.compressible import Compressible
from explicitfe.effects.tool.adhesion import Adhesion
from explicitfe.effects.tool.compliance import Compliance
from explicitfe.effects.tool.friction import Friction
from explicitfe.effects.tool.preload import Preload
from explicitfe.effects.tool.tilt import Tilt
from explicitfe.errors import InputError, RunError
from explicitfe.measured.course import bends
from explicitfe.measured.dataset import Curve, Dataset
from explicitfe.measured.selection import imposed, sd_of
from explicitfe.predict.predict import UNITS, cycle_of, experiments, predict_test, reading, true_way
from explicitfe.predict.tissue import EVERY, Constants, ModelFile, Numerics, parse_model

POISSON = 0.499
FIRST_PA = 200.0  # C10 of a first answer; its size is scaled
RATIOS = (0.0, 0.05, 0.2, 0.5, 1.0)  # of C20 to C10, tried at the start
LARGEST_RATIO = 1e3
EQUAL = 0.05  # of the range: programmes that agree so far are the same
EQUAL_SIZE = 0.1  # of a length
LIKELY_ERROR = 0.1  # of an assumed dimension, one standard deviation
STILL = 0.02  # of the fastest pace: below it a tool waits
HOLD, RATE = 0.1, 1.5  # share of a test that a hold lasts; factor between two rates
PULLS = 0.01  # of the largest force: below zero by so much, a tool is pulled
BACK = 0.05  # of the range: a way back
SLACK, QUIET_SD = 5e-3, 3.0  # of the range, and of the imposed column's noise: no bend
EXACT = Numerics()
COARSE = Numerics(refinement=0.4, density=0.4, tolerance=1.5e-3)  # finds
FINE = Numerics(refinement=0.6, density=0.7, tolerance=5e-4)  # decides
RAMP = 49  # rows of a ramp that stands for all courses
FINER, DENSER, STRICTER = 1.5, 2.0, 0.25

# What a homogeneous state can have; anything else needs a mesh.
POINTWISE = (MaterialEffect, Measurement, Compressible, Compliance, Preload)

Job = tuple[tuple[Curve, ...], str]


def _answer(job: Job) -> list[np.ndarray] | str:
    test, text = job
    try:
        return [p.values for p in predict_test(test, parse_model(text))]
    except (RunError, InputError, ValueError) as error:  # ValueError: values that a table of the scenario refuses
        return str(error)


class Simulator:
    """Answers of many models to many tests, on all cores; what was computed once is kept.

    Parameters
    ----------
    processes : at most so many; one a core if left out.
    """

    def __init__(self, processes: int | None = None) -> None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self.processes = min(processes or cores, cores)
        self.runs = 0
        self.watch = lambda: None  # called after each run, or while several go on
        self._kept: dict[tuple[str, ...], list[np.ndarray] | str] = {}
        self._pool: ProcessPoolExecutor | None = None

    def close(self) -> None:
        """End its processes."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def run(self, jobs: Sequence[Job]) -> list[list[np.ndarray] | str]:
        """What the curves of each test answer in SI, or why they cannot."""
        keys = [(*map(_identity, test), text) for test, text in jobs]
        wanted = {key: job for key, job in zip(keys, jobs, strict=True) if key not in self._kept}
        todo = list(wanted.items())
        # The first one here: it makes the machine code, which the other processes then only load.
        if todo and (self._pool is None or len(todo) == 1 or self.processes == 1):
            self._keep(*todo[0])
            todo = todo[1:]
        if self.processes > 1 and len(todo) > 1 and any(_on_a_mesh(job) for _, job in todo):
            try:
                self._pool = self._pool or ProcessPoolExecutor(self.processes, mp_context=get_context("spawn"))
                for (key, _), found in zip(todo, self._pool.map(_answer, [job for _, job in todo]), strict=True):
                    self._done(key, found)
                todo = []
            except BrokenProcessPool:  # no process can be started from where this one came from
                self._pool, self.processes = None, 1
                todo = [entry for entry in todo if entry[0] not in self._kept]
        for key, job in todo:
            self._keep(key, job)
        return [self._kept[key] for key in keys]

    def _keep(self, key: tuple[str, ...], job: Job) -> None:
        self._done(key, _answer(job))

    def _done(self, key: tuple[str, ...], found: list[np.ndarray] | str) -> None:
        self._kept[key] = found
        self.runs += 1
        self.watch()


@dataclass(frozen=True, eq=False)
class Specimens:
    """Fitted curves of a dataset as a :class:`explicitfe.close_loop.statistics.system.System`.

    Parameters
    ----------
    dataset : with its constants grouped as they are fitted.
    curves : the fitted ones.
    simulator : shared by all that ask.
    numerics : how tests under a tool are computed.
    only : effects that are considered; all if empty.
    """

    dataset: Dataset
    curves: tuple[Curve, ...]
    simulator: Simulator
    numerics: Numerics = EXACT
    constants_by: str | None = None
    only: tuple[str, ...] = ()
    poisson: float = POISSON

    @cached_property
    def tests(self) -> list[tuple[Curve, ...]]:
        """Curves that are one test each."""
        return experiments(self.curves)

    @cached_property
    def homogeneous(self) -> bool:
        """Whether all tests are homogeneous states where no effect speaks against it."""
        return all(_homogeneous(c) for c in self.curves)

    @cached_property
    def series(self) -> list[Series]:
        """One a curve, in the order of ``curves``."""
        test_of = {c.id: test[0].id for test in self.tests for c in test}
        return [_series(c, test_of[c.id], _peers(c, self.curves)) for c in self.curves]

    @cached_property
    def groups(self) -> list[str]:
        """Names of the constants."""
        return list(dict.fromkeys(c.constants for c in self.curves))

    @cached_property
    def known(self) -> tuple[Effect, ...]:
        """What the dataset itself says of its tests beyond specimen and tool: the preload that was measured."""
        return (Preload(force_N=0.0),) if any("preload_N" in c.conditions for c in self.curves) else ()

    @cached_property
    def base(self) -> tuple[Parameter, ...]:
        """C10 and C20 of each group, about the constants to begin with."""
        found = []
        for group in self.groups:
            C10, C20 = self._first(group)
            label = group if len(self.groups) > 1 else ""
            size = Sought((C10,), 1e-4 * C10, 1e4 * C10, kind="log")
            found.append(Parameter("C10_Pa", size, C10, label))
            found.append(Parameter("C20_Pa", Sought((0.3 * C10,), 0.0, LARGEST_RATIO * C10), C20, label))
        return tuple(found)

    def exact(self, model: Hypothesis) -> bool:
        return self.homogeneous and all(issubclass(EFFECTS[name], POINTWISE) for name in model.effects)

    def start(self) -> Hypothesis:
        return Hypothesis(self.base, (), np.array([p.sought.coordinate(p.start) for p in self.base]))

    def model(self, hypothesis: Hypothesis, numerics: Numerics | None = None) -> ModelFile:
        """The model file of a hypothesis."""
        known = {(p.name, p.group): value for p, value in zip(hypothesis.base, hypothesis.values, strict=False)}
        # the hypothesis may be of more groups than this system has: a planned test has the constants of its own
        several = any(p.group for p in hypothesis.base)
        constants = {}
        for group in self.groups if several else [EVERY]:
            label = group if several else ""
            constants[group] = Constants(C10_Pa=known["C10_Pa", label], C20_Pa=max(known["C20_Pa", label], 0.0))
        # Between platens a mesh may change less than a coarse one is off; without a memory one ramp is all that it costs, and
        # unless a tilt takes the symmetry away, one of few elements.
        dear = any(_remembers(name) or issubclass(EFFECTS[name], Tilt) for name in hypothesis.effects)
        by_ramp = self.homogeneous and not self.exact(hypothesis) and not dear
        usual = FINE if by_ramp else self.numerics
        model = ModelFile(poisson=self.poisson, constants_by=self.constants_by, constants=constants, numerics=numerics or usual)
        for effect in self.known:
            model = model.with_effect(effect)
        terms: dict[str, list[dict[str, float]]] = {}
        for name, mine in hypothesis.of_terms():
            terms.setdefault(name, []).append(mine)
        for name, parts in terms.items():
            model = model.with_effect(EFFECTS[name].made(parts))
        return model

    def sketch(self, model: Hypothesis) -> Hypothesis:
        """The model without what remembers: what a mesh changes is about the same without it, and many times cheaper."""
        kept = [k for k, term in enumerate(model.terms) if not _remembers(term.effect)]
        x, start = list(model.x[: len(model.base)]), len(model.base)
        for k, term in enumerate(model.terms):
            if k in kept:
                x += list(model.x[start : start + len(term.parameters)])
            start += len(term.parameters)
        return Hypothesis(model.base, tuple(model.terms[k] for k in kept), np.array(x))

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        return self._answers([self.model(m) for m in models], self.curves)

    def failing(self) -> dict[str, str]:
        """Curve -> why it cannot be computed with any of the constants that are tried at the start."""
        found = {}
        for test in self.tests:
            shown = tuple(_by_displacement(c) for c in test)
            answers = self.simulator.run([(shown, model.text) for model in self._first_models()])
            if all(isinstance(answer, str) for answer in answers):
                found |= {c.id: str(answers[0]) for c in test}
        return found

    def checks(self, model: Hypothesis) -> dict[str, Answer]:
        """See :class:`System`."""
        remembers = any(map(_has_memory, self.model(model).effects.chosen))
        ways: dict[str, Numerics] = {}
        now = self.model(model).numerics
        exact = self.exact(model)
        if not exact:
            ways["a finer mesh"] = now.model_copy(update={"refinement": FINER * now.refinement})
        if remembers or not exact:
            finer = {"density": DENSER * now.density, "tolerance": max(STRICTER * now.tolerance, 1e-5)}
            ways["smaller steps"] = now.model_copy(update=finer)
        found = self._answers([self.model(model, way) for way in ways.values()], self.curves)
        return {name: answer for name, answer in zip(ways, found, strict=True) if answer is not None}

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        found = {}
        for name, curves in self.assumed(1.0 + LIKELY_ERROR).items():
            (answer,) = self._answers([self.model(model)], curves)
            if answer is not None:
                found[name] = answer
        return found

    def assumed(self, factor: float) -> dict[str, tuple[Curve, ...]]:
        """Name of each assumed length -> the curves with it multiplied."""
        found: dict[str, tuple[Curve, ...]] = {}
        for table in ("specimen", "tool"):
            keys = dict.fromkeys(k for c in self.curves if getattr(c, table) is not None for k in getattr(c, table).assumed)
            for key in keys:
                if key.endswith("_mm"):
                    found[f"{table}.{key}"] = tuple(scaled(c, table, key, factor) for c in self.curves)
        return found

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        scales = self._scales(model)
        has = self.features
        found = []
        for name, effect in EFFECTS.items():
            number = 1 + sum(term.effect == name for term in model.terms)
            if (self.only and name not in self.only) or number > effect.terms or any(isinstance(e, effect) for e in self.known):
                continue
            lacking = [need for need in effect.requires if need not in has]
            made = candidate(name, number, effect.sought, scales)
            if lacking:
                made = replace(
                    made, trials=(), reason=f"these data have no {' and no '.join(lacking)}; it needs {effect.about.needs}"
                )
            elif not self.homogeneous or not issubclass(effect, POINTWISE):
                made = replace(made, trials=tuple((row[len(row) // 2],) for row in made.trials))
                # tried in an elastic model: on a mesh where that is no mesh, by one ramp where it would be a whole history
                still = not issubclass(effect, Measurement | Friction | Adhesion) and not _remembers(name)
                if self.homogeneous or (still and any(_remembers(term.effect) for term in model.terms)):
                    none = made.term.parameters[0].sought.none
                    made = replace(made, reference=tuple((none, *row[0][1:]) for row in made.trials))
            found.append(made)
        return found

    @cached_property
    def features(self) -> set[str]:
        """What the data have, of what effects require."""
        has = set()
        first = self.curves[0]
        if first.tool is not None:
            has.add("tool")
            if first.tool.shape in ("flat-cylinder", "platen"):
                has.add("flat tool")
            loose = ("frictionless", "unknown") if first.tool.shape == "platen" else ("frictionless",)
            if first.specimen is not None and first.specimen.base not in loose:
                has.add("bonded base")
        rates: dict[str, list[float]] = {}
        numbers: dict[str, set[float]] = {}
        directions: dict[str, set[str]] = {}
        for curve, one in zip(self.curves, self.series, strict=True):
            share = np.diff(one.time_s) @ (one.phase[1:] == "hold") / one.time_s[-1]
            back = _way_back(curve)
            if curve.tool is not None and curve.force_N.min() < -PULLS * np.abs(curve.force_N).max():
                has.add("force that pulls")
            if back > BACK:
                has |= {"unloading", "time"}
            if share > HOLD:
                has.add("time")
            rates.setdefault(curve.constants, []).append(_pace(curve))
            numbers.setdefault(curve.constants, set()).add(cycle_of(curve))
            directions.setdefault(curve.constants, set()).add(str(curve.conditions.get("direction")))
        if any(max(r) > RATE * min(r) for r in rates.values()):
            has.add("time")
        if any(len(n) > 1 for n in numbers.values()):
            has.add("repeats")
        if any(len(d) > 1 for d in directions.values()):
            has.add("two directions")
        return has

    def _answers(self, models: Sequence[ModelFile], curves: Sequence[Curve]) -> list[Answer | None]:
        tests = experiments(curves)
        plans = [[self._plan(_for_group(model, test[0].constants), test, curves) for test in tests] for model in models]
        found = iter(self.simulator.run([plan.job for row in plans for plan in row]))
        answers: list[Answer | None] = []
        for row in plans:
            by_curve: dict[str, np.ndarray] = {}
            for plan in row:
                answer = next(found)
                if not isinstance(answer, str):
                    by_curve |= plan.read(answer)
            answers.append([by_curve[c.id] for c in curves] if len(by_curve) == len(curves) else None)
        return answers

    def _plan(self, model: ModelFile, test: tuple[Curve, ...], curves: Sequence[Curve]) -> _Plan:
        """How a test is computed: where the answer depends on the way only, by one ramp for all tests of its kind."""
        first = test[0]
        if first.tool is None:
            return _Plan((test, model.text), test)
        effects = model.effects.chosen
        readings = tuple(e for e in effects if isinstance(e, Measurement))
        by_force = first.tool.control == "force"
        by_point = self.homogeneous and all(isinstance(e, POINTWISE) for e in effects)
        # What a mesh changes in a state that is homogeneous without it is small: there a ramp does for friction too.
        by_ramp = _depends_on_way_only(first, effects) or (self.homogeneous and not any(map(_has_memory, effects)))
        plain = model.model_copy(update={"effects": model.effects.without(readings)})
        if by_point or not by_ramp:
            same_way = all(np.array_equal(true_way(imposed(c), c, readings, by_force), imposed(c)) for c in test)
            if not readings or not same_way:
                return _Plan((test, model.text), test)
            # what is read only is read off the run without it
            return _Plan((test, plain.text), test, readings, by_force)
        alike = [c for c in curves if _kind_of(c) == _kind_of(first)]
        top = max(float(true_way(imposed(c), c, readings, by_force).max()) for c in alike)
        share = np.linspace(0.0, 1.0, RAMP)
        guess = max(float(np.abs(c.columns[first.predicted]).max()) for c in alike)
        columns = {first.imposed: share * top, first.predicted: share * guess}
        ramp = replace(first, time_s=share, columns={name: columns[name] for name in first.columns})
        return _Plan(((ramp,), plain.text), test, readings, by_force)

    def _first_models(self) -> list[ModelFile]:
        constants = [Constants(C10_Pa=FIRST_PA, C20_Pa=q * FIRST_PA) for q in RATIOS]
        return [ModelFile(poisson=self.poisson, constants={EVERY: c}, numerics=self.numerics) for c in constants]

    def _first(self, group: str) -> tuple[float, float]:
        """Constants to begin with: of a few ratios the one whose scaled answer misses the group's curves least.

        Asked for as if the displacement were imposed: the force is then linear in the size of the constants.
        """
        curves = [_by_displacement(c) for c in self.curves if c.constants == group]
        best, found = np.inf, (FIRST_PA, 0.0)
        for q, answer in zip(RATIOS, self._answers(self._first_models(), curves), strict=True):
            if answer is None:
                continue
            top = bottom = total = 0.0
            for curve, y in zip(curves, answer, strict=True):
                x = curve.columns[curve.predicted]
                weight = 1.0 / float(x @ x)
                top, bottom, total = top + weight * float(y @ x), bottom + weight * float(y @ y), total + 1.0
            if bottom > 0.0 and top > 0.0 and total - top**2 / bottom < best:
                best, found = total - top**2 / bottom, (FIRST_PA * top / bottom, q * FIRST_PA * top / bottom)
        if not np.isfinite(best):
            raise RunError(f'the constants "{group}" have no curve that the simulator can follow.')
        return found

    def _scales(self, model: Hypothesis) -> Scales:
        values = model.values[: len(self.base)]
        C10, C20 = float(np.mean(values[0::2])), float(np.mean(values[1::2]))
        duration = max(float(c.time_s[-1]) for c in self.curves)
        squares, energies = [], []
        scales: dict[str, float] = {}
        for curve in self.curves:
            way, y = imposed(curve), curve.columns[curve.predicted]
            if curve.kind == "uniaxial":
                squares.append(float(np.max(way**2 + 2.0 / way - 3.0)))
                energies.append(float(np.abs(np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(way))).max()))
            elif curve.kind == "shear":
                squares.append(float(np.max(way**2)))
                energies.append(float(np.abs(np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(way))).max()))
            else:
                d, F = curve.displacement_m, curve.force_N
                area = 1e-6 * (curve.specimen.face_mm2 if curve.tool.radius_mm is None else np.pi * curve.tool.radius_mm**2)
                deep = 1e-3 * (curve.specimen.thickness_mm if curve.tool.radius_mm is None else curve.tool.radius_mm)
                squares.append(3.0 * min(float(np.abs(d).max()) / deep, 0.6) ** 2)
                energies.append(float(np.abs(np.cumsum(0.5 * (F[1:] + F[:-1]) * np.diff(d))).max()) / (area * deep))
                largest = {"force_N": float(np.abs(F).max()), "displacement_mm": 1e3 * float(np.abs(d).max())}
                for key, value in (
                    *largest.items(),
                    ("pressure_Pa", largest["force_N"] / area),
                    ("height_mm", curve.specimen.thickness_mm),
                    ("compliance_mm_N", largest["displacement_mm"] / largest["force_N"]),
                    ("drift_N_s", largest["force_N"] / duration),
                    ("slip_mm_kPa", curve.specimen.thickness_mm / (1e-3 * C10)),
                ):
                    least = key == "height_mm"  # a layer must fit into the flattest specimen
                    scales[key] = (min if least else max)(scales.get(key, value), value)
        square = max(squares)
        scales |= {
            "duration_s": duration,
            "modulus_Pa": C10 + C20 * square,
            "third_Pa": (C10 + 2.0 * C20 * square) / (3.0 * square**2),
            "energy_Pa": max(max(energies), 1e-9),
        }
        # without a tool its scales are asked for, but nothing is tried in them
        names = {entry.scale for effect in EFFECTS.values() for entry in effect.sought.values() if entry.scale}
        return Scales({name: scales.get(name, 1.0) for name in names})


@dataclass(frozen=True)
class _Plan:
    """A run, and how the curves of a test are read off it: directly, or from a ramp by their own way."""

    job: Job
    test: tuple[Curve, ...]
    readings: tuple[Measurement, ...] = ()
    by_force: bool = False

    def read(self, answer: list[np.ndarray]) -> dict[str, np.ndarray]:
        """Curve -> what it would measure, SI."""
        (run, *_), _ = self.job
        if run is self.test[0]:
            return {c.id: reading(values, c, self.readings, self.by_force) for c, values in zip(self.test, answer, strict=True)}
        line = PchipInterpolator(imposed(run), answer[0])
        found = {}
        for curve in self.test:
            way = np.clip(true_way(imposed(curve), curve, self.readings, self.by_force), 0.0, imposed(run)[-1])
            found[curve.id] = reading(line(way), curve, self.readings, self.by_force)
        return found


def _on_a_mesh(job: Job) -> bool:
    """Whether a run is that of a mesh, and not of one homogeneous state."""
    (first, *_), text = job
    return first.tool is not None and (first.tool.shape != "platen" or _bends(text))


@lru_cache(maxsize=10_000)
def _bends(text: str) -> bool:
    return not all(isinstance(effect, POINTWISE) for effect in parse_model(text).effects.chosen)


def _has_memory(effect: Effect) -> bool:
    return isinstance(effect, MaterialEffect) and effect.memory > 0


def _depends_on_way_only(curve: Curve, effects: Iterable[Effect]) -> bool:
    """Whether neither time nor what came before changes the answer; a tied disc pulls too, and is left to the whole course."""
    by_path = any(_has_memory(e) or isinstance(e, Friction | Adhesion) for e in effects)
    return not by_path and curve.tool.shape != "bonded-disc" and curve.tool.friction in (0.0, "unknown", "stick")


@lru_cache(maxsize=10_000)
def _identity(curve: Curve) -> str:
    """Equal for curves that a model answers alike; what was measured does not count."""
    course = crc32(np.concatenate([curve.time_s, imposed(curve)]).tobytes())
    return f"{curve.specimen!r}|{curve.tool!r}|{curve.constants}|{curve.conditions!r}|{len(curve.time_s)}|{course}"


@lru_cache(maxsize=10_000)
def _kind_of(curve: Curve) -> str:
    """Equal for tests that differ in their course only."""
    known = [curve.conditions.get(key) for key in ("preload_N", "direction")]
    return f"{curve.specimen!r} {curve.tool!r} {curve.constants} {known}"


def scaled(curve: Curve, table: str, key: str, factor: float) -> Curve:
    """A curve with one length of its specimen or tool multiplied."""
    own = getattr(curve, table)
    value = None if own is None else getattr(own, key, None)
    if not isinstance(value, int | float):
        return curve
    return replace(curve, **{table: own.model_copy(update={key: factor * value})})


def _remembers(name: str) -> bool:
    effect = EFFECTS[name]
    return _has_memory(effect.made([{key: entry.values[0] for key, entry in effect.sought.items()}]))


def _for_group(model: ModelFile, group: str) -> ModelFile:
    if group not in model.constants:
        return model
    return model.model_copy(update={"constants": {group: model.constants[group]}})


def _homogeneous(curve: Curve) -> bool:
    if curve.tool is None:
        return True
    sliding = curve.specimen.base in ("frictionless", "unknown") and curve.tool.friction in (0.0, "unknown")
    return curve.tool.shape == "platen" and curve.tool.control == "displacement" and sliding and curve.specimen.layer_mm == 0.0


def _by_displacement(curve: Curve) -> Curve:
    if curve.tool is None or curve.tool.control == "displacement":
        return curve
    return replace(curve, tool=curve.tool.model_copy(update={"control": "displacement"}))


def _pace(curve: Curve) -> float:
    """Median pace of the way in."""
    way = imposed(curve)
    rest = 1.0 if curve.imposed == "stretch" else 0.0
    moved = np.abs(way - rest)
    pace = np.diff(moved) / np.diff(curve.time_s)
    rising = pace > STILL * pace.max(initial=0.0)
    return float(np.median(pace[rising])) if rising.any() else 0.0


def _way_back(curve: Curve) -> float:
    """Largest way back, over the range."""
    way = imposed(curve)
    moved = np.abs(way - (1.0 if curve.imposed == "stretch" else 0.0))
    return float((np.maximum.accumulate(moved) - moved).max() / max(moved.max(), 1e-300))


def _series(curve: Curve, test: str, peers: str) -> Series:
    way, y = imposed(curve), curve.columns[curve.predicted]
    span = max(float(np.ptp(way)), 1e-300)
    sd = sd_of(curve, curve.imposed)
    if sd is None:  # as rough as it is
        fourth = np.abs(np.diff(way, 4))
        sd = float(np.median(fourth)) / (MEDIAN * np.sqrt(70.0)) if len(fourth) else 0.0
    corners = bends(curve.time_s, way, max(SLACK * span, QUIET_SD * sd))
    moved = np.abs(np.interp(curve.time_s, curve.time_s[corners], way[corners]) - (1.0 if curve.imposed == "stretch" else 0.0))
    pace = np.gradient(moved, curve.time_s)
    # of all paces the fastest is one step of a coarse table; a tenth of the rows moves faster than a pace that counts
    still = STILL * max(float(np.quantile(np.abs(pace), 0.9)), 1e-2 * float(np.abs(pace).max()))
    phase = np.where(pace > still, "loading", np.where(pace < -still, "unloading", "hold"))
    slope = _slope(way, y, span)
    unit, factor = UNITS[curve.predicted]
    number = curve.conditions.get("repeat", curve.conditions.get("order", 0))
    return Series(
        id=curve.id,
        curve=curve.id,
        test=test,
        peers=peers,
        specimen="" if curve.group == curve.id else curve.group,
        constants=curve.constants,
        measured=y,
        time_s=curve.time_s,
        noise_sd=sd_of(curve, curve.predicted),
        imposed_sd=slope * sd,
        bends=corners,
        scatter=curve.noise.repeat_sd_fraction,
        trend=float(number) if isinstance(number, int | float) else 0.0,
        phase=phase,
        unit=unit,
        factor=factor,
    )


def _slope(way: np.ndarray, y: np.ndarray, span: float) -> np.ndarray:
    """How much the predicted column changes with the imposed one, at each row: a stiffening curve is steep at its end."""
    degree = min(3, len(np.unique(way)) // 4)
    line = np.polynomial.Polynomial.fit(way, y, degree) if degree and span > 1e-300 else None
    return np.full(len(y), float(np.ptp(y)) / span) if line is None else np.abs(line.deriv()(way))


def _peers(curve: Curve, curves: Sequence[Curve]) -> str:
    """The first curve that is nominally equal to this one, if it has such company."""
    equal = [c.id for c in curves if _nominally_equal(c, curve)]
    return equal[0] if len(equal) > 1 else ""


def _nominally_equal(one: Curve, other: Curve) -> bool:
    same = one.constants == other.constants and one.kind == other.kind
    same = same and all(one.conditions.get(key) == other.conditions.get(key) for key in ("direction", "material", "cycle"))
    if not same or not _alike(one.tool, other.tool, ("radius_mm", "edge_radius_mm")):
        return False
    if not _alike(one.specimen, other.specimen, ("radius_mm", "height_mm", "layer_mm")):
        return False
    end = min(one.time_s[-1], other.time_s[-1])
    if end < (1.0 - 2.0 * EQUAL) * max(one.time_s[-1], other.time_s[-1]):
        return False
    grid = np.linspace(0.0, end, 50)
    a, b = (np.interp(grid, c.time_s, imposed(c)) for c in (one, other))
    return float(np.sqrt(np.mean((a - b) ** 2))) < EQUAL * max(float(np.ptp(a)), float(np.ptp(b)))


def _alike(one: Any, other: Any, lengths: Iterable[str]) -> bool:
    if one is None or other is None:
        return one is other
    if one.shape != other.shape:
        return False
    pairs = [(getattr(one, key, None), getattr(other, key, None)) for key in lengths]
    return all(a == b or (a and b and abs(a - b) < EQUAL_SIZE * max(a, b)) for a, b in pairs)
