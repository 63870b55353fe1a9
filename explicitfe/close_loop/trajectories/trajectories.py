"""Sensors on a moving tongue as the loop sees them: coordinates, their registration, candidates, the simulator's answers.

Every candidate is a few ``--set`` settings of the scenario, so whatever is found is written back as a scenario that
``explicitfe run`` takes. The baseline has no constants of its own but the parts of the registration that are to be fitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.close_loop.statistics.covariance import stacked
from explicitfe.close_loop.statistics.fingerprints import outside
from explicitfe.close_loop.statistics.noise import RowNoise, row_noise
from explicitfe.close_loop.statistics.refit import derivatives
from explicitfe.close_loop.statistics.system import Answer, Candidate, Hypothesis, Parameter, Scales, Series, candidate
from explicitfe.close_loop.trajectories.levers import FACTOR, LEVERS
from explicitfe.close_loop.trajectories.registration import Registration, procrustes
from explicitfe.close_loop.trajectories.runs import Job, Runs, Settings
from explicitfe.effects.effect import Sought
from explicitfe.errors import InputError, RunError, nearest
from explicitfe.measured.curve import Curve, Dataset
from explicitfe.measured.tables import RegistrationTable
from explicitfe.model import catalogue
from explicitfe.model.muscles import profile_of
from explicitfe.model.tongue import anatomy_of
from explicitfe.predict.tissue import toml_value
from explicitfe.scenario.read import read_scenario
from explicitfe.scenario.transient import TransientScenario

AXES = "xyz"
UNFORESEEN = 2.0  # such errors are smooth in time, so that they weigh more than noise of equal size
BOTH = "a finer mesh of another element"
SMALLEST = 1e-6  # m; noise of a row that is said to be exact
FINER_CELLS = 1.5  # numbers of elements along each direction where no resolution is named
STEPS = 0.5  # of the stable step
OTHER_ELEMENT = {"hex8": "hex8-stiffness", "hex8-stiffness": "hex8", "hex8-full": "hex8"}


# ---- candidates: settings of a scenario ----


# ---- registration ----


# ---- runs ----


# ---- the system ----


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Fitted curves of a trajectory dataset as a :class:`explicitfe.close_loop.statistics.system.System`.

    Parameters
    ----------
    dataset, curves : ``conditions.settings`` of a curve are settings of its scenario, such as another force of a muscle.
    first : the registration to begin with; what of it is fitted, the dataset says.
    rest : (s, 3) m; where the sensors' points of the model are before anything pulls.
    runs : shared by all that ask.
    only : candidates that are considered; all if empty.
    placement_mm : likely error of where each sensor sits, a constant one for each of its axes.
    """

    dataset: Dataset
    curves: tuple[Curve, ...]
    first: Registration
    rest: np.ndarray
    runs: Runs
    only: tuple[str, ...] = ()
    placement_mm: float = 0.0

    @cached_property
    def rows(self) -> list[RowNoise]:
        """Noise of the rows of each series: what is stated, and what of the numerics the checks do not foresee.

        The start of a tongue is too fast for few rows to tell it from noise, so none is estimated where one is stated.
        """
        rows = row_noise(self.series)
        more = UNFORESEEN * self._unforeseen()
        stated = [row.sd if one.noise_sd is None else one.noise_sd for one, row in zip(self.series, rows, strict=True)]
        return [
            RowNoise(np.full(len(one.measured), np.hypot(sd, more + SMALLEST)), 0.0, one.noise_sd is not None)
            for one, sd in zip(self.series, stated, strict=True)
        ]

    def for_curves(self, curves: Iterable[Curve]) -> Trajectories:
        """The same models, asked for other curves."""
        return replace(self, curves=tuple(curves))

    @property
    def scenario(self) -> TransientScenario:
        """As the file has it."""
        return _scenario(self.runs.path, ())

    @cached_property
    def series(self) -> list[Series]:
        """One for each curve, sensor and axis that was measured: coordinates from the first row on."""
        return [self._series(curve, sensor, axis) for curve, sensor, axis in self._columns]

    @cached_property
    def base(self) -> tuple[Parameter, ...]:
        """What of the registration is fitted, about the first one: turn, shift, scale."""
        table = _table(self.dataset)
        found = []
        if table.rotation == "fit":
            found += [Parameter(f"turn_{axis}_rad", Sought((0.05,), -np.pi, np.pi), 0.0) for axis in AXES]
        if table.translation == "fit":
            found += [Parameter(f"shift_{axis}_mm", Sought((1.0,), -50.0, 50.0), 0.0) for axis in AXES]
        if table.scale == "fit":
            s = self.first.scale
            found.append(Parameter("scale", Sought((s,), 0.5 * s, 2.0 * s, kind="log", none=s), s))
        return tuple(found)

    def exact(self, model: Hypothesis) -> bool:
        return True

    def start(self) -> Hypothesis:
        return Hypothesis(self.base, (), np.array([p.sought.coordinate(p.start) for p in self.base]))

    def registration(self, model: Hypothesis) -> Registration:
        """Of a model."""
        values = dict(zip([p.name for p in self.base], model.values, strict=False))
        turn = Rotation.from_rotvec([values.get(f"turn_{axis}_rad", 0.0) for axis in AXES]).as_matrix()
        shift = np.array([values.get(f"shift_{axis}_mm", 0.0) for axis in AXES])
        scale = values.get("scale", self.first.scale)
        return Registration(turn @ self.first.rotation, self.first.centre, self.first.place + 1e-3 * shift, scale)

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        there = set(model.effects)
        found = []
        for name, lever in LEVERS.items():
            if name in there or (self.only and name not in self.only):
                continue
            sought = lever.sought(self.scenario)
            if isinstance(sought, str):
                made = candidate(name, 1, {lever.parameter: FACTOR}, Scales())
                found.append(replace(made, trials=(), reason=sought))
            else:
                found.append(candidate(name, 1, {lever.parameter: sought}, Scales()))
        return found

    def sketch(self, model: Hypothesis) -> Hypothesis:
        """The model itself: every candidate is tried in it."""
        return model

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        return [None if isinstance(a, str) else a for a in self._answers(models)]

    def why(self, model: Hypothesis) -> dict[str, str]:
        """Curve -> why a model cannot be computed there."""
        found = zip(self.curves, self.runs.of(self._jobs(model)), strict=True)
        return {curve.id: run for curve, run in found if isinstance(run, str)}

    def checks(self, model: Hypothesis) -> dict[str, Answer]:
        """With a finer mesh, another element, both, half the step; each curve by itself, for they need not err alike."""
        (now,) = self._answers([model])
        found = {}
        for way, answer in self._checked(model).items():
            for curve in self.curves:
                mine = [c is curve for c, _, _ in self._columns]
                found[f"{way}, {curve.id}"] = [there if m else here for m, there, here in zip(mine, answer, now, strict=True)]
        return found

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        """With each sensor elsewhere by the likely error of its place."""
        if not self.placement_mm:
            return {}
        (answer,) = self._answers([model])
        assert not isinstance(answer, str)
        found = {}
        for sensor, axis in dict.fromkeys((sensor, axis) for _, sensor, axis in self._columns):
            moved = [(s, a) == (sensor, axis) for _, s, a in self._columns]
            found[f"place of {sensor}, {AXES[axis]}"] = [
                y + 1e-3 * self.placement_mm * m for y, m in zip(answer, moved, strict=True)
            ]
        return found

    def settings(self, model: Hypothesis, curve: Curve | None = None) -> Settings:
        """What ``--set`` takes to make the scenario that of a model; with a curve, of its own run."""
        own = () if curve is None else _own_settings(curve)
        scenario = _scenario(self.runs.path, own)
        more = []
        for name, values in model.of_terms():
            (strength,) = values.values()
            more += LEVERS[name].settings(scenario, strength)
        return (*own, *more)

    def scenario_text(self, model: Hypothesis, curve: Curve | None = None) -> str:
        """The scenario of a model as a file: run, it gives the model's answers, bit by bit."""
        settings = self.settings(model, curve)
        found, _ = read_scenario(self.runs.path, settings)
        data = found.model_dump(mode="json", by_alias=True, exclude_unset=True)
        if "file" in data["model"]:  # which is relative to the scenario
            data["model"]["file"] = str((self.runs.path.parent / data["model"]["file"]).resolve())
        lines = [f"# {self.runs.path.name} with what explicitfe close-loop found:", *(f"#   --set {s}" for s in settings)]
        tables = {key: value for key, value in data.items() if isinstance(value, dict) and value}
        lines += [f"{key} = {toml_value(value)}" for key, value in data.items() if isinstance(value, str)]
        for name, table in tables.items():
            lines += ["", f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in table.items())]
        for table in data.get("muscle", []):
            lines += ["", "[[muscle]]", *(f"{key} = {toml_value(value)}" for key, value in table.items())]
        return "\n".join(lines) + "\n"

    def _checked(self, model: Hypothesis) -> dict[str, Answer]:
        """What is computed in other ways, all curves."""
        ways: dict[str, Settings] = {"another element": (f"model.element={OTHER_ELEMENT[self.scenario.model.element]}",)}
        finer = _finer(self.scenario)
        if finer:
            ways |= {"a finer mesh": (finer,), BOTH: (finer, *ways["another element"])}
        runs = [run for run in self.runs.of(self._jobs(model)) if not isinstance(run, str)]
        if runs:
            ways["smaller steps"] = (f"analysis.step_us={1e6 * STEPS * min(step for _, step in runs)!r}",)
        found = {way: self._answers([model], more)[0] for way, more in ways.items()}
        return {way: answer for way, answer in found.items() if not isinstance(answer, str)}

    def _unforeseen(self) -> float:
        """Rms [m] of what mesh and element change together and the sum of what each changes alone does not show."""
        model = self.start()
        (now,) = self._answers([model])
        base = stacked(now)
        changes = {way: stacked(answer) - base for way, answer in self._checked(model).items()}
        if BOTH not in changes:
            return 0.0
        both = changes.pop(BOTH)
        known = np.column_stack([derivatives(self, model, base), *changes.values()])
        rest = outside(known / np.maximum(np.linalg.norm(known, axis=0), 1e-300), both[:, None])
        return float(np.sqrt(np.mean(rest**2)))

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
        profiles = [profile_of(muscle) for muscle in _scenario(self.runs.path, _own_settings(curve)).muscle]
        time_s = curve.time_s
        edges = np.concatenate([np.unique(p.time_s) for p in profiles] or [np.zeros(0)])
        rows = np.searchsorted(time_s, edges[(edges > 0.0) & (edges < time_s[-1])])
        pulls = sum((p.at(time_s, tolerance_s=1e-9) for p in profiles), np.zeros(len(time_s)))
        sd = curve.noise.displacement_sd_mm
        return Series(
            id=f"{curve.id} {sensor} {AXES[axis]}",
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
        return [((*self.settings(model, curve), *more), tuple(curve.time_s.tolist())) for curve in self.curves]

    def _answers(self, models: Sequence[Hypothesis], more: Settings = ()) -> list[Answer | str]:
        """What each model predicts with further settings, or why it cannot."""
        runs = iter(self.runs.of(job for model in models for job in self._jobs(model, more)))
        sensors = {sensor: number for number, sensor in enumerate(self.dataset.sensors)}
        found: list[Answer | str] = []
        for model in models:
            mine = {curve.id: next(runs) for curve in self.curves}
            bad = [run for run in mine.values() if isinstance(run, str)]
            if bad:
                found.append(bad[0])
                continue
            registration = self.registration(model)
            seen = {name: registration.to_sensors(self.rest + run[0]) for name, run in mine.items()}
            found.append(
                [
                    seen[curve.id][:, sensors[sensor], axis] - curve.sensors[sensor][0, axis]
                    for curve, sensor, axis in self._columns
                ]
            )
        return found


def trajectory_system(
    dataset: Dataset,
    curves: Sequence[Curve],
    processes: int = 1,
    *,
    only: Sequence[str] = (),
    placement_mm: float = 0.0,
) -> Trajectories:
    """The system of some curves of a trajectory dataset, the registration brought near by Procrustes.

    Raises
    ------
    InputError : there is no scenario, it is no transient one, or a sensor sits on a point that the model does not have.
    RunError : the scenario does not come to the end of a curve.
    """
    if dataset.scenario is None or not dataset.sensors:
        raise InputError(f"{dataset.path}: there is nothing to compare with; add a scenario, and a [[sensor]] for each sensor.")
    scenario, _ = read_scenario(dataset.scenario)
    if not isinstance(scenario, TransientScenario):
        raise InputError(f"{dataset.scenario}: sensors need a transient scenario, not an indentation.")
    mesh = anatomy_of(scenario.model, dataset.scenario.parent).mesh
    for sensor, point in dataset.sensors.items():
        if point not in mesh.named_points:
            hint = nearest(point, mesh.named_points)
            raise InputError(f'{dataset.path}: sensor "{sensor}" sits on "{point}", which the model does not have; {hint}')
    rest = mesh.points[[mesh.named_points[point] for point in dataset.sensors.values()]]
    runs = Runs(dataset.scenario, rest, processes)
    modelled, seen = [], []
    curves = tuple(curves)
    for curve, run in zip(curves, runs.of((_own_settings(c), tuple(c.time_s.tolist())) for c in curves), strict=True):
        if isinstance(run, str):
            raise RunError(f'curve "{curve.id}": {run}')
        modelled.append((rest + run[0]).reshape(-1, 3))
        seen.append(np.stack([curve.sensors[name] for name in dataset.sensors], axis=1).reshape(-1, 3))
    first = procrustes(_table(dataset), np.concatenate(modelled), np.concatenate(seen))
    return Trajectories(dataset, curves, first, rest, runs, tuple(only), placement_mm)


def _table(dataset: Dataset) -> RegistrationTable:
    return dataset.registration or RegistrationTable()


@cache
def _scenario(path: Path, settings: Settings) -> TransientScenario:
    found, _ = read_scenario(path, settings)
    assert isinstance(found, TransientScenario)
    return found


def _own_settings(curve: Curve) -> Settings:
    found = curve.conditions.get("settings", [])
    if not isinstance(found, list) or not all(isinstance(entry, str) for entry in found):
        raise InputError(f'curve "{curve.id}": conditions.settings must be an array of strings such as "muscle.GGp.force_N=1.0".')
    return tuple(found)


def _finer(scenario: TransientScenario) -> str:
    """The setting of the next finer mesh; "" where there is none."""
    table = scenario.model
    if table.name is None:
        return ""
    named = catalogue.contour(table.name).resolutions
    if table.cells is None:
        names = sorted(named, key=lambda name: np.prod(named[name]))
        later = names[names.index(table.resolution or "medium") + 1 :]
        if later:
            return f"model.resolution={later[0]}"
    s, t, w = catalogue.cells_of(table.name, table.resolution, table.cells)
    return f"model.cells={[round(FINER_CELLS * s), round(FINER_CELLS * t), 2 * round(FINER_CELLS * w / 2)]}"
