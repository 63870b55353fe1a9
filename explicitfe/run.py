"""Drives a transient run in chunks: how long a step is, when a sample is taken, when to stop. Python never runs per step."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.arrays import DAMPED, EXTERNAL, HOURGLASS, INTERNAL, KINETIC, SMALLEST_J
from explicitfe.build import Simulation, Snapshot
from explicitfe.errors import InputError
from explicitfe.model.anatomy import Anatomy
from explicitfe.model.assemble import assemble
from explicitfe.model.model import Model
from explicitfe.model.scenario import Scenario, read_scenario
from explicitfe.results import Quantity, ResultWriter, provenance
from explicitfe.timestep import FRACTION

FINISHED, INVERTED, UNSTABLE, DIVERGED, INTERRUPTED = "finished", "inverted", "unstable", "diverged", "interrupted"

# The stable step is looked at again when some element may have been strained by this much since, at the rate it had then: a
# step force can distort the elements at its node within a few steps.
STRAIN_BETWEEN_LOOKS = 0.15
FEWEST_STEPS, MOST_STEPS = 2, 100
FIRST_TURNS, TURNS = 40, 4  # of the iteration that finds the limit: at the start, and later from what it found
# The step is kept while it lies between these shares of the limit: each change costs the energy balance a little.
LOWEST_SHARE = 0.82
# A balance error above this is no rounding: energy comes from nowhere, as it does when the step is too long.
BALANCE_LIMIT = 0.1
# Hourglass energy means something where the elastic energy is at least this share of its largest.
SHARE_FLOOR = 0.01
# Above these a result comes with a warning.
HOURGLASS_WARNING = 0.05
DISPLACEMENT_WARNING = 0.5  # of the model's largest extent
RESTART_EVERY_S = 1.0  # wall time between two restart states

Report = Callable[[str, float], None]  # stage ("compile", "run"), share done in [0, 1]


def _silent(stage: str, share: float) -> None:
    """Report to nobody."""


@dataclass(frozen=True)
class Status:
    """How a run ended: a state and, unless it finished, a sentence a user can act on."""

    state: str
    message: str = ""


class Transient:
    """Advances a simulation to its end with the largest stable step.

    The step is 0.9 of the limit that a Lanczos iteration gives for the current state, looked at every 2 to 100 steps, and
    divides the time to the next load edge into equal parts. Samples are taken at the first instant at or after the time
    asked for, and never change the step.

    Parameters
    ----------
    simulation : at time 0.
    duration_s : where to end.
    step_s : a fixed step instead.

    Raises
    ------
    InputError : ``step_s`` is above the stable limit.
    """

    def __init__(self, simulation: Simulation, duration_s: float, step_s: float | None = None) -> None:
        self.simulation = simulation
        self.duration_s = duration_s
        self.step_s = step_s
        edges = simulation.load_edges_s
        self._marks = np.append(edges[(edges > 0.0) & (edges < duration_s * (1.0 - 1e-9))], duration_s)
        self._mark = 0
        self._since = 0  # steps since the limit was looked at
        self._cadence = FEWEST_STEPS
        self._left = 0  # steps to the next mark
        self.limit_s = simulation.stable_limit(FIRST_TURNS)
        self.smallest_dt_s = np.inf
        self.largest_fraction = 0.0
        if step_s is not None and step_s > self.limit_s:
            number = simulation.limiting_element()
            raise InputError(
                f"analysis.step_us = {1e6 * step_s:g} is unstable: the largest stable step of this model is "
                f"{1e6 * self.limit_s:.4g} microseconds (set by element {number}); take a smaller one or leave the key out."
            )
        self._dt = 0.0
        self._divide(step_s or FRACTION * self.limit_s)
        simulation.start(self._dt)

    @property
    def finished(self) -> bool:
        return self.simulation.time_s >= self.duration_s

    def advance_to(self, time_s: float) -> Status | None:
        """Advance to the first instant at or after ``time_s``; a status if the run cannot go on."""
        simulation = self.simulation
        while simulation.time_s < min(time_s, self.duration_s) - 1e-6 * self._dt:
            if self._since >= self._cadence:
                status = self._look()
                if status:
                    return status
            target = min(time_s, self.duration_s)
            wanted = int(np.ceil((target - simulation.time_s) / self._dt - 1e-6))
            steps = max(1, min(wanted, self._left, self._cadence - self._since))
            if not simulation.advance(steps, self._dt):
                return self._inverted()
            self._since += steps
            self._left -= steps
            if self._left == 0:
                simulation.time_s = float(self._marks[self._mark])
                self._mark += 1
                if not self.finished:
                    self._divide(self.step_s or FRACTION * self.limit_s)
        return None

    def _look(self) -> Status | None:
        """Find the stable limit of the present state, and the step from it."""
        before = self.limit_s
        self.limit_s = self.simulation.stable_limit(TURNS)
        self._since = 0
        if not np.isfinite(self.limit_s):
            return self._inverted()
        self.largest_fraction = max(self.largest_fraction, self._dt / self.limit_s)
        fall = 1.0 - self.limit_s / before
        strain = self.simulation.largest_strain_rate() * self._dt
        # Twice as many as last time at most: a body that starts from rest has no rate yet.
        most = min(MOST_STEPS, 2 * self._cadence)
        self._cadence = int(np.clip(STRAIN_BETWEEN_LOOKS / max(strain, 1e-12), FEWEST_STEPS, most))
        if self.step_s is not None and self.step_s > self.limit_s:
            return Status(
                UNSTABLE,
                f"at {1e3 * self.simulation.time_s:.3f} ms the fixed step of {1e6 * self.step_s:g} microseconds has become "
                f"unstable: the tissue has stiffened and its limit is now {1e6 * self.limit_s:.4g} microseconds; "
                "leave analysis.step_us out or make it smaller.",
            )
        if self.step_s is None and not LOWEST_SHARE * self.limit_s <= self._dt <= FRACTION * self.limit_s:
            # A limit that is falling will go on falling until the next look.
            self._divide(FRACTION * self.limit_s * (1.0 - max(fall, 0.0)))
        return None

    def _divide(self, longest_s: float) -> None:
        """Equal steps, no longer than this, from here to the next mark."""
        time_left = self._marks[self._mark] - self.simulation.time_s
        self._left = max(1, int(np.ceil(time_left / longest_s - 1e-9)))
        self._dt = float(time_left / self._left)
        self.smallest_dt_s = min(self.smallest_dt_s, self._dt)
        self.largest_fraction = max(self.largest_fraction, self._dt / self.limit_s)

    def _inverted(self) -> Status:
        simulation = self.simulation
        J = simulation.snapshot().J
        broken = np.flatnonzero(~(J > 0.0))
        worst = int(broken[np.argmin(np.nan_to_num(J[broken], nan=-np.inf))] if len(broken) else np.argmin(J))
        x, y, z = 1e3 * simulation.model.mesh.points[simulation.model.mesh.hexes[worst]].mean(axis=0)
        return Status(
            INVERTED,
            f"at {1e3 * simulation.time_s:.3f} ms (step {simulation.steps}) element {worst} near "
            f"({x:.1f}, {y:.1f}, {z:.1f}) mm turned inside out (J = {J[worst]:.3g}): the forces there are too large for the "
            "tissue or the elements too coarse; lower force_N, choose another distribution or refine the mesh.",
        )

    # ---- restart ----

    def restart_state(self) -> dict[str, np.ndarray]:
        """Everything that the future depends on; minus the internal force follows from u, bit by bit."""
        return {
            "clock": np.array([self._dt, self.limit_s, self.smallest_dt_s, self.largest_fraction]),
            "counters": np.array([self._mark, self._since, self._cadence, self._left], dtype=np.int64),
            **self.simulation.restart_state(),
        }

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go on from a restart state of the same model."""
        self._dt, self.limit_s, self.smallest_dt_s, self.largest_fraction = (float(x) for x in state["clock"])
        self._mark, self._since, self._cadence, self._left = (int(x) for x in state["counters"])
        self.simulation.restore(state)


