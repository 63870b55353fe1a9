"""Runs of a scenario with different settings, read at the sensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, MaterialPoints, shape_functions, shape_gradients
from explicitfe.fem.mesh.muscle_lines import locate_in_mesh
from explicitfe.fem.solve.transient import Transient
from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.inverse.close_loop.trajectories.emulator import Emulator
from explicitfe.inverse.close_loop.workers import Workers
from explicitfe.inverse.measured.curve import Curve
from explicitfe.platform.errors import InputError, RunError
from explicitfe.platform.host import stopping
from explicitfe.platform.host.compilation import announcing
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.scenario.read import read_transient
from explicitfe.simulate.scenario.transient import TransientScenario

# A finer mesh has so many times the elements along each direction, where the model names no finer resolution.
CHECK_CELLS_FACTOR = 1.5
# A node with a smaller share of a point is none of those that it lies between.
LEAST_SHARE = 1e-9

Settings = tuple[str, ...]  # what --set takes
Job = tuple[Settings, tuple[float, ...]]  # settings of the scenario, and times [s]


@dataclass(frozen=True, eq=False)
class Sites:
    """Where sensors sit on a body.

    Attributes
    ----------
    position : (s, 3) m, of material points in the undeformed body of the scenario as its file states it.
    stand_off : (s, 3) m, from there to the centre of each sensor.
    hexes, points : of the mesh in which they were located, and where; a run with the same elements need not search again.
    """

    position: np.ndarray
    stand_off: np.ndarray
    hexes: np.ndarray | None = None
    points: MaterialPoints | None = None

    @classmethod
    def at(cls, position: np.ndarray) -> Sites:
        """Sensors on material points (s, 3) m."""
        return cls(position, np.zeros_like(position))

    def points_in(self, mesh: HexMesh, scale: np.ndarray) -> MaterialPoints:
        """The material points in the mesh of a run, whose body is the scenario's times ``scale`` (3,)."""
        if self.points is not None and self.hexes is not None and np.array_equal(mesh.hexes, self.hexes):
            return replace(self.points, position=mesh.at(self.points, mesh.points))
        return locate_in_mesh(mesh, self.position * scale, *([np.inf] if self.stand_off.any() else []))


class SensorMotion(NamedTuple):
    """What a run tells of the sensors.

    Attributes
    ----------
    displacement : (k, s, 3) m, of the material points.
    rotation : (k, s, 3, 3) of the body there; (k, 0, 3, 3) where no sensor stands off.
    smallest_step_s : smallest step taken.
    """

    displacement: np.ndarray
    rotation: np.ndarray
    smallest_step_s: float


Run = SensorMotion | str  # or why it cannot be computed


def motion_of(path: Path, settings: Sequence[str], sites: Sites, times_s: Sequence[float]) -> SensorMotion:
    """SensorMotion of the sensors' sites at times.

    Parameters
    ----------
    path, settings : the scenario.
    times_s : (k,) rising. A state between two instants is extrapolated from the later one by its velocity, which errs by less
        than half a squared step times the acceleration.

    Raises
    ------
    InputError, RunError : the scenario cannot be built, or does not come to the last of the times.
    """
    prepared = prepare(path, settings)
    analysis = prepared.scenario.analysis
    simulation = prepared.body
    if times_s[-1] > 1e-3 * analysis.duration_ms * (1.0 + 1e-9):
        raise InputError(
            f"{path}: analysis.duration_ms = {analysis.duration_ms:g} ends before the data do, at {1e3 * times_s[-1]:g} ms."
        )
    mesh = prepared.model.mesh
    stands_off = bool(sites.stand_off.any())
    scale = np.array(prepared.scenario.model.scale) / np.array(scenario_with(path, ()).model.scale)
    points = sites.points_in(mesh, scale)
    step_s = None if analysis.step_us is None else 1e-6 * analysis.step_us
    transient = Transient(simulation, 1e-3 * analysis.duration_ms, step_s)
    displacements = np.empty((len(times_s), *sites.position.shape))
    rotations = np.empty((len(times_s), len(sites.position) if stands_off else 0, 3, 3))
    touching = TouchingElements.of(mesh, points) if stands_off else None
    for row, time_s in enumerate(times_s):
        status = transient.advance_to(time_s)
        stopping.check()
        if status:
            raise RunError(status.message)
        now = simulation.snapshot()
        field = now.displacement + (time_s - now.time_s) * now.velocity
        displacements[row] = mesh.at(points, field)
        if touching is not None:
            rotations[row] = rotation_of(np.eye(3) + touching.gradient(field))
    return SensorMotion(displacements, rotations, transient.smallest_dt_s)


