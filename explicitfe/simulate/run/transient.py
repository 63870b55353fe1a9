"""A run in time: muscles pull, the body moves; advanced, recorded and summed up."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self, cast

import numpy as np

from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.mesh.self_contact import self_penetration
from explicitfe.fem.solve.ledger import Ledger, impact_energy, rounding_of
from explicitfe.fem.solve.observe import Recording, Snapshot
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import (
    CROSSED,
    DIVERGED,
    FINISHED,
    INTERRUPTED,
    TURNS_AT_THE_START,
    Status,
    Transient,
    step_share,
)
from explicitfe.platform.compiled.arrays import BARRIER, ENERGIES, HOURGLASS, INTERNAL, SMALLEST_J
from explicitfe.platform.errors import InputError, Progress
from explicitfe.platform.host import stopping
from explicitfe.results.documents.run_summary import (
    FoldedElements,
    RunSummary,
    SurgeryReport,
    TransientCheckReport,
    TransientModelDescription,
    TransientSummary,
    point_at_rest,
    probes_of,
)
from explicitfe.results.files import ResultInMemory, ResultWriter, open_result, provenance
from explicitfe.results.files.layout import Declaration, Origin
from explicitfe.results.measure.motion import has_settled, largest_displacement
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.loads import initial_velocity
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.run.analysis import (
    BENDING_WARNING_SHARE,
    HOURGLASS_WARNING_SHARE,
    Analysis,
    Begun,
    how_to_resume,
    restart_extras,
)
from explicitfe.simulate.run.crossings import CROSSING_WARNING_M, Crossings
from explicitfe.simulate.run.machine_code import kernels_of, make_ready
from explicitfe.simulate.run.notes import balance_notes, holding_nodes
from explicitfe.simulate.run.outlook import check_room, check_steps, warn_of_long_run
from explicitfe.simulate.run.quantities import ENERGY_COLUMNS, cell_fields, fields_of, history_columns, history_rows, point_fields
from explicitfe.simulate.run.stress_fields import needs_stress, numbers_per
from explicitfe.simulate.scenario.transient import MuscleTable, TransientScenario

BALANCE_ERROR_LIMIT = 0.1  # above it is no rounding: energy comes from nowhere, as it does when the step is too long
DISPLACEMENT_WARNING_SHARE = 0.5  # of the model's largest extent: above it the forces are large for the tissue
FIRST_ROOM_BYTES = 64e6  # of samples that a result file is made for at first; it grows when they are full
RESTART_EVERY_S = 1.0  # wall time between two restart states


@dataclass(frozen=True)
class TransientAnalysis(Analysis[TransientScenario, Simulation]):
    """A run in time.

    Attributes
    ----------
    surgery : what was taken from the body before; None where nothing was.
    """

    surgery: SurgeryReport | None = None

    @classmethod
    def prepare(cls, path: Path, scenario: TransientScenario, text: str) -> Self:
        """Build the model of a tongue, or of a mesh of one's own, with its muscles."""
        model, anatomy, surgery, displacement = assemble(scenario, path.parent)
        stress = needs_stress(scenario.record.fields)
        velocity, threads = initial_velocity(model.mesh, scenario), scenario.analysis.threads
        simulation = Simulation(model, displacement=displacement, velocity=velocity, threads=threads, stress=stress)
        notes = (*anatomy.notes, *(() if surgery is None else surgery["notes"]))
        return cls(path, scenario, text, model, anatomy.name, simulation, notes, surgery=surgery)

    def describe(self) -> TransientModelDescription:
        """The model with its damping, muscles and probes."""
        damping = self.scenario.model.damping
        airway = None if self.scenario.model.name is None else catalogue.airway(self.scenario.model.name)
        return {
            **self._description(),
            # as it was chosen: in the model the branch that damps like beta is part of it
            "material": catalogue.material(self.scenario.model.material).model_dump(),
            "alpha_per_s": damping.alpha_per_s,
            "beta_s": damping.beta_s,
            "muscles": [muscle.model_dump() for muscle in self.scenario.muscle],
            "bones": [bone.name for bone in self.model.bones],
            "held_area_mm2": {tie.name: float(1e6 * tie.areas_m2.sum()) for tie in self.model.attachments},
            "surgery": self.surgery,
            "airway": None if airway is None else airway.model_dump(mode="json"),
            "probes": {name: point_at_rest(point) for name, point in self.model.probes.items()},
        }

    def run(
        self, target: Path | ResultInMemory, *, overwrite: bool, progress: Progress, begun: Begun | None = None
    ) -> TransientSummary:
        """Advance to the end, with samples as the scenario asks for; see ``Analysis.run``."""
        begin = time.perf_counter()
        scenario, simulation = self.scenario, self.body
        every_s = 1e-3 * scenario.record.every_ms
        duration_s = 1e-3 * scenario.analysis.duration_ms
        step_s = None if scenario.analysis.step_us is None else 1e-6 * scenario.analysis.step_us
        expected = int(duration_s / every_s) + 2
        if begun is None and isinstance(target, Path):
            check_room(target, self._result_bytes(), "take a longer record.every_ms, fewer record.fields or another `out`")

        largest_m = 0.0 if begun is None else _largest_stored(begun)
        omitted = self._surfaces_without_contact()
        crossings = Crossings(self.model.mesh, self.model.bones, omitted, simulation.bodies_in_contact)
        with self._opened(target, overwrite, expected, begun) as writer:
            compile_s = make_ready(simulation, progress, kernels_of(self.name, self.model.element, self.scenario.effects))
            try:
                transient = Transient(simulation, duration_s, step_s)
                check_steps(duration_s / transient.smallest_dt_s, transient.smallest_dt_s)
            except InputError as error:
                raise InputError(f"{self.path}: {error}") from None
            ledger = Ledger(rounding_J=max(rounding_of(simulation), impact_energy(simulation)))
            # Fields are stored as the recorder asks; wall time is that of computing and storing, without compiling.
            started = time.perf_counter()
            # The first state is stored before the first sample: from there a run begins again, that sample included.
            if begun is not None and begun.state is not None and begun.state.arrays["samples"] > 0:
                ledger.add_until(_energies(begun.rows), BALANCE_ERROR_LIMIT)
                crossings.restore(begun.rows)
                transient.restore(begun.state.arrays)
                started -= float(begun.state.arrays["seconds"])
            # a run that goes on may have other threads than it was begun with; its file keeps the shape of its states
            threads = len(simulation.parts) if begun is None or begun.state is None else len(begun.state.arrays["ledgers"])
            writer.restart(transient.restart_state(threads) | restart_extras(len(ledger.energies), time.perf_counter() - started))
            stored_at = time.perf_counter()
            begun_at_s, paced, status = simulation.time_s, False, cast(Status | None, None)
            for recording in transient.recordings(every_s):
                if not paced and simulation.time_s > begun_at_s:
                    pace = simulation.course_s / (simulation.time_s - begun_at_s)
                    steps = (duration_s - begun_at_s) / transient.smallest_dt_s
                    warn_of_long_run(
                        pace * (duration_s - begun_at_s), f"{steps:.2g} steps of {1e6 * simulation.dt_s:.3g} microseconds"
                    )
                    paced = True
                count, imbalance = ledger.add_until(recording.energies, BALANCE_ERROR_LIMIT)
                if count:
                    self._store(writer, recording, ledger, count)
                    seen, some = recording.arrays, slice(0, count)
                    largest_m = max(largest_m, largest_displacement(seen.displacement[some]))
                    if sentence := crossings.add(recording.time_s[some], seen, count):
                        status = Status(CROSSED, sentence)
                        break
                if not imbalance < BALANCE_ERROR_LIMIT:
                    status = _diverged(float(recording.time_s[count - 1]), imbalance)
                    break
                status = transient.status
                now = time.perf_counter()
                stopped = status is not None and status.state == INTERRUPTED
                if stopped or (status is None and (now - stored_at > RESTART_EVERY_S or transient.finished)):
                    state = transient.restart_state(threads) | restart_extras(len(ledger.energies), now - started)
                    writer.restart(state)
                    stored_at = now
                with suppress(stopping.Stopped):  # the next step notices it, where the run can be left
                    progress("run", min(1.0, simulation.time_s / duration_s))
            status = status or Status(FINISHED)
            place = writer.place(status.state)
            if status.state == INTERRUPTED:
                status = Status(INTERRUPTED, f"{status.message} of {1e3 * duration_s:g} ms; {how_to_resume(place)}")
            seconds = time.perf_counter() - started
            summary = self._summary(place, status, ledger, transient, compile_s, seconds, writer.last_row, largest_m, crossings)
            if isinstance(writer, ResultWriter):
                summary = self._completed(summary)
            summary["total_s"] = self.prepare_s + time.perf_counter() - begin
            writer.finish(status.state, status.message, summary)
        return summary

    def check(self, progress: Progress) -> TransientCheckReport:
        """Mesh, stable step, steps and wall time; see ``Analysis.check``."""
        simulation, scenario = self.body, self.scenario
        mesh_report = self._mesh_report()
        make_ready(simulation, progress, kernels_of(self.name, self.model.element, self.scenario.effects))
        bound_s, element = simulation.stable_bound()
        limit_s = simulation.stable_limit(TURNS_AT_THE_START)
        fixed = scenario.analysis.step_us
        dt_s = step_share(self.model) * limit_s if fixed is None else 1e-6 * fixed
        steps = int(np.ceil(1e-3 * scenario.analysis.duration_ms / dt_s))
        return {
            **self.describe(),
            **mesh_report,
            "stable_step_us": 1e6 * limit_s,
            "stable_step_bound_us": 1e6 * bound_s,
            "limiting_element": element,
            "step_us": 1e6 * dt_s,
            "stable": bool(dt_s <= limit_s),
            "predicted_steps": steps,
            "predicted_wall_s": steps * self._seconds_per_step(),
            "kernel_memory_MB": self._kernel_memory_MB(),
            "result_size_MB": self._result_bytes() / 1e6,
        }

    # ---- inside ----

    def _surfaces_without_contact(self) -> dict[str, TriangleSurface]:
        """Surfaces of the built-in model that the scenario omits; a jaw that is omitted stays where it is."""
        if self.scenario.model.name not in catalogue.model_folders():
            return {}
        shapes = catalogue.bones(self.scenario.model.name)
        return {name: shape.surface for name, shape in shapes.items() if name not in {bone.name for bone in self.model.bones}}

    def _completed(self, summary: RunSummary) -> TransientSummary:
        whole = cast(TransientSummary, summary)
        if np.isfinite(self.body.snapshot().energies).all():
            whole["limiting_element"] = self.body.limiting_element()  # it takes as long as 500 steps
        return whole

    def _result_bytes(self) -> float:
        """Size of the fields in the result."""
        record, mesh = self.scenario.record, self.model.mesh
        samples = int(self.scenario.analysis.duration_ms / record.every_ms) + 1
        per_node = 8 * (3 * (1 + ("velocity" in record.fields)) + numbers_per(record.fields, "point"))
        per_element = 8 * (len({"J", "hourglass_energy"} & set(record.fields)) + numbers_per(record.fields, "cell"))
        return float(samples * (per_node * mesh.node_count + per_element * mesh.element_count))

    def _writer(self, target: Path | ResultInMemory, overwrite: bool, expected: int) -> ResultWriter | ResultInMemory:
        scenario, model, simulation = self.scenario, self.model, self.body
        wanted = set(scenario.record.fields)
        per_sample = 8 * (6 * model.mesh.node_count + 2 * model.mesh.element_count)
        room = max(8, int(FIRST_ROOM_BYTES / per_sample))
        declared = Declaration(
            mesh=model.mesh,
            point_fields=point_fields(wanted, model),
            cell_fields=cell_fields(wanted),
            history=history_columns(model, [*simulation.bodies_in_contact], simulation.holders),
            bones={bone.name: (bone.surface.points, bone.surface.triangles) for bone in model.bones},
            fibres=model.fibres,
        )
        if isinstance(target, ResultInMemory):
            return target.begin(declared, self.describe())
        state = (
            simulation.restart_state() | {"clock": np.zeros(3), "counters": np.zeros(2, dtype=np.int64)} | restart_extras(0, 0.0)
        )
        return ResultWriter(
            target,
            declared,
            Origin(self.text, self._stored_model(), provenance()),
            restart=state,
            expected_samples=min(expected, room),
            overwrite=overwrite,
        )

    def _store(self, writer: ResultWriter | ResultInMemory, recording: Recording, ledger: Ledger, count: int) -> None:
        """Store the first ``count`` samples of a recording."""
        rows = history_rows(recording, count, [*self.body.bodies_in_contact])
        rows["balance_error"] = np.array(ledger.balance_errors[-count:])
        fields = fields_of(recording, count, set(self.scenario.record.fields))
        writer.samples(recording.time_s[:count], rows, *fields)

    def _warnings(self, ledger: Ledger, last: Snapshot, folded: FoldedElements, crossings: Crossings) -> list[str]:
        """Warnings on the quality of the result."""
        mesh, spread = self.model.mesh, how_to_spread(self.scenario.muscle)
        warnings = [*self.notes]
        if ledger.hourglass_share > (BENDING_WARNING_SHARE if self.model.element == "hex8" else HOURGLASS_WARNING_SHARE):
            worst = int(np.argmax(last.hourglass_energy))
            x, y, z = 1e3 * mesh.points[mesh.hexes[worst]].mean(axis=0)
            warnings.append(
                f"hourglass energy reaches {100 * ledger.hourglass_share:.0f} % of the elastic energy "
                f"({100 * ledger.hourglass_share_at_end:.0f} % at the end, most of it in element {worst} near "
                f"({x:.0f}, {y:.0f}, {z:.0f}) mm): the mesh is coarse for this deformation, or a force acts on too few nodes; "
                f"compare with a finer resolution{f', or {spread}' if spread else ''}."
            )
        if folded["elements"]:
            warnings.append(
                f"{folded['elements']} of {mesh.element_count} elements are inverted at the end. One-point integration does not "
                f'prevent this; {f"{spread}, " if spread else ""}reduce the forces, or set element = "hex8-full" and compare.'
            )
        if not np.isfinite(last.displacement).all():
            return warnings
        through, modelled = self_penetration(mesh, last.displacement), self.model.surfaces is not None
        if through.where_m is not None and through.deepest_m > (CROSSING_WARNING_M if modelled else 0.0):
            x, y, z = 1e3 * through.where_m
            why = (
                "the forces are too large for the contact springs, or the mesh is coarse for an edge that presses on a surface; "
                "reduce the forces, or refine the mesh."
                if modelled
                else "the scenario has no contact of surfaces with each other; add [contact], or reduce the forces."
            )
            warnings.append(
                f"the body passes through itself at the end: {through.count} nodes of its surface are inside other elements, up "
                f"to {1e3 * through.deepest_m:.1f} mm deep near ({x:.0f}, {y:.0f}, {z:.0f}) mm: {why}"
            )
        warnings += crossings.warnings(last.displacement, last.time_s)
        moved = float(np.linalg.norm(last.displacement, axis=1).max())
        extent = float(np.ptp(mesh.points, axis=0).max())
        if moved > DISPLACEMENT_WARNING_SHARE * extent and holding_nodes(self.model).any():
            warnings.append(
                f"a node has moved by {1e3 * moved:.0f} mm, more than half the largest extent of the model "
                f"({1e3 * extent:.0f} mm): the forces are too large for this tissue; check their values and units."
            )
        energies = np.array(ledger.energies)
        elastic = energies[:, INTERNAL] + energies[:, HOURGLASS]
        barrier_share = np.max(energies[:, BARRIER] / np.where(elastic > 0.0, elastic, np.inf), initial=0.0)
        return [*warnings, *balance_notes(ledger.balance_error_of_run, float(barrier_share))]

    def _summary(
        self,
        target: Path,
        status: Status,
        ledger: Ledger,
        transient: Transient,
        compile_s: float,
        wall_s: float,
        last_row: Mapping[str, np.ndarray],
        largest_m: float,
        crossings: Crossings,
    ) -> TransientSummary:
        simulation, mesh = transient.simulation, self.model.mesh
        last = simulation.snapshot()
        folded = self._folded(last.displacement)
        finite = bool(np.isfinite(last.energies).all())
        speed = np.linalg.norm(last.velocity, axis=1)
        path_length = np.linalg.norm(last.displacement, axis=1)
        return {
            "status": status.state,
            "message": status.message,
            "warnings": self._warnings(ledger, last, folded, crossings),
            "result": str(target),
            "title": self.scenario.title,
            "nodes": mesh.node_count,
            "hexes": mesh.element_count,
            "simulated_s": simulation.time_s,
            "steps": simulation.steps,
            "threads": len(simulation.parts),
            "dt_s": float(transient.smallest_dt_s),
            "dt_fraction_of_limit": float(transient.largest_fraction),
            "limiting_element": None,
            "wall_s": wall_s,
            "loop_s": simulation.loop_s,
            "look_s": simulation.look_s,
            "sample_s": simulation.sample_s,
            "compile_s": compile_s,
            "real_time_factor": simulation.time_s / wall_s,
            "energy_balance_error": ledger.balance_error,
            "hourglass_share": ledger.hourglass_share,
            "hourglass_share_end": ledger.hourglass_share_at_end,
            "min_J": float(simulation.ledger[SMALLEST_J]),
            "folded": folded,
            "settled": finite and has_settled(float(speed.max()), max(largest_m, float(path_length.max()))),
            "largest_displacement_mm": float(1e3 * path_length.max()),
            "largest_speed_mm_s": float(1e3 * speed.max()),
            "probes": probes_of({name: np.asarray(value)[None] for name, value in last_row.items()}),
        }


