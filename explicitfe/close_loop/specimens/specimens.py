"""Tests of specimens as the loop sees them: measured curves, the baseline's constants, candidates, the simulator's answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from explicitfe.close_loop.specimens.features import BACK, HOLD, PULLS, RATE, _pace, _way_back
from explicitfe.close_loop.specimens.plan import RAMP, _depends_on_way_only, _has_memory, _kind_of, _Plan
from explicitfe.close_loop.specimens.series import peers_of, series_of
from explicitfe.close_loop.specimens.simulator import POINTWISE, Simulator
from explicitfe.close_loop.statistics.system import Answer, Candidate, Hypothesis, Parameter, Scales, Series, candidate
from explicitfe.effects import EFFECTS, Effect
from explicitfe.effects.effect import Measurement, Sought
from explicitfe.effects.tool.adhesion import Adhesion
from explicitfe.effects.tool.friction import Friction
from explicitfe.effects.tool.preload import Preload
from explicitfe.effects.tool.tilt import Tilt
from explicitfe.errors import RunError
from explicitfe.measured.curve import Curve, Dataset, programme_of
from explicitfe.predict.experiment import cycle_of, experiments
from explicitfe.predict.reading import true_programme
from explicitfe.predict.tissue import EVERY, Constants, Numerics, Tissue

POISSON = 0.499
FIRST_PA = 200.0  # C10 of a first answer; its size is scaled
RATIOS = (0.0, 0.05, 0.2, 0.5, 1.0)  # of C20 to C10, tried at the start
LARGEST_RATIO = 1e3
LIKELY_ERROR = 0.1  # of an assumed dimension, one standard deviation
EXACT = Numerics()
COARSE = Numerics(refinement=0.4, density=0.4, tolerance=1.5e-3)  # finds
FINE = Numerics(refinement=0.6, density=0.7, tolerance=5e-4)  # decides
FINER, DENSER, STRICTER = 1.5, 2.0, 0.25


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
        return [series_of(c, test_of[c.id], peers_of(c, self.curves)) for c in self.curves]

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

    def model(self, hypothesis: Hypothesis, numerics: Numerics | None = None) -> Tissue:
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
        model = Tissue(poisson=self.poisson, constants_by=self.constants_by, constants=constants, numerics=numerics or usual)
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

    def _answers(self, models: Sequence[Tissue], curves: Sequence[Curve]) -> list[Answer | None]:
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

    def _plan(self, model: Tissue, test: tuple[Curve, ...], curves: Sequence[Curve]) -> _Plan:
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
            same_way = all(np.array_equal(true_programme(programme_of(c), c, readings, by_force), programme_of(c)) for c in test)
            if not readings or not same_way:
                return _Plan((test, model.text), test)
            # what is read only is read off the run without it
            return _Plan((test, plain.text), test, readings, by_force)
        alike = [c for c in curves if _kind_of(c) == _kind_of(first)]
        top = max(float(true_programme(programme_of(c), c, readings, by_force).max()) for c in alike)
        share = np.linspace(0.0, 1.0, RAMP)
        guess = max(float(np.abs(c.columns[first.predicted]).max()) for c in alike)
        columns = {first.imposed: share * top, first.predicted: share * guess}
        ramp = replace(first, time_s=share, columns={name: columns[name] for name in first.columns})
        return _Plan(((ramp,), plain.text), test, readings, by_force)

    def _first_models(self) -> list[Tissue]:
        constants = [Constants(C10_Pa=FIRST_PA, C20_Pa=q * FIRST_PA) for q in RATIOS]
        return [Tissue(poisson=self.poisson, constants={EVERY: c}, numerics=self.numerics) for c in constants]

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
            way, y = programme_of(curve), curve.columns[curve.predicted]
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


def _for_group(model: Tissue, group: str) -> Tissue:
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