@dataclass(frozen=True, eq=False)
class TouchingElements:
    """The elements that touch material points: a point between elements turns with all of them.

    With the gradient of one of them, a marker on the plane of symmetry would turn out of it.

    Attributes
    ----------
    point, nodes : (k,) and (k, 8) for each pair of a point and an element that touches it: the point, and the element's nodes.
    gradients : (k, 8, 3) [1/m] of its shape functions there, over the number of elements that touch the point.
    """

    point: np.ndarray
    nodes: np.ndarray
    gradients: np.ndarray

    @classmethod
    def of(cls, mesh: HexMesh, points: MaterialPoints) -> TouchingElements:
        shares = shape_functions(points.natural)
        point, element, natural = [], [], []
        for number, (own, share) in enumerate(zip(points.element, shares, strict=True)):
            weight = np.zeros(mesh.node_count)
            weight[mesh.hexes[own]] = np.where(np.abs(share) > LEAST_SHARE, share, 0.0)
            around = np.flatnonzero((weight[mesh.hexes] != 0.0).sum(axis=1) == np.count_nonzero(weight))
            point += [number] * len(around)
            element += around.tolist()
            natural.append(weight[mesh.hexes[around]] @ CORNERS)  # shape functions reproduce natural coordinates
        slopes = shape_gradients(np.concatenate(natural))
        jacobian = np.einsum("kai,kac->kic", mesh.points[mesh.hexes[element]], slopes)
        count = np.bincount(point)[point]
        gradients = np.einsum("kac,kci->kai", slopes, np.linalg.inv(jacobian)) / count[:, None, None]
        return cls(np.array(point), mesh.hexes[element], gradients)

    def gradient(self, field: np.ndarray) -> np.ndarray:
        """Gradients (s, 3, 3) of a field (n, 3) at the points."""
        of_pairs = np.einsum("kai,kac->kic", field[self.nodes], self.gradients)
        total = np.zeros((int(self.point[-1]) + 1, 3, 3))
        np.add.at(total, self.point, of_pairs)
        return total


def rotation_of(F: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of deformation gradients, F = R U (polar decomposition)."""
    u, _, vt = np.linalg.svd(F)
    return np.asarray(u @ vt)


def _run_job(path: Path, sites: Sites, job: Job) -> Run:
    try:
        with announcing(f"runs of {path.name}"):
            return motion_of(path, job[0], sites, job[1])
    except (RunError, InputError) as error:
        return str(error)


class Runs:
    """Runs of a scenario with different settings; what was computed once is kept.

    Parameters
    ----------
    sites : where the sensors sit.
    processes : at most so many.
    budget : counts the runs.
    """

    def __init__(self, path: Path, sites: Sites, processes: int = 1, budget: Budget | None = None) -> None:
        self.path = path
        self.sites = sites
        self.workers = Workers(processes, budget)
        self._kept: dict[Job, Run] = {}
        self.emulator: Emulator | None = None  # fast answers, once the candidates have been screened

    def of(self, jobs: Iterable[Job]) -> list[Run]:
        """SensorMotion of the sites in each job, or why it cannot be computed."""
        jobs = list(jobs)
        todo = list(dict.fromkeys(job for job in jobs if job not in self._kept))
        work = self.workers.each(partial(_run_job, self.path, self.sites), todo)
        for job, run in zip(todo, work, strict=True):
            self._kept[job] = run
            self.workers.budget.spend()
        return [self._kept[job] for job in jobs]


@cache
def scenario_with(path: Path, settings: Settings) -> TransientScenario:
    """A transient scenario with settings."""
    return read_transient(path, settings)


def settings_of(curve: Curve) -> Settings:
    """The settings that a curve states for its own run."""
    stated = curve.conditions.get("settings", [])
    settings = [entry for entry in stated if isinstance(entry, str)] if isinstance(stated, list) else []
    if not isinstance(stated, list) or len(settings) < len(stated):
        raise InputError(f'curve "{curve.id}": conditions.settings must be an array of strings such as "muscle.GGp.force_N=1.0".')
    return tuple(settings)


def finer_setting(scenario: TransientScenario) -> str:
    """The setting of the next finer mesh; "" where there is none."""
    table = scenario.model
    if table.box_mm is not None and table.cells is not None:
        return f"model.cells={[round(CHECK_CELLS_FACTOR * n) for n in table.cells]}"
    if table.name is None:
        return ""
    named = catalogue.contour(table.name).resolutions
    if table.cells is None:
        names = sorted(named, key=lambda name: np.prod(named[name]))
        later = names[names.index(table.resolution or "medium") + 1 :]
        if later:
            return f"model.resolution={later[0]}"
    s, t, w = catalogue.cells_of(table.name, table.resolution, table.cells)
    factor = CHECK_CELLS_FACTOR
    return f"model.cells={[round(factor * s), round(factor * t), 2 * round(factor * w / 2)]}"
