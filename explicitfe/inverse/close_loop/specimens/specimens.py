"""Tests of specimens as the loop sees them: measured curves, the baseline's constants, candidates, the simulator's answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from explicitfe.fem.effects import EFFECTS, Effect, cause_of
from explicitfe.fem.effects.complete import is_isochoric
from explicitfe.fem.effects.effect import Sought, with_leaves
from explicitfe.fem.forces.response import layout_of
from explicitfe.fem.inputs.bounds import bounds_of
from explicitfe.inverse.close_loop.specimens.driven import driven_of
from explicitfe.inverse.close_loop.specimens.features import features_of
from explicitfe.inverse.close_loop.specimens.first_constants import RAMP_C10_PA, Baseline, first_constants
from explicitfe.inverse.close_loop.specimens.lengths import with_errors_of_lengths
from explicitfe.inverse.close_loop.specimens.plan import Plan, plan_of
from explicitfe.inverse.close_loop.specimens.scales import scales_of
from explicitfe.inverse.close_loop.specimens.series import determined, peers_of, series_of
from explicitfe.inverse.close_loop.specimens.simulator import Simulator, same_courses
from explicitfe.inverse.close_loop.specimens.trials import COARSE, changes_by_trials, needs_history
from explicitfe.inverse.close_loop.statistics.system import (
    Answer,
    Candidate,
    Hypothesis,
    Parameter,
    Scales,
    Series,
    candidate,
    steps_of,
)
from explicitfe.inverse.measured.curve import Curve, SpecimenDataset
from explicitfe.inverse.predict.correction import Correction, corrections_of
from explicitfe.inverse.predict.experiment import effects_of, experiments
from explicitfe.inverse.predict.tissue import EVERY, Constants, Numerics, Tissue
from explicitfe.platform.errors import InputError, RunError

# Poisson's ratio of the baseline on a mesh, from which answers are extrapolated to the incompressible limit.
MESH_POISSON_RATIO = 0.499
# The largest ratio of C20 to C10 that a fit may reach.
LARGEST_C20_RATIO = 1e3
# C10 may end within these factors of where it begins.
C10_BOUND_FACTORS = (1e-4, 1e4)
# A step of C20, as a share of C10, that changes an answer noticeably.
C20_STEP_RATIO = 0.3
# Smaller and larger moduli are those of no material.
MODULI_PA = bounds_of("_Pa")
EXACT = Numerics()
# With which effects are searched: each answer is brought to a fine mesh by ramps at the model of the round.
CORRECTED = Numerics(refinement=0.6, density=1.0, tolerance=5e-4, section=0.6, finer=1.0)
# Ramps for the first constants: their forces are right to two per cent.
FIRST_SECTION = 0.25
# The check of a history adds instants and tightens the tolerance by these factors.
CHECK_DENSITY_FACTOR = 2.0
CHECK_TOLERANCE_FACTOR = 0.25
SMALLEST_TOLERANCE = 1e-5
# What data need that a further test of the same kind can give.
CAN_BE_ADDED = {"time", "unloading", "repeats"}


@dataclass(frozen=True, eq=False)
class Specimens:
    """Fitted curves of a dataset as a :class:`explicitfe.inverse.close_loop.statistics.system.System`.

    Parameters
    ----------
    dataset : with its constants grouped as they are fitted.
    curves : the fitted ones.
    simulator : shared by all that ask.
    numerics : how tests under a tool are computed.
    only : effects that are considered; all if empty.
    corrections : curve -> what a finer mesh changes, see :meth:`at`.
    """

    dataset: SpecimenDataset
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
        return all(is_homogeneous(c) for c in self.curves)

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
        by_section = self.numerics.section > 0.0
        numerics = COARSE.model_copy(update={"section": FIRST_SECTION}) if by_section else self.numerics
        constants = {EVERY: Constants(C10_Pa=RAMP_C10_PA)}
        elastic = Tissue(poisson=MESH_POISSON_RATIO, incompressible=True, numerics=numerics, constants=constants)
        for group in self.groups:
            curves = [c for c in self.curves if c.constants == group]
            C10, C20 = first_constants(curves, Baseline(elastic, self.known, self.homogeneous, self.simulator.run))
            label = group if len(self.groups) > 1 else ""
            low, high = max(C10_BOUND_FACTORS[0] * C10, MODULI_PA.smallest), min(C10_BOUND_FACTORS[1] * C10, MODULI_PA.largest)
            size = Sought((C10,), low, high, kind="log")
            parameters.append(Parameter("C10_Pa", size, C10, label))
            parameters.append(Parameter("C20_Pa", Sought((C20_STEP_RATIO * C10,), 0.0, LARGEST_C20_RATIO * C10), C20, label))
        return tuple(parameters)

    def pointwise(self, model: Hypothesis) -> bool:
        """Whether one point of material answers for each test."""
        return self.homogeneous and all(EFFECTS[name].pointwise for name in model.effects)

    def exact(self, model: Hypothesis) -> bool:
        """Whether a model needs no hexahedra, whose answers are rough."""
        return self.pointwise(model) or (self.numerics.section > 0.0 and all(EFFECTS[e].in_revolution for e in model.effects))

    def costly(self, model: Hypothesis) -> bool:
        """Whether a model needs a mesh."""
        return not self.pointwise(model)

    def has_slopes(self, model: Hypothesis) -> bool:
        """Whether derivatives are computed in the same run: in a section of the body."""
        return self.exact(model) and not self.pointwise(model)

    def at(self, model: Hypothesis) -> Specimens:
        """The same tests, with what a finer mesh changes taken at a model."""
        if self.pointwise(model):
            return self
        tissue = self.tissue(model)
        corrections: dict[str, Correction] = {}
        for group in self.groups:
            curves = [c for c in self.curves if c.constants == group]
            corrections |= corrections_of(_for_group(tissue, group), curves, self.simulator.run)
        return replace(self, corrections=corrections)

    def with_numerics(self, numerics: Numerics) -> Specimens:
        """The same tests, computed otherwise and not corrected."""
        return replace(self, numerics=numerics, corrections={})

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
            C20 = known["C20_Pa", label]
            constants[group] = Constants(C10_Pa=known["C10_Pa", label], C20_Pa=C20 if MODULI_PA.smallest <= C20 else 0.0)
        changes_volume = any(EFFECTS[name].changes_volume for name in hypothesis.effects)
        tissue = Tissue(
            poisson=MESH_POISSON_RATIO,
            incompressible=not changes_volume,
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

    def systematic(self) -> dict[str, np.ndarray]:
        """Name -> change (n,) SI of all rows by one standard deviation of a part of the error of the estimated protocol."""
        ends = np.cumsum([0, *(len(one.measured) for one in self.series)])
        columns = {}
        for curve, one, start, end in zip(self.curves, self.series, ends[:-1], ends[1:], strict=True):
            for number, mode in enumerate(driven_of(curve).protocol.modes.T):
                column = np.zeros(ends[-1])
                column[start:end] = one.slope * mode[determined(curve)]
                columns[f"protocol of {one.id}, part {number}"] = column
        return columns

    def changes(self, model: Hypothesis, candidates: Sequence[Candidate]) -> list[list[np.ndarray | None]]:
        """Change (n,) SI of the prediction by each trial, see close_loop/specimens/trials.py."""
        return changes_by_trials(self, model, candidates)

    def beside(self, model: Hypothesis, others: Sequence[Hypothesis]) -> list[Answer | None]:
        """Answers of a model and of others that differ from it by little, as far as they are computed in the same run."""
        tissues = [self.tissue(one) for one in (model, *others)]
        self._answers(tissues[:1], self.curves, [tissues[1:]], again=True)
        return self._answers(tissues, self.curves, only_known=True)

    def answers(self, models: Sequence[Hypothesis], *, with_slopes: bool = True) -> list[Answer | None]:
        """What each model predicts of the series, SI; None where it cannot be computed.

        Parameters
        ----------
        with_slopes : compute what derivatives need in the same run, for later, where a section of the body is solved.
        """
        beside = [
            [self.tissue(m.shifted(k, step)) for k, step in enumerate(steps_of(self, m))]
            if with_slopes and self.has_slopes(m)
            else []
            for m in models
        ]
        return self._answers([self.tissue(m) for m in models], self.curves, beside)

    fast_everywhere = False

    def has_sketch(self, effect: str) -> bool:
        """Whether a reduced specimen has an effect: one of the material that leaves its volume as it is, or of the reading."""
        kind = EFFECTS[effect]
        return not self.homogeneous and (kind.acts_on == "reading" or is_isochoric(EFFECTS.get(kind.extends, kind)))

    def sketched(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """What reduced specimens answer; None where one cannot be computed."""
        driven = [driven_of(c).curve for c in self.curves]
        tests = experiments(driven)
        answers: list[Answer | None] = []
        for model in models:
            tissue = self.tissue(model)
            by_curve: dict[str, np.ndarray] = {}
            try:
                for test in tests:
                    law = tissue.law(test[0])
                    specimen = self.simulator.reduced(test[0], driven, law, CORRECTED)
                    if specimen is None:
                        break
                    values = specimen.answers(test, law, effects_of(test[0], tissue), COARSE.density)
                    by_curve |= {c.id: y for c, y in zip(test, values, strict=True)}
            except RunError:
                pass
            whole = len(by_curve) == len(self.curves)
            answers.append([by_curve[c.id][driven_of(c).rows][determined(c)] for c in self.curves] if whole else None)
        return answers

    def failing(self) -> dict[str, str]:
        """Curve -> why it cannot be computed where the fit begins."""
        answers = self.answers_or_reasons(self.start(), ramps=True)
        return {curve.id: answer for curve, answer in answers if isinstance(answer, str)}

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
                y * (1.0 + correction.error_of(name, y, driven_of(c).protocol.fitted[determined(c)], c.imposed == "force_N"))
                if c.id in ids
                else y
                for c, y in zip(self.curves, usual, strict=True)
            ]
            changed[name + of] = answer
        return changed

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        """What is computed with each length larger by its likely error, assumed or stated."""
        answers = {}
        changed = with_errors_of_lengths(self.curves, self.homogeneous)
        for name, curves in changed.items():
            (answer,) = self._answers([self.tissue(model)], curves)
            if answer is not None:
                answers[name] = answer
        return answers

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        """Terms that may be added to a model, or the reason why these data cannot show one.

        Of a cause that is present only a further term of the same form may be added, or an effect that extends it.
        """
        scales = self._scales(model)
        present = {cause_of(name) for name in model.effects}
        return [
            self._candidate(name, number, model, scales)
            for name, effect in EFFECTS.items()
            if effect.searched
            and (number := 1 + sum(term.effect == name for term in model.terms)) <= effect.terms
            and (cause_of(name) not in present or name in model.effects or effect.extends in model.effects)
            and (not self.only or name in self.only)
            and not any(isinstance(e, effect) for e in self.known)
        ]

    def possible(self, model: Hypothesis) -> list[Candidate]:
        """Effects that another test of this kind might show, whatever these data have."""
        scales = self._scales(model)
        return [
            candidate(name, 1, cause_of(name), EFFECTS[name].sought, scales)
            for name in dict.fromkeys(one.effect for one in self.candidates(model))
            if name not in model.effects and set(EFFECTS[name].requires) <= self.features | CAN_BE_ADDED
        ]

    def _candidate(self, name: str, number: int, model: Hypothesis, scales: Scales) -> Candidate:
        """The ``number``-th term of an effect."""
        effect = EFFECTS[name]
        term = candidate(name, number, cause_of(name), effect.sought_in(tool=self.curves[0].tool is not None), scales)
        if not self.features.issuperset(effect.requires):
            return replace(term, trials=(), reason=f"Needs {effect.about.needs}.")
        refusal = self._refusal(term, model)
        slow = effect.needs_half_body or (needs_history(effect) and not self.has_sketch(name))
        return replace(term, trials=(), reason=refusal) if refusal else replace(term, slow=slow)

    def _refusal(self, term: Candidate, model: Hypothesis) -> str:
        """Why a model cannot have a term beside those that it has; "" if it can."""
        base = EFFECTS[term.effect].extends
        if base and base not in model.effects:
            return f"extends {EFFECTS[base].about.title}, which the model does not contain"
        try:
            layout_of(with_leaves(self.tissue(model.plus(term.term, term.trials[0])).effects.chosen))
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
        driven = [driven_of(c).curve for c in self.curves]
        plans = [self._plan(tissue, test, driven, ramps=ramps) for test in experiments(driven)]
        by_curve: dict[str, np.ndarray | str] = {}
        for plan, run in zip(plans, self.simulator.run([plan.job for plan in plans]), strict=True):
            by_curve |= {c.id: run for c in plan.test} if isinstance(run, str) else plan.read(run, self.corrections)
        answers = [(c, by_curve[c.id]) for c in self.curves]
        return [(c, y if isinstance(y, str) else y[driven_of(c).rows]) for c, y in answers]

    def _plan(self, tissue: Tissue, test: tuple[Curve, ...], curves: Sequence[Curve], *, ramps: bool = True) -> Plan:
        return plan_of(_for_group(tissue, test[0].constants), test, curves, self.homogeneous, ramps=ramps)

    def _answers(
        self,
        tissues: Sequence[Tissue],
        curves: Sequence[Curve],
        beside: Sequence[Sequence[Tissue]] = (),
        *,
        again: bool = False,
        only_known: bool = False,
    ) -> list[Answer | None]:
        """What each tissue answers in the tests of some curves, SI; None where one of them cannot be computed.

        Parameters
        ----------
        beside : for each tissue others that differ by little, which are computed in the same run for later.
        again : repeat a known run for others that are new.
        only_known : compute nothing.
        """
        driven = [driven_of(c).curve for c in curves]
        tests = experiments(driven)
        plans = [[self._plan(tissue, test, driven) for test in tests] for tissue in tissues]
        jobs = [plan.job for row in plans for plan in row]
        similar: list[list[Tissue]] = []
        for others, row in zip(beside or [()] * len(plans), plans, strict=True):
            for test, plan in zip(tests, row, strict=True):
                own = [self._plan(other, test, driven).job for other in others]
                similar.append([one for courses, one in own if same_courses(courses, plan.job[0])])
        runs = iter(self.simulator.known(jobs) if only_known else self.simulator.run(jobs, similar, again=again))
        answers: list[Answer | None] = []
        for row in plans:
            by_curve: dict[str, np.ndarray] = {}
            for plan in row:
                run = next(runs)
                if run is not None and not isinstance(run, str):
                    by_curve |= plan.read(run, self.corrections)
            whole = len(by_curve) == len(curves)
            answers.append([by_curve[c.id][driven_of(c).rows][determined(c)] for c in curves] if whole else None)
        return answers

    def _scales(self, model: Hypothesis) -> Scales:
        """Sizes in the tests, with the mean of all constants of a model."""
        values = model.values[: len(self.base)]
        return scales_of(self.curves, float(np.mean(values[0::2])), float(np.mean(values[1::2])))


def _for_group(tissue: Tissue, group: str) -> Tissue:
    """A tissue without the constants of other groups, so that tests do not count as new ones if only those change."""
    if group not in tissue.constants:
        return tissue
    return tissue.model_copy(update={"constants": {group: tissue.constants[group]}})


def is_homogeneous(curve: Curve) -> bool:
    """Whether every point of a specimen is strained alike: without a tool, or between platens that let it slide."""
    if curve.tool is None:
        return True
    assert curve.specimen is not None
    sliding = curve.specimen.base in ("frictionless", "unknown") and curve.tool.friction in (0.0, "unknown")
    return curve.tool.shape == "platen" and curve.tool.control == "displacement" and sliding and curve.specimen.layer_mm == 0.0
