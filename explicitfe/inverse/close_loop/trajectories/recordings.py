"""Recordings of sensors on a moving body: their series, and where a model has the sensors at the times of the rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from explicitfe.inverse.close_loop.statistics.system import Answer, Hypothesis, Series
from explicitfe.inverse.close_loop.trajectories.lever import Lever
from explicitfe.inverse.close_loop.trajectories.markers import START_INTERVALS, Placed, RepeatScatter, scatter_of_repeats
from explicitfe.inverse.close_loop.trajectories.runs import Job, Runs, SensorMotion, Settings, scenario_with, settings_of
from explicitfe.inverse.measured.curve import Curve, TrajectoryDataset
from explicitfe.inverse.measured.registration import Registration
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.simulate.scenario.profile import profile_of
from explicitfe.simulate.scenario.transient import TransientScenario

AXIS_NAMES = "xyz"
# Where a start is fitted, runs are read so often in a sampling interval; a spline leads through these rows.
GRID_ROWS_PER_INTERVAL = 2
# Half periods of a vibration that have fewer rows are joined.
FEWEST_ROWS_OF_HALF_PERIOD = 4


@dataclass(frozen=True, eq=False)
class Recordings:
    """Curves of a trajectory dataset, and how runs of its scenario are read at the sensors.

    Parameters
    ----------
    dataset, curves : ``conditions.settings`` of a curve are settings of its scenario, such as another force of a muscle.
    first : the registration to begin with; the dataset says which parts of it are fitted.
    placed : curve -> its markers placed on the model by their rest; empty for sensors on named points.
    runs : shared by all that ask.
    levers : what may be wrong in the scenario, by name.
    only : candidates that are considered; the usual ones if empty.
    placement_mm : likely error of where each sensor sits, constant in time, along each axis.
    """

    dataset: TrajectoryDataset
    curves: tuple[Curve, ...]
    first: Registration
    placed: Mapping[str, Placed]
    runs: Runs
    levers: Mapping[str, Lever]
    only: tuple[str, ...] = ()
    placement_mm: float = 0.0

    @property
    def scenario(self) -> TransientScenario:
        """The scenario as its file has it."""
        return scenario_with(self.runs.path, ())

    @cached_property
    def series(self) -> list[Series]:
        """One for each curve, sensor and axis that was measured: coordinates from the first row on."""
        return [self._series(curve, sensor, axis) for curve, sensor, axis in self._columns]

    @cached_property
    def repeats(self) -> RepeatScatter | None:
        """How much repeats differ: fitted curves with the same settings and conditions; None without repeats or markers."""
        groups: dict[str, list[tuple[Curve, Placed]]] = {}
        for curve in self.curves if self.placed else ():
            conditions = {key: value for key, value in curve.conditions.items() if key != "repeat"}
            groups.setdefault(repr(sorted(conditions.items())), []).append((curve, self.placed[curve.id]))
        return scatter_of_repeats(list(groups.values()), self.moving)

    @property
    def moving(self) -> list[str]:
        """Names of the sensors that move."""
        return [name for name, sensor in self.dataset.sensors.items() if not sensor.fixed]

    def registration(self, model: Hypothesis) -> Registration:
        """The registration of a model."""
        values = self._of_base(model)
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
                registration = reading(registration, self.runs.sites.position.mean(axis=0), strengths)
        return registration

    def _of_base(self, model: Hypothesis) -> dict[str, float]:
        """Values of the parameters of the baseline, by name, with the curve in brackets where each has its own."""
        return {p.name + (f"[{p.group}]" if p.group else ""): v for p, v in zip(model.base, model.values, strict=False)}

    def settings(self, model: Hypothesis, curve: Curve | None = None) -> Settings:
        """What ``--set`` takes to turn the scenario into a model; with a curve, into the run of that curve."""
        settings = () if curve is None else settings_of(curve)
        base = self._of_base(model)
        fitted = [(name, {key: base[f"{name}.{key}"] for key in self.levers[name].sought}) for name in self.dataset.fit]
        for name, values in (*fitted, *model.of_terms()):
            scenario = scenario_with(self.runs.path, settings)  # with the terms before
            settings = (*settings, *self.levers[name].settings(scenario, values))
        return settings

    def jobs(self, model: Hypothesis, more: Settings = ()) -> list[Job]:
        """A run a curve, with further settings."""
        return [((*self.settings(model, curve), *more), self.times(curve)) for curve in self.curves]

    def marker_coordinates(self, model: Hypothesis, run: SensorMotion) -> np.ndarray:
        """Coordinates (k, 3 m) m of the markers that move, from rest, at the times of a run."""
        turned = np.einsum("ksij,sj->ksi", run.rotation - np.eye(3), self.stand_off(model))
        displacement = (run.displacement + turned)[:, self._moves]
        return np.asarray((displacement - displacement[0]).reshape(len(displacement), -1))

    def with_fixed_markers(self, moved: np.ndarray) -> np.ndarray:
        """Displacements (k, s, 3) m of all markers, from the coordinates (k, 3 m) m of those that move."""
        every = np.zeros((len(moved), len(self._moves), 3))
        every[:, self._moves] = moved.reshape(len(moved), -1, 3)
        return every

    @cached_property
    def _moves(self) -> np.ndarray:
        """Which sensors (s,) move."""
        return np.array([not sensor.fixed for sensor in self.dataset.sensors.values()])

    @cached_property
    def _columns(self) -> list[tuple[Curve, str, int]]:
        """Curve, sensor and axis of each series; a coordinate that never changes was not measured."""
        return [
            (curve, sensor, axis)
            for curve in self.curves
            for sensor in self.dataset.sensors
            for axis in range(3)
            if not self.dataset.sensors[sensor].fixed and _varies(curve.sensors[sensor][:, axis])
        ]

    def _series(self, curve: Curve, sensor: str, axis: int) -> Series:
        """One coordinate of a sensor from the first row on, or the displacement of a marker from its rest."""
        used = self._rows_of(curve, sensor)
        time_s = curve.time_s[used]
        if self.placed:
            one = self.placed[curve.id]
            measured, bends = one.displacement(curve, sensor)[used, axis], _half_periods(curve, one, sensor, used)
            phase = np.where(time_s > one.start_s, "loading", "hold")
        else:
            measured = (curve.sensors[sensor][:, axis] - curve.sensors[sensor][0, axis])[used]
            bends, phase = self._bends_of_muscles(curve, time_s)
        return Series(
            id=f"{curve.id} {sensor} {AXIS_NAMES[axis]}",
            curve=curve.id,
            test=curve.id,
            peers="",
            specimen="" if curve.group == curve.id else curve.group,
            constants="all",
            measured=measured,
            time_s=time_s,
            noise_sd=self._noise_of(curve),
            imposed_sd=np.zeros(len(time_s)),
            bends=bends,
            scatter=None,
            trend=0.0,
            phase=phase,
            unit="mm",
            factor=1e3,
        )

    def _noise_of(self, curve: Curve) -> float | None:
        """Standard deviation of a coordinate, m: as stated, or of markers at rest; None if unknown."""
        sd = curve.noise.displacement_sd_mm
        if sd is None:
            return self.placed[curve.id].noise_m if self.placed else None
        return 1e-3 * sd

    def _bends_of_muscles(self, curve: Curve, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows where a muscle's command bends, and the phase of each row."""
        profiles = [profile_of(muscle) for muscle in scenario_with(self.runs.path, settings_of(curve)).muscle]
        edges = np.concatenate([np.unique(p.time_s) for p in profiles] or [np.zeros(0)])
        rows = np.searchsorted(time_s, edges[(edges > 0.0) & (edges < time_s[-1])])
        pulls = sum((p.at(time_s, tolerance_s=1e-9) for p in profiles), np.zeros(len(time_s)))
        return np.unique([0, *rows, len(time_s) - 1]), np.where(pulls > 0.0, "loading", "unloading")

    def _rows_of(self, curve: Curve, sensor: str) -> np.ndarray:
        """Rows (k,) of a sensor that are compared: all that have values; of markers those near the start and later."""
        used = np.isfinite(curve.sensors[sensor]).all(axis=1)
        if self.placed:
            one = self.placed[curve.id]
            used &= curve.time_s > one.start_s - (START_INTERVALS + 1.0) * one.interval_s
        return np.asarray(np.flatnonzero(used))

    def times(self, curve: Curve) -> tuple[float, ...]:
        """Times of the scenario at which a curve's run is read [s]: those of its rows, or a grid where its start is fitted.

        Repeats share one grid, and so one run.
        """
        if curve.start_s is not None:
            since = curve.time_s - curve.start_s
            return tuple(since[since >= 0.0].tolist())
        return self._grids[settings_of(curve)]

    @cached_property
    def _grids(self) -> dict[Settings, tuple[float, ...]]:
        """Settings of curves whose start is fitted -> times [s] that reach to the end of each."""
        return _grids_of([(curve, self.placed[curve.id]) for curve in self.dataset.curves if curve.start_s is None])

    def by_columns(self, seen: Mapping[str, np.ndarray]) -> Answer:
        """What is seen (k, s, 3) m of each curve, as one array for each series."""
        sensors = {sensor: number for number, sensor in enumerate(self.dataset.sensors)}
        answer = []
        for curve, sensor, axis in self._columns:
            before = 0.0 if self.placed else curve.sensors[sensor][0, axis]
            answer.append(seen[curve.id][self._rows_of(curve, sensor), sensors[sensor], axis] - before)
        return answer

    def seen(self, model: Hypothesis, curve: Curve, run: SensorMotion, stand_off: np.ndarray | None = None) -> np.ndarray:
        """Positions (k, s, 3) m of the sensors in their frame, or displacements of markers from rest in that of the model.

        Parameters
        ----------
        stand_off : (s, 3) m, in place of that of the model.
        """
        if not self.placed:
            before = len(curve.time_s) - len(run.displacement)
            displacement = np.concatenate([np.repeat(run.displacement[:1], before, axis=0), run.displacement])
            return self.registration(model).to_sensors(self.runs.sites.position + displacement)
        vector = self.stand_off(model) if stand_off is None else stand_off
        displacement = run.displacement + np.einsum("ksij,sj->ksi", run.rotation - np.eye(3), vector)
        displacement = displacement - displacement[0]  # a body that is held displaced is at rest there
        times = np.array(self.times(curve))
        spline = CubicSpline(times, displacement, axis=0)

        def seen_from(start_s: float) -> np.ndarray:
            since = curve.time_s - start_s
            return np.where((since > 0.0)[:, None, None], spline(np.clip(since, 0.0, times[-1])), 0.0)

        start_s = self._start_of(model, curve)
        return seen_from(self._best_start(curve, seen_from) if start_s is None else start_s)

    def _start_of(self, model: Hypothesis, curve: Curve) -> float | None:
        """Time of the file at which a model's motion begins to be seen [s]; None where it is neither stated nor fitted."""
        start_s = curve.start_s if curve.start_s is not None else self._of_base(model).get(f"start_s[{curve.id}]")
        if start_s is None:
            return None
        return start_s + sum(self.levers[name].lag_s(values) for name, values in model.of_terms())

    def start_time_of(self, model: Hypothesis, curve: Curve) -> float:
        """Time of the file at which a model's motion begins, of a curve that is fitted [s]."""
        start_s = self._start_of(model, curve)
        return self.placed[curve.id].start_s if start_s is None else start_s

    def _best_start(self, curve: Curve, seen_from: Callable[[float], np.ndarray]) -> float:
        """Start [s] of a curve that is predicted and not fitted: nothing predicts it, so it is the one that fits best."""
        one = self.placed[curve.id]
        measured = np.stack([one.displacement(curve, name) for name in self.dataset.sensors], axis=1)
        moving = [not sensor.fixed for sensor in self.dataset.sensors.values()]

        def misfit(start_s: float) -> float:
            return float(np.nansum((seen_from(start_s) - measured)[:, moving] ** 2))

        doubt = START_INTERVALS * one.interval_s
        best = minimize_scalar(misfit, bounds=(one.start_s - doubt, one.start_s + doubt), method="bounded")
        return float(best.x)

    def stand_off(self, model: Hypothesis) -> np.ndarray:
        """Vectors (s, 3) m from the material points to the markers, by a model."""
        vectors = self.runs.sites.stand_off
        more = sum(self.levers[name].stand_off_m(values) for name, values in model.of_terms())
        size = np.linalg.norm(vectors, axis=1, keepdims=True)
        return vectors + more * vectors / np.maximum(size, 1e-300)