def how_to_spread(muscles: Sequence[MuscleTable]) -> str:
    """Advice to distribute the forces of muscles that act on nodes; empty if there is no such muscle."""
    names = list(dict.fromkeys(m.name for m in muscles if m.force_N > 0.0 and m.distribution != "stress"))
    if not names:
        return ""
    return f'distribute the force{"s" * (len(names) > 1)} of {" and ".join(names)} (distribution = "stress")'


def _energies(rows: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energies of the samples of a history, (k, ENERGIES) J."""
    energies = np.zeros((len(rows["time"]), ENERGIES))
    for name, entry in ENERGY_COLUMNS.items():
        energies[:, entry] = rows[name]
    return energies


def _largest_stored(begun: Begun) -> float:
    """The largest displacement of any node, m, in the samples of an interrupted run that are kept."""
    if begun.state is None:
        return 0.0
    with open_result(begun.path) as stored:
        return max((largest_displacement(stored.displacement(k)) for k in range(int(begun.state.arrays["samples"]))), default=0.0)


def _diverged(time_s: float, error: float) -> Status:
    return Status(
        DIVERGED,
        f"at {1e3 * time_s:.3f} ms the error of the energy balance is {100 * error:.3g} %, because the time step is too long "
        "for a fast change; reduce analysis.step_us, and please report this.",
    )
