"""Tests of specimens as the loop sees them: measured curves, the baseline's constants, candidates, the simulator's answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from explicitfe.close_loop.specimens.features import features_of
from explicitfe.close_loop.specimens.plan import Plan, plan_of
from explicitfe.close_loop.specimens.scales import scales_of
from explicitfe.close_loop.specimens.series import determined, peers_of, series_of
from explicitfe.close_loop.specimens.simulator import Simulator
from explicitfe.close_loop.statistics.system import Answer, Candidate, Hypothesis, Parameter, Scales, Series, candidate
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.effects import EFFECTS, Effect
from explicitfe.effects.effect import Sought, with_leaves
from explicitfe.errors import InputError, RunError
from explicitfe.forces.response import layout_of
from explicitfe.measured.curve import Curve, Dataset, programme_of
from explicitfe.predict.correction import Correction, corrections_of, kind_of
from explicitfe.predict.experiment import experiments
from explicitfe.predict.tissue import EVERY, Constants, Numerics, Tissue

# Poisson's ratio of the baseline on a mesh; homogeneous states are computed in the incompressible limit.
MESH_POISSON_RATIO = 0.499
# One standard deviation from that of the mesh: the volume changes twice as easily.
SOFTER_POISSON_RATIO = 0.498
# C10 [Pa] of the first answers; these are scaled to the data, so its size does not matter.
FIRST_C10_PA = 200.0
# Ratios of C20 to C10 that are tried at the start, and the largest one that a fit may reach.
FIRST_C20_RATIOS = (0.0, 0.05, 0.2, 0.5, 1.0)
LARGEST_C20_RATIO = 1e3
# C10 may end within these factors of where it begins.
C10_BOUND_FACTORS = (1e-4, 1e4)
# A step of C20, as a share of C10, that changes an answer noticeably.
C20_STEP_RATIO = 0.3
EXACT = Numerics()
COARSE = Numerics(refinement=0.4, density=0.4, tolerance=1.5e-3)  # with which tests are planned, by differences of answers
# With which effects are searched: each answer is brought to a fine mesh by ramps at the model of the round.
CORRECTED = Numerics(refinement=0.6, density=1.0, tolerance=5e-4, finer=1.5)
# An answer to the value of the programme alone is a polynomial of this degree: it bends at first touch.
DEGREE_OF_STATE = 6
# The check of a history adds instants and tightens the tolerance by these factors.
CHECK_DENSITY_FACTOR = 2.0
CHECK_TOLERANCE_FACTOR = 0.25
SMALLEST_TOLERANCE = 1e-5
# What data need that a further test of the same kind can give.
CAN_BE_ADDED = {"time", "unloading", "repeats"}


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
    corrections : curve -> what a finer mesh changes, see :meth:`at`.
    """

    dataset: Dataset
    curves: tuple[Curve, ...]
    simulator: Simulator
    numerics: Numerics = EXACT
    constants_by: str | None = None
    only: tuple[str, ...] = ()
    corrections: Mapping[str, Correction] = field(default_factory=dict)

    @cached_property
    def tests(self) -> list[tuple[Curve, ...]]:
        """Curves that are one test each."""
        return experiments(self.curves)

    @cached_property
    def homogeneous(self) -> bool:
        """Whether all tests are homogeneous states as long as no effect disturbs them."""
        return all(_is_homogeneous(c) for c in self.curves)

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
        """Effects that the dataset itself states of its tests, such as the preload that was measured."""
        stated = (next(filter(None, (e.stated_in(c.conditions) for c in self.curves)), None) for e in EFFECTS.values())
        return tuple(effect for effect in stated if effect is not None)

    @cached_property
    def base(self) -> tuple[Parameter, ...]:
        """C10 and C20 of each group, about the constants to begin with."""
        parameters = []
        for group in self.groups:
            C10, C20 = self._first_constants(group)
            label = group if len(self.groups) > 1 else ""
            size = Sought((C10,), C10_BOUND_FACTORS[0] * C10, C10_BOUND_FACTORS[1] * C10, kind="log")
            parameters.append(Parameter("C10_Pa", size, C10, label))
            parameters.append(Parameter("C20_Pa", Sought((C20_STEP_RATIO * C10,), 0.0, LARGEST_C20_RATIO * C10), C20, label))
        return tuple(parameters)

    def exact(self, model: Hypothesis) -> bool:
        """Whether a model needs no mesh, so that its answers are free of numerical roughness."""
        return self.homogeneous and all(EFFECTS[name].pointwise for name in model.effects)

    def costly(self, model: Hypothesis) -> bool:
        """Whether a model needs a mesh."""
        return not self.exact(model)

    def at(self, model: Hypothesis) -> Specimens:
        """The same tests, with what a finer mesh changes taken at a model."""
        if self.exact(model):
            return self
        tissue = self.tissue(model)
        corrections: dict[str, Correction] = {}
        for group in self.groups:
            curves = [c for c in self.curves if c.constants == group]
            corrections |= corrections_of(_for_group(tissue, group), curves, self.simulator.run)
        return replace(self, corrections=corrections)

    def start(self) -> Hypothesis:
        """The elastic model, at constants to begin with."""
        return Hypothesis(self.base, (), np.array([p.sought.coordinate(p.start) for p in self.base]))

    def tissue(self, hypothesis: Hypothesis, numerics: Numerics | None = None) -> Tissue:
        """The tissue of a hypothesis, computed with these numerics; with the usual ones if they are left out."""
        known = {(p.name, p.group): value for p, value in zip(hypothesis.base, hypothesis.values, strict=False)}
        # The hypothesis may have more groups than this system: a planned test has only the constants of its own curve.
        several = any(p.group for p in hypothesis.base)
        constants = {}
        for group in self.groups if several else [EVERY]:
            label = group if several else ""
            constants[group] = Constants(C10_Pa=known["C10_Pa", label], C20_Pa=max(known["C20_Pa", label], 0.0))
        tissue = Tissue(
            poisson=MESH_POISSON_RATIO,
            incompressible=self.exact(hypothesis),
            constants_by=self.constants_by,
            constants=constants,
            numerics=numerics or self.numerics,
        )
        for effect in self.known:
            tissue = tissue.with_effect(effect)
        terms: dict[str, list[dict[str, float]]] = {}
        for name, values in hypothesis.of_terms():
            terms.setdefault(name, []).append(values)
        for name, parts in terms.items():
            tissue = tissue.with_effect(EFFECTS[name].from_terms(parts))
        return tissue

    def sketch(self, model: Hypothesis) -> Hypothesis:
        """The model without effects that need whole histories: others change about as much, and take a fraction of the time."""
        kept = [k for k, term in enumerate(model.terms) if not _needs_history(EFFECTS[term.effect])]
        x, start = list(model.x[: len(model.base)]), len(model.base)
        for k, term in enumerate(model.terms):
            if k in kept:
                x += list(model.x[start : start + len(term.parameters)])
            start += len(term.parameters)
        return Hypothesis(model.base, tuple(model.terms[k] for k in kept), np.array(x))

    def functions_of_state(self) -> np.ndarray:
        """Columns (n, m) SI: polynomials of the depth or of the force, for the tests of each kind together."""
        kinds: dict[str, list[int]] = {}
        for number, curve in enumerate(self.curves):
            kinds.setdefault(kind_of(curve), []).append(number)
        programmes = [programme_of(c)[determined(c)] for c in self.curves]
        ends = np.cumsum([0, *map(len, programmes)])
        columns = []
        for numbers in kinds.values():
            top = max(float(np.abs(programmes[k]).max()) for k in numbers)
            block = np.zeros((ends[-1], 1 + DEGREE_OF_STATE))
            for k in numbers:
                block[ends[k] : ends[k + 1]] = np.polynomial.legendre.legvander(2.0 * programmes[k] / top - 1.0, DEGREE_OF_STATE)
            columns.append(block)
        return np.concatenate(columns, axis=1)

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """What each model predicts of the series, SI; None where it cannot be computed."""
        return self._answers([self.tissue(m) for m in models], self.curves)

    def failing(self) -> dict[str, str]:
        """Curve -> why it cannot be computed with any of the constants that are tried at the start."""
        reasons: dict[str, str] = {}
        for test in self.tests:
            driven = tuple(_by_displacement(c) for c in test)
            answers = self.simulator.run([(driven, tissue.text) for tissue in self._first_tissues()])
            if all(isinstance(answer, str) for answer in answers):
                reasons |= {c.id: str(answers[0]) for c in test}
        return reasons

    def checks(self, model: Hypothesis) -> dict[str, Answer]:
        """What is computed if the mesh errs by one standard deviation, test by test; and with smaller steps where they matter."""
        tissue = self.tissue(model)
        answers: dict[str, Answer] = {}
        (usual,) = self._answers([tissue], self.curves)
        if usual is not None:
            for number, kind in enumerate(self._kinds_on_a_mesh):
                answers |= self._with_errors_of_the_mesh(kind, f" of geometry {number + 1}", usual)
        if any(effect.depends_on_path for effect in tissue.effects.chosen):
            tolerance = max(CHECK_TOLERANCE_FACTOR * self.numerics.tolerance, SMALLEST_TOLERANCE)
            finer = {"density": CHECK_DENSITY_FACTOR * self.numerics.density, "tolerance": tolerance}
            (answer,) = self._answers([self.tissue(model, self.numerics.model_copy(update=finer))], self.curves)
            if answer is not None:
                answers["smaller steps"] = answer
        return answers

    @cached_property
    def _kinds_on_a_mesh(self) -> list[list[Curve]]:
        """Curves with one correction each."""
        kinds: dict[int, list[Curve]] = {}
        for curve in self.curves:
            if curve.id in self.corrections:
                kinds.setdefault(id(self.corrections[curve.id]), []).append(curve)
        return list(kinds.values())

    def _with_errors_of_the_mesh(self, kind: Sequence[Curve], of: str, usual: Answer) -> dict[str, Answer]:
        """Error of a correction -> the answers with one standard deviation of it."""
        correction = self.corrections[kind[0].id]
        ids = {curve.id for curve in kind}
        changed: dict[str, Answer] = {}
        for name in correction.errors:
            answer = [
                y * (1.0 + correction.error_of(name, y, programme_of(c)[determined(c)], c.imposed == "force_N"))
                if c.id in ids
                else y
                for c, y in zip(self.curves, usual, strict=True)
            ]
            changed[name + of] = answer
        return changed

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        """What is computed with each length larger by its likely error, assumed or stated, and with another Poisson's ratio."""
        answers = {}
        if not self.exact(model):
            other = self.tissue(model).model_copy(update={"poisson": SOFTER_POISSON_RATIO})
            (answer,) = self._answers([other], self.curves)
            if answer is not None:
                answers["Poisson's ratio"] = answer
        changed = self.assumed(1.0 + THRESHOLDS.assumed_length_error_share) | self._with_errors_of_stated_lengths()
        for name, curves in changed.items():
            (answer,) = self._answers([self.tissue(model)], curves)
            if answer is not None:
                answers[name] = answer
        return answers

    def assumed(self, factor: float) -> dict[str, tuple[Curve, ...]]:
        """Name of each assumed length -> the curves with it multiplied."""
        changed: dict[str, tuple[Curve, ...]] = {}
        for table in ("specimen", "tool"):
            keys = dict.fromkeys(k for c in self.curves if getattr(c, table) is not None for k in getattr(c, table).assumed)
            for key in keys:
                if key.endswith("_mm"):
                    changed[f"{table}.{key}"] = tuple(with_length(c, table, key, factor) for c in self.curves)
        return changed

    def _with_errors_of_stated_lengths(self) -> dict[str, tuple[Curve, ...]]:
        """Name of each stated length -> the curves with it larger by its likely error.

        Two heights are two measurements, each with an error of its own. How wide a specimen is matters between platens only.
        """
        share = THRESHOLDS.stated_length_error_share
        keys = [("specimen", "height_mm"), ("specimen" if self.homogeneous else "tool", "radius_mm")]
        changed: dict[str, tuple[Curve, ...]] = {}
        for table, key in keys:
            owners = [getattr(c, table) for c in self.curves]
            stated = [None if owner is None or key in owner.assumed else getattr(owner, key) for owner in owners]
            for length in dict.fromkeys(value for value in stated if value is not None):
                changed[f"{100.0 * share:g} % of {table}.{key} = {length:g}"] = tuple(
                    with_length(c, table, key, 1.0 + share) if value == length else c
                    for c, value in zip(self.curves, stated, strict=True)
                )
        return changed

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        """Effects that may be missing in a model, with the values to try, or with the reason why these data cannot show one."""
        scales = self._scales(model)
        return [
            self._candidate(name, number, model, scales)
            for name, effect in EFFECTS.items()
            if effect.searched
            and (number := 1 + sum(term.effect == name for term in model.terms)) <= effect.terms
            and (not self.only or name in self.only)
            and not any(isinstance(e, effect) for e in self.known)
        ]

    def possible(self, model: Hypothesis) -> list[Candidate]:
        """Effects that another test of this kind might show, whatever these data have."""
        scales = self._scales(model)
        return [
            candidate(name, 1, EFFECTS[name].sought, scales)
            for name in dict.fromkeys(one.effect for one in self.candidates(model))
            if name not in model.effects and set(EFFECTS[name].requires) <= self.features | CAN_BE_ADDED
        ]

    def _candidate(self, name: str, number: int, model: Hypothesis, scales: Scales) -> Candidate:
        """The ``number``-th term of an effect."""
        effect = EFFECTS[name]
        term = candidate(name, number, effect.sought_in(tool=self.curves[0].tool is not None), scales)
        term = replace(term, variant_of=effect.variant_of, remembers=effect.remembers)
        lacking = [need for need in effect.requires if need not in self.features]
        if lacking:
            reason = f"requires {' and '.join(lacking)}, absent from these data; informative data: {effect.about.needs}"
            return replace(term, trials=(), reason=reason)
        refusal = self._refusal(term, model)
        if refusal:
            return replace(term, trials=(), reason=refusal)
        if self.homogeneous and effect.pointwise:
            return term
        # Runs on a mesh are dear, so the middle strength alone is tried.
        dear = effect.needs_half_body or (effect.depends_on_path and not self.homogeneous)
        term = replace(term, trials=tuple((row[len(row) // 2],) for row in term.trials), dear=dear)
        # A trial is compared with the elastic model on the same mesh where the model itself needs none, and where one ramp does
        # for the trial while the model needs its whole history.
        still = effect.acts_on != "reading" and not effect.depends_on_path
        if self.homogeneous or (still and any(_needs_history(EFFECTS[other.effect]) for other in model.terms)):
            none = term.term.parameters[0].sought.none
            term = replace(term, reference=tuple((none, *row[0][1:]) for row in term.trials))
        return term

    def _refusal(self, term: Candidate, model: Hypothesis) -> str:
        """Why a model cannot have a term beside those that it has; "" if it can."""
        base = EFFECTS[term.effect].extends
        if base and base not in model.effects:
            return f"extends {EFFECTS[base].about.title}, which the model does not contain"
        try:
            layout_of(with_leaves(self.tissue(model.plus(term.term, term.trials[0][0])).effects.chosen))
        except InputError as error:
            return str(error)
        return ""

    @cached_property
    def features(self) -> set[str]:
        """What the data have, of what effects require."""
        return features_of(self.curves, self.series)

    def answers_or_reasons(self, model: Hypothesis, *, ramps: bool = False) -> list[tuple[Curve, np.ndarray | str]]:
        """Each curve with its prediction at all rows, SI, or the reason for a failure; :meth:`answers` has determined rows only.

        Parameters
        ----------
        ramps : read tests without history from one ramp, as :meth:`answers` does; else follow each loading protocol.
        """
        tissue = self.tissue(model)
        plans = [self._plan(tissue, test, self.curves, ramps=ramps) for test in self.tests]
        by_curve: dict[str, np.ndarray | str] = {}
        for plan, run in zip(plans, self.simulator.run([plan.job for plan in plans]), strict=True):
            by_curve |= {c.id: run for c in plan.test} if isinstance(run, str) else plan.read(run, self.corrections)
        return [(c, by_curve[c.id]) for c in self.curves]

    def _plan(self, tissue: Tissue, test: tuple[Curve, ...], curves: Sequence[Curve], *, ramps: bool = True) -> Plan:
        return plan_of(_for_group(tissue, test[0].constants), test, curves, self.homogeneous, ramps=ramps)

    def _answers(self, tissues: Sequence[Tissue], curves: Sequence[Curve]) -> list[Answer | None]:
        """What each tissue answers in the tests of some curves, SI; None where one of them cannot be computed."""
        tests = experiments(curves)
        plans = [[self._plan(tissue, test, curves) for test in tests] for tissue in tissues]
        runs = iter(self.simulator.run([plan.job for row in plans for plan in row]))
        answers: list[Answer | None] = []
        for row in plans:
            by_curve: dict[str, np.ndarray] = {}
            for plan in row:
                run = next(runs)
                if not isinstance(run, str):
                    by_curve |= plan.read(run, self.corrections)
            answers.append([by_curve[c.id][determined(c)] for c in curves] if len(by_curve) == len(curves) else None)
        return answers

    def _first_tissues(self) -> list[Tissue]:
        """Tissues of one size, with different ratios of C20 to C10."""
        constants = [Constants(C10_Pa=FIRST_C10_PA, C20_Pa=q * FIRST_C10_PA) for q in FIRST_C20_RATIOS]
        exact = {"poisson": MESH_POISSON_RATIO, "incompressible": self.homogeneous}
        return [Tissue(**exact, constants={EVERY: c}, numerics=self.numerics) for c in constants]

    def _first_constants(self, group: str) -> tuple[float, float]:
        """C10 and C20 to begin with: of a few ratios, the one whose scaled answer misses the group's curves least.

        They are asked for as if the displacement were imposed, because the force is then linear in the size of the constants.
        """
        curves = [_by_displacement(c) for c in self.curves if c.constants == group]
        least, constants = np.inf, (FIRST_C10_PA, 0.0)
        coarse = replace(self, corrections={})
        for q, answer in zip(FIRST_C20_RATIOS, coarse._answers(self._first_tissues(), curves), strict=True):
            if answer is None:
                continue
            top = bottom = total = 0.0
            for curve, y in zip(curves, answer, strict=True):
                x = curve.columns[curve.predicted]
                weight = 1.0 / float(x @ x)
                top, bottom, total = top + weight * float(y @ x), bottom + weight * float(y @ y), total + 1.0
            if bottom > 0.0 and top > 0.0 and total - top**2 / bottom < least:
                least = total - top**2 / bottom
                constants = FIRST_C10_PA * top / bottom, q * FIRST_C10_PA * top / bottom
        if not np.isfinite(least):
            raise RunError(f'the constants "{group}" have no curve that the simulator can follow.')
        return constants

    def _scales(self, model: Hypothesis) -> Scales:
        """Sizes in the tests, with the mean of all constants of a model."""
        values = model.values[: len(self.base)]
        return scales_of(self.curves, float(np.mean(values[0::2])), float(np.mean(values[1::2])))


def with_length(curve: Curve, table: str, key: str, factor: float) -> Curve:
    """A curve with one length of its specimen or tool multiplied."""
    own = getattr(curve, table)
    value = None if own is None else getattr(own, key, None)
    if not isinstance(value, int | float):
        return curve
    return replace(curve, **{table: own.model_copy(update={key: factor * value})})


def _for_group(tissue: Tissue, group: str) -> Tissue:
    """A tissue without the constants of other groups, so that tests do not count as new ones if only those change."""
    if group not in tissue.constants:
        return tissue
    return tissue.model_copy(update={"constants": {group: tissue.constants[group]}})


def _needs_history(effect: type[Effect]) -> bool:
    """Whether a body has to follow the whole course of a test; a machine that misreads does not change what the body does."""
    return effect.acts_on != "reading" and effect.depends_on_path


def _is_homogeneous(curve: Curve) -> bool:
    """Whether every point of a specimen is strained alike: without a tool, or between platens that let it slide."""
    if curve.tool is None:
        return True
    assert curve.specimen is not None
    sliding = curve.specimen.base in ("frictionless", "unknown") and curve.tool.friction in (0.0, "unknown")
    return curve.tool.shape == "platen" and curve.tool.control == "displacement" and sliding and curve.specimen.layer_mm == 0.0


def _by_displacement(curve: Curve) -> Curve:
    """A curve as if its displacement were imposed."""
    if curve.tool is None or curve.tool.control == "displacement":
        return curve
    return replace(curve, tool=curve.tool.model_copy(update={"control": "displacement"}))
