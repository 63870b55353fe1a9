"""Sensors on a moving tongue as the loop sees them: coordinates, their registration, candidates, the simulator's answers.

Every candidate is a few ``--set`` settings of the scenario, so what is found can be written back as a scenario that
``explicitfe run`` takes. The constants of the baseline are the parts of the registration that are to be fitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.fem.effects.effect import Sought
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.muscle_lines import locate_in_mesh
from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, outside, stack
from explicitfe.inverse.close_loop.statistics.noise import RowNoise, row_noise
from explicitfe.inverse.close_loop.statistics.refit import BestFit, derivatives
from explicitfe.inverse.close_loop.statistics.system import Answer, Candidate, Hypothesis, Parameter, Scales, Term, candidate
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.inverse.close_loop.trajectories.emulate import emulator_near
from explicitfe.inverse.close_loop.trajectories.lever import Experiment
from explicitfe.inverse.close_loop.trajectories.levers import levers_of
from explicitfe.inverse.close_loop.trajectories.mapping import START, MappedAnswers, fit_by_mapping, map_answers, slopes_of_runs
from explicitfe.inverse.close_loop.trajectories.markers import START_INTERVALS, place_on_model
from explicitfe.inverse.close_loop.trajectories.paths import answers_with_errors_of_place
from explicitfe.inverse.close_loop.trajectories.recordings import AXIS_NAMES, Recordings, registration_table
from explicitfe.inverse.close_loop.trajectories.runs import Runs, Settings, Sites, finer_setting, scenario_with, settings_of
from explicitfe.inverse.measured.curve import Curve, TrajectoryDataset
from explicitfe.inverse.measured.registration import Registration, procrustes
from explicitfe.platform.errors import InputError, RunError, nearest
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.tongue import anatomy_of
from explicitfe.simulate.scenario.read import read_scenario, read_transient

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
# Correlation of rows that follow each other in the difference between repeats, where no test was repeated.
UNREPEATED_CORRELATION = 0.8
# A marker stands off the body by no more than this share of the body's largest extent.
LARGEST_STAND_OFF_SHARE = 0.2
OTHER_ELEMENT = {"hex8": "hex8-stiffness", "hex8-stiffness": "hex8", "hex8-full": "hex8"}


@dataclass(frozen=True, eq=False)
class Trajectories(Recordings):
    """Fitted curves of a trajectory dataset as a :class:`explicitfe.inverse.close_loop.statistics.system.System`.

    Attributes
    ----------
    mapped : effects of a fitted model -> fast answers that are exact there.
    """

    mapped: dict[tuple[str, ...], MappedAnswers] = field(default_factory=dict)

    @cached_property
    def rows(self) -> list[RowNoise]:
        """Noise of the rows of each series, with the numerical error of these curves."""
        return self.noise_of_rows(self.unforeseen_m)

    def noise_of_rows(self, unforeseen_m: float) -> list[RowNoise]:
        """Noise of the rows of each series: what is stated, and errors of the numerics that the checks do not foresee.

        A tongue starts too fast for few rows to tell its start from noise, so no noise is estimated where one is stated. Markers
        show their noise at rest. Where a test was repeated, its repeats show how far an exact model would be from each of them.
        """
        more = unforeseen_m + SMALLEST_NOISE_M
        if self.placed:
            return self._rows_of_markers(more)
        rows = row_noise(self.series)
        stated = [row.sd if one.noise_sd is None else one.noise_sd for one, row in zip(self.series, rows, strict=True)]
        return [
            RowNoise(np.full(len(one.measured), np.hypot(sd, more)), 0.0, one.noise_sd is not None)
            for one, sd in zip(self.series, stated, strict=True)
        ]

    def _rows_of_markers(self, more: float) -> list[RowNoise]:
        spread = self.repeats
        noise = []
        for one, (curve, sensor, axis) in zip(self.series, self._columns, strict=True):
            own = one.noise_sd or 0.0
            farthest = float(np.nanmax(np.linalg.norm(self.placed[curve.id].displacement(curve, sensor), axis=1)))
            if spread is None:
                shared = np.sqrt(len(self.moving)) * THRESHOLDS.unknown_noise_share * farthest
                sd = float(np.hypot(own + more, shared))
                noise.append(RowNoise(np.full(len(one.measured), sd), UNREPEATED_CORRELATION, False))
                continue
            # Errors that the markers share count once for all of them, not once for each.
            shared = np.sqrt(1.0 + (len(self.moving) - 1) * spread.common[axis])
            sd = float(np.hypot(own + more, shared * spread.share[axis] * farthest))
            noise.append(RowNoise(np.full(len(one.measured), sd), float(spread.correlation[axis]), False))
        return noise

    def for_curves(self, curves: Iterable[Curve]) -> Trajectories:
        """The same models, asked for other curves."""
        return replace(self, curves=tuple(curves))

    @cached_property
    def base(self) -> tuple[Parameter, ...]:
        """What is always fitted: parts of the registration, starts of the motion, and constants of the scenario."""
        table = registration_table(self.dataset)
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
        for curve in self.curves:
            if curve.start_s is None:
                one = self.placed[curve.id]
                doubt = START_INTERVALS * one.interval_s
                start = Sought((one.start_s + one.interval_s,), one.start_s - doubt, one.start_s + doubt, none=one.start_s)
                parameters.append(Parameter(START, start, one.start_s, group=curve.id))
        for name in self.dataset.fit:
            for key, sought in self.levers[name].sought.items():
                parameters.append(Parameter(f"{name}.{key}", sought, sought.none))
        return tuple(parameters)

    def has_slopes(self, model: Hypothesis) -> bool:
        """No: each derivative takes a run."""
        return False

    def exact(self, model: Hypothesis) -> bool:
        """Whether derivatives are taken of runs: one mesh and one step make them smooth. Fast answers save most of these runs."""
        return self.runs.emulator is None

    def costly(self, model: Hypothesis) -> bool:
        """Always: each strength is a run a curve."""
        return True

    def bare(self) -> Hypothesis:
        """The scenario as it stands, without parameters."""
        return Hypothesis((), (), np.zeros(0))

    def start(self) -> Hypothesis:
        """The scenario as it stands, with the first registration."""
        return Hypothesis(self.base, (), np.array([p.sought.coordinate(p.start) for p in self.base]))

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
            if name in self.dataset.fit:
                continue
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
        if self.placed and self.runs.emulator is None:
            self.runs.emulator = emulator_near(self, model, candidates)
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
        runs = zip(self.curves, self.runs.of(self.jobs(model)), strict=True)
        return {curve.id: run for curve, run in runs if isinstance(run, str)}

    @property
    def fast_everywhere(self) -> bool:
        """Whether the motion of markers has features; see :class:`Emulator`."""
        return self.runs.emulator is not None

    def has_sketch(self, effect: str) -> bool:
        """Whether the features of vibrating markers are known for an effect."""
        return self.runs.emulator is not None and effect in self.runs.emulator.responses

    def sketched(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """Answers by the features of the motion of markers; None for each model where there are none."""
        emulator = self.runs.emulator
        if emulator is None:
            return [None] * len(models)
        answers: list[Answer | None] = []
        for model in models:
            seen = {}
            for curve in self.curves:
                vibration = emulator.of(model, curve.id)
                moved = vibration.at(curve.time_s - self.start_time_of(model, curve))
                seen[curve.id] = self.with_fixed_markers(moved)
            answers.append(self.by_columns(seen))
        return answers

    def fit_by_mapping(self, start: Hypothesis, covariance: Covariance) -> BestFit | None:
        """The fit of a model by corrected fast answers; None where there are none."""
        emulator = self.runs.emulator
        known = emulator is not None and all(map(self.has_sketch, start.effects))
        if emulator is None or not known:
            return None
        fit, self.mapped[start.effects] = fit_by_mapping(self, emulator, start, covariance)
        return fit

    def beside(self, fit: BestFit) -> MappedAnswers | None:
        """Fast answers that are exact at a fitted model; None where there are none."""
        mapped = self.mapped.get(fit.model.effects)
        if mapped is not None and mapped.recordings is self and np.array_equal(mapped.model.x, fit.model.x):
            return mapped
        emulator = self.runs.emulator
        known = emulator is not None and all(map(self.has_sketch, fit.model.effects))
        if emulator is None or not known or (exact := map_answers(self, emulator, fit.model)) is None:
            return None
        return replace(exact[0], slopes=slopes_of_runs(exact[0]))

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
        if self.placed:
            return answers_with_errors_of_place(self, model)
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
        runs = [run for run in self.runs.of(self.jobs(self.start())) if not isinstance(run, str)]
        step_us = 1e6 * CHECK_STEP_SHARE * min(run.smallest_step_s for run in runs)
        change = self._change(self.start(), (f"analysis.step_us={step_us!r}",))
        return {SMALLER_STEPS: change} if change else {}

    @cached_property
    def _other_element(self) -> Settings:
        return (f"model.element={OTHER_ELEMENT[self.scenario.model.element]}",)

    @cached_property
    def _finer(self) -> tuple[float, str]:
        """What the change by a finer mesh is to be multiplied by to reach the limit of small elements, and its setting."""
        table, setting = self.scenario.model, finer_setting(self.scenario)
        if not setting:
            return 0.0, ""
        finer = scenario_with(self.runs.path, (setting,)).model
        coarse, fine = (np.prod(catalogue.cells_of(table.name or "", t.resolution, t.cells)) for t in (table, finer))
        return 1.0 / (1.0 - float(coarse / fine) ** (CONVERGENCE_ORDER / 3.0)), setting

    @cached_property
    def unforeseen_m(self) -> float:
        """Rms of the difference between the limits of small elements of two kinds that no other check describes."""
        factor, finer = self._finer
        model = self.start()
        both = self._change(model, (finer, *self._other_element)) if finer else []
        if not both:
            return 0.0
        columns = [derivatives(self, model, stack(self._answer(model))), *map(stack, self._numerical_changes(model).values())]
        known = np.column_stack(columns)
        unforeseen = outside(known / np.maximum(np.linalg.norm(known, axis=0), 1e-300), factor * stack(both)[:, None])
        return float(np.sqrt(np.mean(unforeseen**2)))

    def _answers(self, models: Sequence[Hypothesis], more: Settings = ()) -> list[Answer | str]:
        """What each model predicts with further settings, or why it cannot."""
        runs = iter(self.runs.of(job for model in models for job in self.jobs(model, more)))
        answers: list[Answer | str] = []
        for model in models:
            seen: dict[str, np.ndarray] = {}
            problems = []
            for curve in self.curves:
                run = next(runs)
                if isinstance(run, str):
                    problems.append(run)
                else:
                    seen[curve.id] = self.seen(model, curve, run)
            answers.append(problems[0] if problems else self.by_columns(seen))
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
    budget: Budget | None = None,
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
    scenarios = [scenario_with(dataset.scenario, settings_of(curve)) for curve in curves]
    levers = levers_of(Experiment(scenario, anatomy, dataset, scenarios))
    causes = {lever.cause for lever in levers.values()}
    for what, names, known in (("`effects`", only, {*levers, *causes}), (f"{dataset.path}: fit =", dataset.fit, {*levers})):
        for name in names:
            if name not in known:
                raise InputError(f"{what} {name}: there is no such effect; {nearest(name, known)}")
    for name in dataset.fit:
        if levers[name].reason:
            raise InputError(f"{dataset.path}: fit = {name} is not possible: {levers[name].reason}.")
    sites = _sites(dataset, mesh)
    runs = Runs(dataset.scenario, sites, processes, budget)
    if any(sensor.at_m is not None for sensor in dataset.sensors.values()):
        placed = {curve.id: place_on_model(curve, dataset.sensors) for curve in dataset.curves}
        identity = Registration(np.eye(3), np.zeros(3))
        return Trajectories(dataset, curves, identity, placed, runs, levers, tuple(only), placement_mm)
    modelled, seen = [], []
    for curve in curves:
        if curve.start_s is None:
            raise InputError(f'{dataset.path}: curve "{curve.id}": start_s = "fit" needs markers with at_mm; state a number.')
    system = Trajectories(dataset, curves, Registration(np.eye(3), np.zeros(3)), {}, runs, levers, tuple(only), placement_mm)
    for curve, run in zip(curves, runs.of(system.jobs(system.bare())), strict=True):
        if isinstance(run, str):
            raise RunError(f'curve "{curve.id}": {run}')
        modelled.append((sites.position + run.displacement).reshape(-1, 3))
        later = curve.time_s >= (curve.start_s or 0.0)
        seen.append(np.stack([curve.sensors[name][later] for name in dataset.sensors], axis=1).reshape(-1, 3))
    model, positions = np.concatenate(modelled), np.concatenate(seen)
    known = np.isfinite(positions).all(axis=1)
    return replace(system, first=procrustes(registration_table(dataset), model[known], positions[known]))


def _sites(dataset: TrajectoryDataset, mesh: HexMesh) -> Sites:
    """Where the sensors sit on the undeformed body."""
    for name, sensor in dataset.sensors.items():
        if sensor.at_m is None and sensor.point not in mesh.named_points:
            hint = nearest(sensor.point, mesh.named_points)
            raise InputError(
                f'{dataset.path}: sensor "{name}" is mapped to "{sensor.point}", which the model does not have; {hint}'
            )
    sensors = dataset.sensors.values()
    places = np.array([mesh.named_points[s.point].position[0] if s.at_m is None else s.at_m for s in sensors])
    placed = np.array([s.at_m is not None for s in sensors])
    points = locate_in_mesh(mesh, places, np.inf)
    away = np.where(placed[:, None], places - points.position, 0.0)
    for (name, sensor), distance in zip(dataset.sensors.items(), np.linalg.norm(away, axis=1), strict=True):
        if distance > LARGEST_STAND_OFF_SHARE * np.ptp(mesh.points, axis=0).max() and not sensor.fixed:
            raise InputError(f'{dataset.path}: marker "{name}" lies {1e3 * distance:.3g} mm outside of the body; check at_mm.')
    away[[s.fixed for s in sensors]] = 0.0
    if not placed.any():
        return Sites.at(places)
    return Sites(points.position, away, mesh.hexes, points)