@dataclass
class Ledger:
    """Energies over the samples of a run, and what they say about it."""

    time_s: list[float] = field(default_factory=list)
    energies: list[np.ndarray] = field(default_factory=list)
    balance_error: float = 0.0
    _scale: float = 0.0

    def add(self, snapshot: Snapshot) -> float:
        """Note a sample; its balance error relative to the largest of external work, internal and kinetic energy so far."""
        e = snapshot.energies
        self.time_s.append(snapshot.time_s)
        self.energies.append(e)
        self._scale = max(self._scale, abs(e[EXTERNAL]), e[INTERNAL] + e[HOURGLASS], e[KINETIC])
        stored = e[INTERNAL] + e[HOURGLASS] + e[KINETIC] + e[DAMPED] - e[EXTERNAL]
        first = self.energies[0]
        start = first[INTERNAL] + first[HOURGLASS] + first[KINETIC] + first[DAMPED] - first[EXTERNAL]
        error = abs(stored - start) / self._scale if self._scale > 0.0 else 0.0
        self.balance_error = max(self.balance_error, error) if np.isfinite(error) else np.inf
        return error

    @property
    def hourglass_share(self) -> float:
        """Largest share of the hourglass energy in the elastic energy, where that is not next to nothing."""
        energies = np.array(self.energies)
        elastic = energies[:, INTERNAL] + energies[:, HOURGLASS]
        there = elastic > SHARE_FLOOR * elastic.max(initial=0.0)
        return float(np.max(energies[there, HOURGLASS] / elastic[there], initial=0.0))


