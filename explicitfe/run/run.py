"""From a scenario file to a result file: read, build, compile, run, record, summarise."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.compiled.arrays import DAMPED, EXTERNAL, HOURGLASS, INTERNAL, KINETIC, LOST, SMALLEST_J
from explicitfe.errors import InputError, Progress, silent
from explicitfe.mesh.quality import corner_jacobians
from explicitfe.results import Quantity, ResultWriter, provenance
from explicitfe.run.indentation import run_indentation
from explicitfe.run.prepare import Prepared, describe, prepare
from explicitfe.scenario.indentation import IndentationScenario
from explicitfe.solve.simulation import Simulation, Snapshot
from explicitfe.solve.transient import DIVERGED, FINISHED, INTERRUPTED, Ledger, Status, Transient

# A balance error above this is no rounding: energy comes from nowhere, as it does when the step is too long.
BALANCE_LIMIT = 0.1
# Above these a result comes with a warning.
HOURGLASS_WARNING = 0.05
DISPLACEMENT_WARNING = 0.5  # of the model's largest extent
FIRST_ROOM_BYTES = 64e6  # of samples that a result file is made for at first; it grows when they are full
RESTART_EVERY_S = 1.0  # wall time between two restart states


def result_path(scenario_path: Path | str, out: Path | str = "outputs") -> Path:
    """Where the result of a scenario goes."""
    return Path(out) / f"{Path(scenario_path).stem}.vtkhdf"


def run(
    path: Path | str,
    out: Path | str = "outputs",
    *,
    settings: Sequence[str] = (),
    notes: Sequence[str] = (),
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run a scenario to its end and store its result.

    Parameters
    ----------
    path : scenario file.
    out : folder of the result, made if it does not exist.
    settings : ``key=value`` pairs that replace what the file says.
    notes : sentences for the user that the summary begins its warnings with.
    overwrite : replace a result that exists.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    The summary: what ``explicitfe run --json`` prints. ``status`` is "finished", or says why the run ended early; then
    ``message`` holds a sentence for the user, and what was computed until then is stored.

    Raises
    ------
    InputError : nothing was run and nothing written.
    """
    begin = time.perf_counter()
    prepared = replace(prepare(path, settings), notes=tuple(notes))
    target = result_path(path, out)
    if isinstance(prepared.scenario, IndentationScenario):
        return run_indentation(prepared, target, overwrite, progress, begin)
    return _run_transient(prepared, target, overwrite, progress, begin)


def _run_transient(prepared: Prepared, target: Path, overwrite: bool, progress: Progress, begin: float) -> dict[str, Any]:
    scenario, simulation = prepared.scenario, prepared.simulation
    every_s = 1e-3 * scenario.record.every_ms
    duration_s = 1e-3 * scenario.analysis.duration_ms
    step_s = None if scenario.analysis.step_us is None else 1e-6 * scenario.analysis.step_us

    with _writer(prepared, target, overwrite, int(duration_s / every_s) + 2) as writer:
        compile_s = simulation.compile(lambda share: progress("compile", share))
        try:
            transient = Transient(simulation, duration_s, step_s)
        except InputError as error:
            raise InputError(f"{prepared.path}: {error}") from None
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
                progress("run", min(1.0, simulation.time_s / duration_s))
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
        "material_loss": Quantity("J", 1, "energy lost in the material: work of its stress, less what is stored"),
        "balance_error": Quantity("1", 1, "largest energy balance error so far, relative"),
        "smallest_J": Quantity("1", 1, "smallest J of all elements in all steps so far"),
    }
    for name in model.probes:
        history[f"probe_{name}_displacement"] = Quantity("m", 3, f"displacement of {name}")
        history[f"probe_{name}_velocity"] = Quantity("m/s", 3, f"velocity of {name}")
    per_sample = 8 * (6 * model.mesh.node_count + 2 * model.mesh.element_count)
    room = max(8, int(FIRST_ROOM_BYTES / per_sample))
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
        expected_samples=min(expected, room),
        overwrite=overwrite,
    )


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
        "material_loss": e[LOST],
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
    found = [*prepared.notes]
    if ledger.hourglass_share > HOURGLASS_WARNING:
        worst = int(np.argmax(last.hourglass_energy))
        x, y, z = 1e3 * mesh.points[mesh.hexes[worst]].mean(axis=0)
        found.append(
            f"hourglass energy reaches {100 * ledger.hourglass_share:.0f} % of the elastic energy "
            f"({100 * ledger.hourglass_share_at_end:.0f} % at the end, most of it in element {worst} near "
            f"({x:.0f}, {y:.0f}, {z:.0f}) mm): the mesh is coarse for this deformation, or a force acts on too few nodes; "
            'compare with a finer resolution, or spread the force (distribution = "along"), before quoting numbers.'
        )
    folded = int(np.sum(np.any(corner_jacobians(mesh.points + last.displacement, mesh.hexes) <= 0.0, axis=1)))
    if folded:
        found.append(
            f"{folded} of {mesh.element_count} elements are folded at a corner at the end, which one integration point does not "
            'resist: spread the forces (distribution = "along") or lower them, and compare with element = "hex8-full".'
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
        "threads": len(simulation.parts),
        "dt_s": float(transient.smallest_dt_s),
        "dt_fraction_of_limit": float(transient.largest_fraction),
        "limiting_element": simulation.limiting_element() if finite else None,
        "wall_s": wall_s,
        "loop_s": simulation.loop_s,
        "compile_s": compile_s,
        "real_time_factor": simulation.time_s / wall_s,
        "energy_balance_error": ledger.balance_error,
        "hourglass_share": ledger.hourglass_share,
        "hourglass_share_end": ledger.hourglass_share_at_end,
        "min_J": float(simulation.ledger[SMALLEST_J]),
        # At its present speed no node would move by more than 5 % of the largest displacement in another 100 ms.
        "settled": bool(finite and 0.1 * speed.max() <= 0.05 * path_length.max()),
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