def _grids_of(curves: Sequence[tuple[Curve, Placed]]) -> dict[Settings, tuple[float, ...]]:
    """Settings -> times [s] that reach to the end of each curve with them, at the shortest interval of one."""
    lasts: dict[Settings, tuple[float, float]] = {}
    for curve, one in curves:
        last = curve.time_s[-1] - one.start_s + (START_INTERVALS + 1.0) * one.interval_s
        longest, interval = lasts.get(settings_of(curve), (0.0, np.inf))
        lasts[settings_of(curve)] = max(longest, last), min(interval, one.interval_s)
    return {
        key: tuple(np.linspace(0.0, last, int(np.ceil(last * GRID_ROWS_PER_INTERVAL / interval)) + 1).tolist())
        for key, (last, interval) in lasts.items()
    }


def _varies(values: np.ndarray) -> bool:
    return bool(np.nanmax(values) > np.nanmin(values))


def _half_periods(curve: Curve, placed: Placed, sensor: str, used: np.ndarray) -> np.ndarray:
    """Rows between which a vibrating curve is smooth: the start, then every half period of its strongest vibration."""
    time_s = curve.time_s[used]
    start = int(np.searchsorted(time_s, placed.start_s))
    moved = placed.displacement(curve, sensor)[used][start:]
    most = moved[:, int(np.argmax(np.ptp(moved, axis=0)))]
    spectrum = np.abs(np.fft.rfft((most - most.mean()) * np.hanning(len(most))))
    strongest = int(np.argmax(spectrum[1:])) + 1 if len(spectrum) > 1 else 1
    half = max(round(0.5 * len(most) / strongest), FEWEST_ROWS_OF_HALF_PERIOD)
    return np.unique([0, *range(start, len(time_s) - half // 2, half), len(time_s) - 1])


def registration_table(dataset: TrajectoryDataset) -> RegistrationTable:
    """What the dataset says of the registration; nothing is fitted if it says nothing."""
    return dataset.registration or RegistrationTable()