@dataclass(frozen=True)
class Prepared:
    """A scenario that has been read and built, not yet compiled or run."""

    path: Path
    scenario: Scenario
    text: str
    model: Model
    anatomy: Anatomy
    simulation: Simulation


def prepare(path: Path | str, settings: Sequence[str] = ()) -> Prepared:
    """Read, check and build a scenario.

    Raises
    ------
    InputError : what is wrong with it, in one sentence.
    """
    path = Path(path)
    scenario, text = read_scenario(path, settings)
    try:
        model, anatomy = assemble(scenario, path.parent)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(str(path.parent)) else f"{path}: {error}") from None
    return Prepared(path, scenario, text, model, anatomy, Simulation(model))


def result_path(scenario_path: Path | str, out: Path | str = "outputs") -> Path:
    """Where the result of a scenario goes."""
    return Path(out) / f"{Path(scenario_path).stem}.vtkhdf"


def run(
    path: Path | str,
    out: Path | str = "outputs",
    *,
    settings: Sequence[str] = (),
    overwrite: bool = False,
    report: Report = _silent,
) -> dict[str, Any]:
    """Run a scenario to its end and store its result.

    Parameters
    ----------
    path : scenario file.
    out : folder of the result, made if it does not exist.
    settings : ``key=value`` pairs that replace what the file says.
    overwrite : replace a result that exists.
    report : called with the stage and the share of it that is done.

    Returns
    -------
    The summary: what ``explicitfe run --json`` prints. ``status`` is "finished", or says why the run ended early; then
    ``message`` holds a sentence for the user, and what was computed until then is stored.

    Raises
    ------
    InputError : nothing was run and nothing written.
    """
    begin = time.perf_counter()
    prepared = prepare(path, settings)
    scenario, simulation = prepared.scenario, prepared.simulation
    target = result_path(path, out)
    every_s = 1e-3 * scenario.record.every_ms
    duration_s = 1e-3 * scenario.analysis.duration_ms
    step_s = None if scenario.analysis.step_us is None else 1e-6 * scenario.analysis.step_us

    with _writer(prepared, target, overwrite, int(duration_s / every_s) + 2) as writer:
        compile_s = simulation.compile(lambda share: report("compile", share))
        transient = Transient(simulation, duration_s, step_s)
        ledger = Ledger()
        # Fields are stored as the recorder asks; wall time is that of computing and storing, without compiling.
        started = time.perf_counter()
        stored_at = -np.inf
        status: Status | None = None
        sample_number = 0
        try:
            while True:
                snapshot = simulation.snapshot()
                error = ledger.add(snapshot)
                _store(writer, prepared, snapshot, ledger, transient)
                now = time.perf_counter()
                if now - stored_at > RESTART_EVERY_S or transient.finished:
                    writer.restart(transient.restart_state())
                    stored_at = now
                report("run", min(1.0, simulation.time_s / duration_s))
                if not error < BALANCE_LIMIT:
                    status = _diverged(simulation, error)
                if status or transient.finished:
                    break
                sample_number = max(sample_number + 1, int(np.floor(simulation.time_s / every_s + 1e-9)) + 1)
                status = transient.advance_to(sample_number * every_s)
                if status:
                    break
        except KeyboardInterrupt:
            status = Status(INTERRUPTED, f"stopped by hand at {1e3 * simulation.time_s:.3f} ms; what is stored is complete.")
        status = status or Status(FINISHED)
        summary = _summary(prepared, target, status, ledger, transient, compile_s, time.perf_counter() - started)
        summary["total_s"] = time.perf_counter() - begin
        writer.finish(status.state, status.message, summary)
    return summary


