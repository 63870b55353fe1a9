"""Sensors on a moving tongue as the loop sees them: coordinates, their registration, candidates, the simulator's answers.

Every candidate is a few ``--set`` settings of the scenario, so what is found can be written back as a scenario that
``explicitfe run`` takes. The constants of the baseline are the parts of the registration that are to be fitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.statistics.covariance import outside, stack
from explicitfe.inverse.close_loop.statistics.noise import RowNoise, row_noise
from explicitfe.inverse.close_loop.statistics.refit import derivatives
from explicitfe.inverse.close_loop.statistics.system import (
    Answer,
    Candidate,
    Hypothesis,
    Parameter,
    Scales,
    Series,
    Term,
    candidate,
)
from explicitfe.inverse.close_loop.trajectories.levers import Lever, levers_of, total_force_N
from explicitfe.inverse.close_loop.trajectories.runs import Job, Runs, Settings, finer_setting, scenario_with, settings_of
from explicitfe.inverse.measured.curve import Curve, TrajectoryDataset
from explicitfe.inverse.measured.registration import Registration, procrustes
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import InputError, RunError, nearest
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.muscles import profile_of
from explicitfe.simulate.anatomy.tongue import anatomy_of
from explicitfe.simulate.scenario.read import read_scenario, read_transient
from explicitfe.simulate.scenario.transient import TransientScenario

AXIS_NAMES = "xyz"
ANOTHER_ELEMENT, MESH, SMALLER_STEPS = "another element", "the mesh", "smaller steps"
# Displacements of linear hexahedra converge with this power of the element size: the change from 480 to 1280 elements is to be
# multiplied by 1.8 to reach 10 240, and was by 1.5 and 1.7 in two gestures.
CONVERGENCE_ORDER = 2.0
# The least noise of a row [m]: one that is said to be exact would outweigh all others.
SMALLEST_NOISE_M = 1e-6
# The check with smaller steps takes this share of the usual step.
CHECK_STEP_SHARE = 0.5
# Steps of rotation [rad] and translation [mm] that change positions noticeably, and the largest correction of the start [mm].
TURN_STEP_RAD, SHIFT_STEP_MM, LARGEST_SHIFT_MM = 0.05, 1.0, 500.0
# The scale may change by these factors.
SCALE_BOUND_FACTORS = (0.5, 2.0)
OTHER_ELEMENT = {"hex8": "hex8-stiffness", "hex8-stiffness": "hex8", "hex8-full": "hex8"}


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Fitted curves of a trajectory dataset as a :class:`explicitfe.inverse.close_loop.statistics.system.System`.

    Parameters
    ----------
    dataset, curves : ``conditions.settings`` of a curve are settings of its scenario, such as another force of a muscle.
    first : the registration to begin with; the dataset says which parts of it are fitted.
    undeformed : (s, 3) m; where the sensors' points of the model are before anything pulls.
    runs : shared by all that ask.
    levers : what may be wrong in the scenario, by name.
    only : candidates that are considered; the usual ones if empty.
    placement_mm : likely error of where each sensor sits, constant in time, along each axis.
    """

    dataset: TrajectoryDataset
    curves: tuple[Curve, ...]
    first: Registration
    undeformed: np.ndarray
    runs: Runs
    levers: Mapping[str, Lever]
    only: tuple[str, ...] = ()
    placement_mm: float = 0.0

    @cached_property
    def rows(self) -> list[RowNoise]:
        """Noise of the rows of each series: what is stated, and errors of the numerics that the checks do not foresee.

        A tongue starts too fast for few rows to tell its start from noise, so no noise is estimated where one is stated.
        """
        rows = row_noise(self.series)
        more = self._unforeseen() + SMALLEST_NOISE_M
        stated = [row.sd if one.noise_sd is None else one.noise_sd for one, row in zip(self.series, rows, strict=True)]
        return [
            RowNoise(np.full(len(one.measured), np.hypot(sd, more)), 0.0, one.noise_sd is not None)
            for one, sd in zip(self.series, stated, strict=True)
        ]

    def for_curves(self, curves: Iterable[Curve]) -> Trajectories:
        """The same models, asked for other curves."""
        return replace(self, curves=tuple(curves))

    @property
    def scenario(self) -> TransientScenario:
        """The scenario as its file has it."""
        return scenario_with(self.runs.path, ())

    @cached_property
    def series(self) -> list[Series]:
        """One for each curve, sensor and axis that was measured: coordinates from the first row on."""
        return [self._series(curve, sensor, axis) for curve, sensor, axis in self._columns]

    @cached_property
    def base(self) -> tuple[Parameter, ...]:
        """The parts of the registration that are fitted: rotation vector, translation and scale, see :class:`Registration`."""
        table = _registration_table(self.dataset)
        parameters = []
        if table.rotation == "fit":
            for axis, start in zip(AXIS_NAMES, Rotation.from_matrix(self.first.rotation).as_rotvec(), strict=True):
                turn = Sought((start + TURN_STEP_RAD,), start - np.pi, start + np.pi, none=start)
                parameters.append(Parameter(f"turn_{axis}_rad", turn, float(start)))
        if table.translation == "fit":
            for axis, start in zip(AXIS_NAMES, 1e3 * self.first.translation, strict=True):
                low, high = start - LARGEST_SHIFT_MM, start + LARGEST_SHIFT_MM
                shift = Sought((start + SHIFT_STEP_MM,), low, high, none=start)
                parameters.append(Parameter(f"shift_{axis}_mm", shift, float(start)))
        if table.scale == "fit":
            s = self.first.scale
            low, high = SCALE_BOUND_FACTORS
            parameters.append(Parameter("scale", Sought((s,), low * s, high * s, kind="log", none=s), s))
        return tuple(parameters)

    def has_slopes(self, model: Hypothesis) -> bool:
        """No: each derivative takes a run."""
        return False

    def exact(self, model: Hypothesis) -> bool:
        """Always: one mesh and one step make answers smooth."""
        return True

    def costly(self, model: Hypothesis) -> bool:
        """Always: each strength is a run a curve."""
        return True

    def start(self) -> Hypothesis:
        """The scenario as it stands, with the first registration."""
        return Hypothesis(self.base, (), np.array([p.sought.coordinate(p.start) for p in self.base]))

    def registration(self, model: Hypothesis) -> Registration:
        """The registration of a model."""
        values = dict(zip([p.name for p in self.base], model.values, strict=False))
        turn = [values.get(f"turn_{axis}_rad") for axis in AXIS_NAMES]
        shift_mm = [values.get(f"shift_{axis}_mm") for axis in AXIS_NAMES]
        registration = Registration(
            self.first.rotation if None in turn else Rotation.from_rotvec(turn).as_matrix(),
            self.first.translation if None in shift_mm else 1e-3 * np.array(shift_mm),
            values.get("scale", self.first.scale),
        )
        for name, strengths in model.of_terms():
            reading = self.levers[name].reading
            if reading is not None:
                registration = reading(registration, self.undeformed.mean(axis=0), strengths)
        return registration

    @property
    def considered(self) -> list[str]:
        """Names of the levers that are tried; whoever names a cause asks for all its forms."""
        return [name for name, lever in self.levers.items() if not self.only or {name, lever.cause} & {*self.only}]

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        """The levers of causes that the model does not have yet."""
        present = {self.levers[name].cause for name in model.effects}
        candidates = []
        for name in self.considered:
            lever = self.levers[name]
            if lever.reason:
                candidates.append(Candidate(name, lever.cause, Term(name, ()), reason=lever.reason))
            elif lever.cause not in present:
                candidates.append(candidate(name, 1, lever.cause, lever.sought, Scales()))
        return candidates

    def at(self, model: Hypothesis) -> Trajectories:
        """One mesh serves all models of a tongue."""
        return self

    def changes(self, model: Hypothesis, candidates: Sequence[Candidate]) -> list[list[np.ndarray | None]]:
        """Change (n,) m of the coordinates by each trial of each candidate; None where it cannot be computed."""
        usual = stack(self._answer(model))
        tried = iter(self.answers([model.plus(one.term, values) for one in candidates for values in one.trials]))
        answers = [[next(tried) for _ in one.trials] for one in candidates]
        return [[None if y is None else stack(y) - usual for y in row] for row in answers]

    def systematic(self) -> dict[str, np.ndarray]:
        """None: a scenario has no measured protocol."""
        return {}

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """What each model predicts of the series, m; None where it cannot be computed."""
        return [None if isinstance(a, str) else a for a in self._answers(models)]

    def why(self, model: Hypothesis) -> dict[str, str]:
        """Curve -> why a model cannot be computed there."""
        runs = zip(self.curves, self.runs.of(self._jobs(model)), strict=True)
        return {curve.id: run for curve, run in runs if isinstance(run, str)}

    def has_sketch(self, effect: str) -> bool:
        """There are no fast answers."""
        return False

    def sketched(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """None for each model."""
        return [None] * len(models)

    def checks(self, model: Hypothesis) -> dict[str, Answer]:
        """What a model answers with an error of its numerics of one standard deviation, in each curve by itself.

        The error of the mesh is that of the model with all its terms, extrapolated from a finer mesh (Richardson 1911); a muscle
        that is added errs by itself. The others are the changes by another element, and by smaller steps in the scenario.
        Curves need not err alike.
        """
        usual = self._answer(model)
        floors = {}
        for numerics, change in self._numerical_changes(model).items():
            for curve in self.curves:
                of_curve = [c is curve for c, _, _ in self._columns]
                floors[f"{numerics}, {curve.id}"] = [
                    y + d if own else y for own, y, d in zip(of_curve, usual, change, strict=True)
                ]
        return floors

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        """What the model answers with each sensor moved by the likely error of its place."""
        if not self.placement_mm:
            return {}
        answer = self._answer(model)
        answers = {}
        for sensor, axis in dict.fromkeys((sensor, axis) for _, sensor, axis in self._columns):
            moved = [(s, a) == (sensor, axis) for _, s, a in self._columns]
            answers[f"place of {sensor}, {AXIS_NAMES[axis]}"] = [
                y + 1e-3 * self.placement_mm * m for y, m in zip(answer, moved, strict=True)
            ]
        return answers

    def settings(self, model: Hypothesis, curve: Curve | None = None) -> Settings:
        """What ``--set`` takes to turn the scenario into a model; with a curve, into the run of that curve."""
        settings = () if curve is None else settings_of(curve)
        for name, values in model.of_terms():
            scenario = scenario_with(self.runs.path, settings)  # with the terms before
            settings = (*settings, *self.levers[name].settings(scenario, values))
        return settings

    def scenario_text(self, model: Hypothesis, curve: Curve | None = None) -> str:
        """The scenario of a model as a file, which gives the model's answers bit by bit when it is run."""
        settings = self.settings(model, curve)
        scenario, _ = read_scenario(self.runs.path, settings)
        data = scenario.model_dump(mode="json", by_alias=True, exclude_unset=True)
        for table in (data["model"], *data.get("bone", [])):
            if table.get("file"):  # its path is relative to the scenario
                table["file"] = str((self.runs.path.parent / table["file"]).resolve())
        lines = [f"# {self.runs.path.name} with what explicitfe close-loop found:", *(f"#   --set {s}" for s in settings)]
        lines += [f"{key} = {toml_value(value)}" for key, value in data.items() if isinstance(value, str)]
        tables = [(f"[{key}]", value) for key, value in data.items() if isinstance(value, dict) and value]
        tables += [(f"[[{key}]]", table) for key, value in data.items() if isinstance(value, list) for table in value]
        for head, table in tables:
            lines += ["", head, *(f"{key} = {toml_value(value)}" for key, value in table.items())]
        return "\n".join(lines) + "\n"

    def _numerical_changes(self, model: Hypothesis) -> dict[str, Answer]:
        """Changes of a model's answer to all curves by a converged mesh, by another element, and by smaller steps."""
        factor, finer = self._finer
        changes = {ANOTHER_ELEMENT: self._change(model, self._other_element)}
        if finer:
            changes |= {MESH: [factor * d for d in self._change(model, (finer,))]}
        return {name: change for name, change in changes.items() if change} | self._change_by_steps

    def _change(self, model: Hypothesis, settings: Settings) -> Answer:
        """Change of a model's answer by further settings; empty where it cannot be computed with them."""
        (other,) = self._answers([model], settings)
        return [] if isinstance(other, str) else [y - usual for y, usual in zip(other, self._answer(model), strict=True)]

    @cached_property
    def _change_by_steps(self) -> dict[str, Answer]:
        """Change of the scenario's own answer by smaller steps: terms hardly change it, and such a run takes twice as long."""
        runs = [run for run in self.runs.of(self._jobs(self.start())) if not isinstance(run, str)]
        step_us = 1e6 * CHECK_STEP_SHARE * min(step for _, step in runs)
        change = self._change(self.start(), (f"analysis.step_us={step_us!r}",))
        return {SMALLER_STEPS: change} if change else {}

    @cached_property
    def _other_element(self) -> Settings:
        """The setting of another element."""
        return (f"model.element={OTHER_ELEMENT[self.scenario.model.element]}",)

    @cached_property
    def _finer(self) -> tuple[float, str]:
        """What the change by a finer mesh is to be multiplied by to reach the limit of small elements, and its setting."""
        table, setting = self.scenario.model, finer_setting(self.scenario)
        if not setting:
            return 0.0, ""
        assert table.name is not None
        finer = scenario_with(self.runs.path, (setting,)).model
        coarse, fine = (np.prod(catalogue.cells_of(table.name, t.resolution, t.cells)) for t in (table, finer))
        return 1.0 / (1.0 - float(coarse / fine) ** (CONVERGENCE_ORDER / 3.0)), setting

    def _unforeseen(self) -> float:
        """Rms [m] of the difference between the limits of small elements of two kinds that no other check describes."""
        factor, finer = self._finer
        model = self.start()
        both = self._change(model, (finer, *self._other_element)) if finer else []
        if not both:
            return 0.0
        columns = [derivatives(self, model, stack(self._answer(model))), *map(stack, self._numerical_changes(model).values())]
        known = np.column_stack(columns)
        unforeseen = outside(known / np.maximum(np.linalg.norm(known, axis=0), 1e-300), factor * stack(both)[:, None])
        return float(np.sqrt(np.mean(unforeseen**2)))

    @cached_property
    def _columns(self) -> list[tuple[Curve, str, int]]:
        """Curve, sensor and axis of each series; a coordinate that never changes was not measured."""
        return [
            (curve, sensor, axis)
            for curve in self.curves
            for sensor in self.dataset.sensors
            for axis in range(3)
            if np.ptp(curve.sensors[sensor][:, axis]) > 0.0
        ]

    def _series(self, curve: Curve, sensor: str, axis: int) -> Series:
        """One coordinate of a sensor from the first row on; it bends where a muscle's command does."""
        profiles = [profile_of(muscle) for muscle in scenario_with(self.runs.path, settings_of(curve)).muscle]
        time_s = curve.time_s
        edges = np.concatenate([np.unique(p.time_s) for p in profiles] or [np.zeros(0)])
        rows = np.searchsorted(time_s, edges[(edges > 0.0) & (edges < time_s[-1])])
        pulls = sum((p.at(time_s, tolerance_s=1e-9) for p in profiles), np.zeros(len(time_s)))
        sd = curve.noise.displacement_sd_mm
        return Series(
            id=f"{curve.id} {sensor} {AXIS_NAMES[axis]}",
            curve=curve.id,
            test=curve.id,
            peers="",
            specimen="" if curve.group == curve.id else curve.group,
            constants="all",
            measured=curve.sensors[sensor][:, axis] - curve.sensors[sensor][0, axis],
            time_s=time_s,
            noise_sd=None if sd is None else 1e-3 * sd,
            imposed_sd=np.zeros(len(time_s)),
            bends=np.unique([0, *rows, len(time_s) - 1]),
            scatter=None,
            trend=0.0,
            phase=np.where(pulls > 0.0, "loading", "unloading"),
            unit="mm",
            factor=1e3,
        )

    def _jobs(self, model: Hypothesis, more: Settings = ()) -> list[Job]:
        """A run a curve, with further settings."""
        return [((*self.settings(model, curve), *more), tuple(curve.time_s.tolist())) for curve in self.curves]

    def _answers(self, models: Sequence[Hypothesis], more: Settings = ()) -> list[Answer | str]:
        """What each model predicts with further settings, or why it cannot."""
        runs = iter(self.runs.of(job for model in models for job in self._jobs(model, more)))
        sensors = {sensor: number for number, sensor in enumerate(self.dataset.sensors)}
        answers: list[Answer | str] = []
        for model in models:
            registration = self.registration(model)
            seen: dict[str, np.ndarray] = {}
            problems = []
            for curve in self.curves:
                run = next(runs)
                if isinstance(run, str):
                    problems.append(run)
                else:
                    seen[curve.id] = registration.to_sensors(self.undeformed + run[0])
            if problems:
                answers.append(problems[0])
                continue
            answers.append(
                [
                    seen[curve.id][:, sensors[sensor], axis] - curve.sensors[sensor][0, axis]
                    for curve, sensor, axis in self._columns
                ]
            )
        return answers

    def _answer(self, model: Hypothesis) -> Answer:
        """What one model predicts.

        Raises
        ------
        RunError : it cannot be computed.
        """
        (answer,) = self._answers([model])
        if isinstance(answer, str):
            raise RunError(answer)
        return answer


def trajectory_system(
    dataset: TrajectoryDataset,
    curves: Sequence[Curve],
    processes: int = 1,
    *,
    only: Sequence[str] = (),
    placement_mm: float = 0.0,
) -> Trajectories:
    """The system of some curves of a trajectory dataset, with the registration brought near by Procrustes.

    Raises
    ------
    InputError : there is no scenario, it is no transient one, a sensor sits on a point that the model does not have, or there is
        no such candidate.
    RunError : the scenario does not come to the end of a curve.
    """
    if dataset.scenario is None or not dataset.sensors:
        raise InputError(f"{dataset.path}: scenario or sensors are missing; add the key scenario and a [[sensor]] for each.")
    scenario = read_transient(dataset.scenario)
    anatomy = anatomy_of(scenario.model, dataset.scenario.parent)
    curves, mesh = tuple(curves), anatomy.mesh
    totals = [total_force_N(scenario_with(dataset.scenario, settings_of(curve))) for curve in curves]
    levers = levers_of(scenario, anatomy.muscles, _registration_table(dataset), totals)
    for name in only:
        if name not in levers:
            raise InputError(f"`effects` {name}: there is no such effect; {nearest(name, levers)}")
    for sensor, point in dataset.sensors.items():
        if point not in mesh.named_points:
            hint = nearest(point, mesh.named_points)
            raise InputError(f'{dataset.path}: sensor "{sensor}" is mapped to "{point}", which the model does not have; {hint}')
    undeformed = np.concatenate([mesh.named_points[point].position for point in dataset.sensors.values()])
    runs = Runs(dataset.scenario, undeformed, processes)
    modelled, seen = [], []
    for curve, run in zip(curves, runs.of((settings_of(c), tuple(c.time_s.tolist())) for c in curves), strict=True):
        if isinstance(run, str):
            raise RunError(f'curve "{curve.id}": {run}')
        modelled.append((undeformed + run[0]).reshape(-1, 3))
        seen.append(np.stack([curve.sensors[name] for name in dataset.sensors], axis=1).reshape(-1, 3))
    first = procrustes(_registration_table(dataset), np.concatenate(modelled), np.concatenate(seen))
    return Trajectories(dataset, curves, first, undeformed, runs, levers, tuple(only), placement_mm)


def _registration_table(dataset: TrajectoryDataset) -> RegistrationTable:
    """What the dataset says of the registration; nothing is fitted if it says nothing."""
    return dataset.registration or RegistrationTable()