def _diverged(simulation: Simulation, error: float) -> Status:
    return Status(
        DIVERGED,
        f"at {1e3 * simulation.time_s:.3f} ms the energy balance is off by {100 * error:.3g} %: energy comes from nowhere, "
        "as it does when the step is too long for a fast change; give a smaller analysis.step_us and report this.",
    )


def _writer(prepared: Prepared, target: Path, overwrite: bool, expected: int) -> ResultWriter:
    scenario, model, simulation = prepared.scenario, prepared.model, prepared.simulation
    wanted = set(scenario.record.fields)
    velocity = Quantity("m/s", 3, "velocity of the nodes")
    J = Quantity("1", 1, "volume over reference volume, det F")
    hourglass = Quantity("J", 1, "hourglass energy of the element")
    history = {
        "step": Quantity("1", 1, "steps done"),
        "dt": Quantity("s", 1, "time step"),
        "internal_energy": Quantity("J", 1, "strain energy of the law, without hourglass energy"),
        "hourglass_energy": Quantity("J", 1, "energy of hourglass control"),
        "kinetic_energy": Quantity("J", 1, "1/2 v(-).M v(+) of the half steps before and after"),
        "external_work": Quantity("J", 1, "work of muscles, loads and gravity"),
        "damping_loss": Quantity("J", 1, "energy lost to mass-proportional damping"),
        "balance_error": Quantity("1", 1, "largest energy balance error so far, relative"),
        "smallest_J": Quantity("1", 1, "smallest J of all elements in all steps so far"),
    }
    for name in model.probes:
        history[f"probe_{name}_displacement"] = Quantity("m", 3, f"displacement of {name}")
        history[f"probe_{name}_velocity"] = Quantity("m/s", 3, f"velocity of {name}")
    state = simulation.restart_state() | {"clock": np.zeros(4), "counters": np.zeros(4, dtype=np.int64)}
    return ResultWriter(
        target,
        mesh=model.mesh,
        point_fields={"velocity": velocity} if "velocity" in wanted else {},
        cell_fields={k: q for k, q in (("J", J), ("hourglass_energy", hourglass)) if k in wanted},
        history=history,
        scenario_text=prepared.text,
        model=describe(prepared),
        provenance=provenance(),
        restart=state,
        expected_samples=expected,
        overwrite=overwrite,
    )


def describe(prepared: Prepared) -> dict[str, Any]:
    """The model in words and numbers, as it is stored and shown."""
    model = prepared.model
    return {
        "name": prepared.anatomy.name,
        "nodes": model.mesh.node_count,
        "hexes": model.mesh.element_count,
        "volume_mm3": float(1e9 * prepared.simulation.volumes.sum()),
        "mass_g": float(1e3 * model.material.density_kg_m3 * prepared.simulation.volumes.sum()),
        "material": model.material.model_dump(),
        "alpha_per_s": model.alpha_per_s,
        "fixed_nodes": int(model.held.all(axis=1).sum()),
        "muscles": [muscle.model_dump() for muscle in prepared.scenario.muscle],
        "probes": {name: int(node) for name, node in model.probes.items()},
    }


def _store(writer: ResultWriter, prepared: Prepared, snapshot: Snapshot, ledger: Ledger, transient: Transient) -> None:
    wanted = set(prepared.scenario.record.fields)
    e = snapshot.energies
    row: dict[str, Any] = {
        "step": transient.simulation.steps,
        "dt": transient.simulation.dt_s,
        "internal_energy": e[INTERNAL],
        "hourglass_energy": e[HOURGLASS],
        "kinetic_energy": e[KINETIC],
        "external_work": e[EXTERNAL],
        "damping_loss": e[DAMPED],
        "balance_error": ledger.balance_error,
        "smallest_J": snapshot.smallest_J,
    }
    for name, node in prepared.model.probes.items():
        row[f"probe_{name}_displacement"] = snapshot.displacement[node]
        row[f"probe_{name}_velocity"] = snapshot.velocity[node]
    writer.history(snapshot.time_s, row)
    points = {"displacement": snapshot.displacement} | ({"velocity": snapshot.velocity} if "velocity" in wanted else {})
    cells = {"J": snapshot.J, "hourglass_energy": snapshot.hourglass_energy}
    writer.sample(snapshot.time_s, points, {name: value for name, value in cells.items() if name in wanted})


def _warnings(prepared: Prepared, ledger: Ledger, last: Snapshot) -> list[str]:
    """What a user should know before believing the result."""
    mesh = prepared.model.mesh
    found = []
    if ledger.hourglass_share > HOURGLASS_WARNING:
        energies = np.array(ledger.energies)
        at_end = energies[-1, HOURGLASS] / max(energies[-1, INTERNAL] + energies[-1, HOURGLASS], 1e-300)
        worst = int(np.argmax(last.hourglass_energy))
        x, y, z = 1e3 * mesh.points[mesh.hexes[worst]].mean(axis=0)
        found.append(
            f"hourglass energy reaches {100 * ledger.hourglass_share:.0f} % of the elastic energy ({100 * at_end:.0f} % at the "
            f"end, most of it in element {worst} near ({x:.0f}, {y:.0f}, {z:.0f}) mm): the mesh is coarse for this "
            "deformation; compare with a finer resolution before quoting numbers."
        )
    moved = float(np.linalg.norm(last.displacement, axis=1).max())
    extent = float(np.ptp(mesh.points, axis=0).max())
    if moved > DISPLACEMENT_WARNING * extent:
        found.append(
            f"a node has moved by {1e3 * moved:.0f} mm, more than half the model's largest extent ({1e3 * extent:.0f} mm): "
            "the forces are large for this tissue."
        )
    return found


def _summary(
    prepared: Prepared,
    target: Path,
    status: Status,
    ledger: Ledger,
    transient: Transient,
    compile_s: float,
    wall_s: float,
) -> dict[str, Any]:
    simulation = transient.simulation
    last = simulation.snapshot()
    finite = bool(np.isfinite(last.energies).all())
    speed = np.linalg.norm(last.velocity, axis=1)
    path_length = np.linalg.norm(last.displacement, axis=1)
    return {
        "status": status.state,
        "message": status.message,
        "warnings": _warnings(prepared, ledger, last),
        "result": str(target),
        "title": prepared.scenario.title,
        "nodes": prepared.model.mesh.node_count,
        "hexes": prepared.model.mesh.element_count,
        "simulated_s": simulation.time_s,
        "steps": simulation.steps,
        "dt_s": float(transient.smallest_dt_s),
        "dt_fraction_of_limit": float(transient.largest_fraction),
        "limiting_element": simulation.limiting_element() if finite else None,
        "wall_s": wall_s,
        "compile_s": compile_s,
        "real_time_factor": simulation.time_s / wall_s,
        "energy_balance_error": ledger.balance_error,
        "hourglass_share": ledger.hourglass_share,
        "min_J": float(simulation.ledger[SMALLEST_J]),
        # At its present speed no node would move by 5 % of the largest displacement in another 100 ms.
        "settled": bool(finite and 0.1 * speed.max() < 0.05 * path_length.max()),
        "largest_displacement_mm": float(1e3 * path_length.max()),
        "largest_speed_mm_s": float(1e3 * speed.max()),
        "probes": {
            name: {
                "displacement_mm": [float(1e3 * x) for x in last.displacement[node]],
                "speed_mm_s": float(1e3 * speed[node]),
            }
            for name, node in prepared.model.probes.items()
        },
    }
