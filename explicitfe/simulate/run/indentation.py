"""An indentation: load after load to equilibrium, recorded and summed up."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from explicitfe.fem.solve.contact_points import MISSED_SHARE_OF_LOAD, PENETRATION_SHARE
from explicitfe.fem.solve.equilibrium import LEAST_SHARE_OF_LARGEST_LOAD, Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium, Stuck
from explicitfe.fem.solve.transient import FINISHED, INTERRUPTED
from explicitfe.platform.errors import InputError, Progress, Share, counted
from explicitfe.platform.host import stopping
from explicitfe.platform.host.digits import distinct
from explicitfe.results.documents.run_summary import (
    CURVE_COLUMNS,
    LOAD_COLUMNS,
    FoldedElements,
    IndentationCheckReport,
    IndentationModelDescription,
    IndentationSummary,
)
from explicitfe.results.files import Quantity, ResultInMemory, ResultWriter, provenance
from explicitfe.results.files.layout import Declaration, Origin
from explicitfe.simulate.anatomy.specimen import specimen_model
from explicitfe.simulate.run.analysis import HOURGLASS_WARNING_SHARE, Analysis, Begun, how_to_resume, restart_extras
from explicitfe.simulate.run.machine_code import kernels_of, make_ready
from explicitfe.simulate.run.notes import equilibrium_notes
from explicitfe.simulate.run.outlook import check_room, warn_of_long_run
from explicitfe.simulate.run.stress_fields import needs_stress, numbers_per, stress_fields, stress_quantities
from explicitfe.simulate.run.work import balance_of, external_work
from explicitfe.simulate.scenario.indentation import IndentationScenario

DEPTH_WARNING_SHARE = 0.4  # of the thickness: a deeper indentation depends on how high the specimen is and how it is held
ADVICE_ON_STIFFNESS = (
    "Relaxation converges slowly for nearly incompressible tissue, layers of very different stiffness and very small loads: "
    "reduce model.material.poisson or the ratio of the layers, or increase analysis.tolerance."
)
ITERATIONS_PER_LOAD = 3000  # at a residual of 1e-4 and Poisson's ratio 0.499, as seen on the default specimen

INDENTATION_HISTORY = {
    "force": Quantity("N", 1, "force of the whole tool, positive into the tissue"),
    "indentation": Quantity("m", 1, "way of the tool since first touch"),
    "iterations": Quantity("1", 1, "iterations of dynamic relaxation for this load"),
    "residual": Quantity("1", 1, "nodal forces that nothing balances, relative to those of tool and loads"),
    "kinetic_ratio": Quantity("1", 1, "kinetic energy of the last iteration, relative to the work"),
    "base_reaction": Quantity("N", 1, "force of the base along +z, without the weight"),
    "penetration": Quantity("m", 1, "deepest point of the surface inside the tool"),
    "contact_radius": Quantity("m", 1, "largest distance from the axis at which the tool presses"),
    "internal_energy": Quantity("J", 1, "strain energy of the law, without hourglass energy; of the whole specimen"),
    "hourglass_energy": Quantity("J", 1, "energy of hourglass control"),
    "contact_energy": Quantity("J", 1, "energy of the contact springs"),
    "dead_work": Quantity("J", 1, "work of gravity so far"),
    "external_work": Quantity("J", 1, "work of the tool, by a spline through the loads, and of gravity since first touch"),
    "friction_loss": Quantity("J", 1, "energy lost to friction"),
    "material_loss": Quantity("J", 1, "energy lost in the material: work of its stress, less what is stored"),
    "smallest_J": Quantity("1", 1, "smallest J of any element"),
    "folded_elements": Quantity("1", 1, "number of inverted elements"),
}
# Number of an equilibrium -> column of the history.
EQUILIBRIUM_COLUMNS = {name: column for column, name in (CURVE_COLUMNS | LOAD_COLUMNS).items()}
INDENTATION_FIELDS: dict[str, Quantity] = {
    "J": Quantity("1", 1, "volume over reference volume, det F"),
    "strain_energy_density": Quantity("Pa", 1, "strain energy over reference volume, with that of hourglass control"),
    "hourglass_energy": Quantity("J", 1, "hourglass energy of the element"),
}


@dataclass(frozen=True)
class IndentationAnalysis(Analysis[IndentationScenario, Relaxation]):
    """A tool comes down on a specimen, from one equilibrium to the next."""

    @classmethod
    def prepare(cls, path: Path, scenario: IndentationScenario, text: str) -> Self:
        """Build the specimen and the tool above it."""
        deepest_mm = max(scenario.analysis.displacements_mm or [0.0])
        if deepest_mm >= scenario.model.thickness_mm:
            raise InputError(
                f"analysis.displacements_mm goes {deepest_mm:g} mm into {scenario.model.thickness_mm:g} mm of tissue, to the "
                "rigid base below it, where no room is left for any; stay above."
            )
        model = specimen_model(scenario.model, scenario.tool, scenario.effects.chosen)
        body = Relaxation(model, scenario.analysis.tolerance, scenario.analysis.threads)
        return cls(path, scenario, text, model, scenario.model.name, body)

    def describe(self) -> IndentationModelDescription:
        """The specimen with its tool."""
        return {
            **self._description(),
            "copies": self.model.copies,
            "tool": self.scenario.tool.model_dump(exclude_none=True),
        }

    def run(
        self, target: Path | ResultInMemory, *, overwrite: bool, progress: Progress, begun: Begun | None = None
    ) -> IndentationSummary:
        """Go from load to load; see ``Analysis.run``. Where a load is not reached, ``curve`` ends with the last one that was."""
        begin = time.perf_counter()
        body = self.body
        analysis = self.scenario.analysis
        by_force = analysis.forces_N is not None
        loads = [load if by_force else 1e-3 * load for load in analysis.course]
        times = analysis.times_s or [float(k) for k in range(1, len(loads) + 1)]

        state = None if begun is None else begun.state
        if begun is None and isinstance(target, Path):
            check_room(target, self._result_bytes(), "take fewer loads, fewer record.fields or another `out`")
        with self._opened(target, overwrite, len(loads) + 1, begun) as writer:
            compile_s = make_ready(body, progress, kernels_of(self.name, self.model.element, self.scenario.effects))
            started = time.perf_counter()
            curve: list[Equilibrium] = []
            if begun is not None and state is not None:
                curve = _equilibria(begun.rows)
                body.restore(state.arrays)
                started -= float(state.arrays["seconds"])
            progress("load-step", counted(max(0, len(curve) - 1), len(loads), "load"))
            status, message = FINISHED, ""
            try:
                if not curve:
                    settled = body.settle()
                    if isinstance(settled, Stuck):
                        raise InputError(self._stuck(settled, "gravity alone"))
                    curve.append(settled)
                    self._store(writer, curve, 0.0, started)
                first, paced = len(curve) - 1, time.perf_counter()
                for k, (load, at) in list(enumerate(zip(loads, times, strict=True)))[first:]:
                    go = body.press if by_force else body.move

                    def report(share: float, k: int = k) -> None:
                        progress("load-step", Share((k + share) / len(loads), f"load {k + 1} of {len(loads)}"))

                    reached = go(load, report, at_s=at)
                    if isinstance(reached, Stuck):
                        name = f"{load:g} N" if by_force else f"{1e3 * load:g} mm"
                        status, message = reached.reason, self._stuck(reached, name)
                        break
                    curve.append(reached)
                    self._store(writer, curve, at, started)
                    if k == first:
                        warn_of_long_run((time.perf_counter() - paced) * (len(loads) - first), f"{len(loads)} loads")
                    progress("load-step", counted(k + 1, len(loads), "load"))
            except stopping.Stopped as stopped:
                if not curve:
                    raise
                status = INTERRUPTED
                message = f"{stopped} after load {len(curve) - 1} of {len(loads)}; {how_to_resume(writer.place(status))}"
            summary = self._summary(writer.place(status), status, message, curve, compile_s, time.perf_counter() - started)
            summary["total_s"] = self.prepare_s + time.perf_counter() - begin
            writer.finish(status, message, summary)
        return summary

    def check(self, progress: Progress) -> IndentationCheckReport:
        """How long an indentation will take, from a few iterations and from what loads have taken so far."""
        body, scenario = self.body, self.scenario
        mesh_report = self._mesh_report()
        make_ready(body, progress, kernels_of(self.name, self.model.element, self.scenario.effects))
        loads = len(scenario.analysis.course)
        iterations = loads * ITERATIONS_PER_LOAD
        return {
            **self.describe(),
            **mesh_report,
            "loads": loads,
            "contact_points": len(body.contact.points.spring),
            "predicted_iterations": iterations,
            "predicted_wall_s": iterations * self._seconds_per_step(),
            "kernel_memory_MB": self._kernel_memory_MB(),
            "result_size_MB": self._result_bytes() / 1e6,
        }

    # ---- inside ----

    def _result_bytes(self) -> float:
        """Size of the fields in the result."""
        mesh, fields = self.model.mesh, {"J", "hourglass_energy", "strain_energy_density"} & set(self.scenario.record.fields)
        samples = len(self.scenario.analysis.course) + 1
        wanted = self.scenario.record.fields
        per_node, per_element = 3 + numbers_per(wanted, "point"), len(fields) + numbers_per(wanted, "cell")
        return float(samples * 8 * (per_node * mesh.node_count + per_element * mesh.element_count))

    def _writer(self, target: Path | ResultInMemory, overwrite: bool, expected: int) -> ResultWriter | ResultInMemory:
        wanted = self.scenario.record.fields
        declared = Declaration(
            mesh=self.model.mesh,
            point_fields=stress_quantities(wanted, "point"),
            cell_fields={name: one for name, one in INDENTATION_FIELDS.items() if name in wanted}
            | stress_quantities(wanted, "cell"),
            history=INDENTATION_HISTORY,
        )
        if isinstance(target, ResultInMemory):
            return target.begin(declared, self.describe())
        return ResultWriter(
            target,
            declared,
            Origin(self.text, self._stored_model(), provenance()),
            restart=self.body.restart_state() | restart_extras(0, 0.0),
            expected_samples=expected,
            overwrite=overwrite,
        )

    def _store(self, writer: ResultWriter | ResultInMemory, curve: list[Equilibrium], time_s: float, started: float) -> None:
        """Store the last equilibrium, and the state to go on from."""
        row = {column: getattr(curve[-1], name) for name, column in EQUILIBRIUM_COLUMNS.items()}
        row["external_work"] = external_work(curve).work_J
        fields = self.body.element_fields()
        cells: dict[str, np.ndarray] = {name: fields[name] for name in INDENTATION_FIELDS if name in self.scenario.record.fields}
        wanted, u = self.scenario.record.fields, self.body.displacement
        stress = self.body.element_stress() if needs_stress(wanted) else np.zeros((0, 6))
        more_points, more_cells = stress_fields(self.model.mesh, wanted, u, stress)
        writer.sample(time_s, row, {"displacement": u} | more_points, cells | more_cells)
        writer.restart(self.body.restart_state() | restart_extras(len(curve), time.perf_counter() - started))

    def _stuck(self, stuck: Stuck, load: str) -> str:
        """Why a load was not reached, where, and what to do."""
        x, y, z = 1e3 * stuck.place_m
        place = f"near ({x:.1f}, {y:.1f}, {z:.1f}) mm"
        by_force = self.scenario.analysis.forces_N is not None
        reached = f"{stuck.reached:.4g} N" if by_force else f"{1e3 * stuck.reached:.4g} mm"
        advice = (
            "The tissue may be too soft for this load, or the elements at the edge of the tool too large: reduce the load, "
            "increase edge_radius_mm or reduce edge_size_mm."
        )
        if stuck.reason == "inverted":
            why = f"an element {place} is inverted"
        elif by_force and abs(stuck.force_N - stuck.goal) > MISSED_SHARE_OF_LOAD * abs(stuck.goal):
            force, goal = distinct(stuck.force_N, stuck.goal)
            why = f"the contact force is {force} N instead of {goal} N"
            advice = (
                "The displacement under such a load is below the rounding error of so stiff a body: check the units of the "
                "material and the load, and increase the load or soften the material."
            )
        elif stuck.residual <= self.body.tolerance:
            why = f"the kinetic energy does not decay, although the relative residual is only {stuck.residual:.2g}"
            advice = f"The slowest mode converges too slowly. {ADVICE_ON_STIFFNESS}"
        else:
            why = f"the nodal forces do not converge (relative residual {stuck.residual:.2g}, largest {place})"
            advice = f"{advice} {ADVICE_ON_STIFFNESS}"
        return f"{load} was not reached: {why}. The last converged load is {reached}. {advice}"

    def _summary(
        self, target: Path, state: str, message: str, curve: list[Equilibrium], compile_s: float, wall_s: float
    ) -> IndentationSummary:
        mesh = self.model.mesh
        loaded = curve[1:]
        elastic = [point.internal_J + point.hourglass_J for point in curve]
        shares = [point.hourglass_J / e for point, e in zip(curve, elastic, strict=True) if e > 0.0]
        folded = self._folded(self.body.displacement)
        # a load that has all but gone is no measure
        least_N = LEAST_SHARE_OF_LARGEST_LOAD * max((point.force_N for point in loaded), default=0.0)
        pressed = [point for point in loaded if point.displacement_m > 0.0 and point.force_N > least_N]
        balance = balance_of(curve)
        return {
            "status": state,
            "message": message,
            "warnings": self._warnings(curve, max(shares, default=0.0), folded),
            "result": str(target),
            "title": self.scenario.title,
            "nodes": mesh.node_count,
            "hexes": mesh.element_count,
            "copies": self.model.copies,
            "curve": [{"force_N": point.force_N, "displacement_mm": 1e3 * point.displacement_m} for point in loaded],
            "loads": [
                {key: value for key, value in asdict(point).items() if key not in ("force_N", "displacement_m")}
                for point in loaded
            ],
            "tolerance": self.body.tolerance,
            "iterations": self.body.iterations,
            "threads": len(self.body.parts),
            "wall_s": wall_s,
            "compile_s": compile_s,
            "touch_mm": 1e3 * self.body.touch_m,
            "penetration_ratio": max((point.penetration_m / point.displacement_m for point in pressed), default=0.0),
            "reaction_error": max((abs(point.reaction_N / point.force_N - 1.0) for point in pressed), default=0.0),
            "energy_balance_error": balance.error if curve else None,
            "energy_balance_doubt": balance.doubt if curve else None,
            "hourglass_share": max(shares, default=0.0),
            "hourglass_share_end": shares[-1] if shares else 0.0,
            "min_J": min((point.smallest_J for point in curve), default=1.0),
            "folded": folded,
        }

    def _warnings(self, curve: list[Equilibrium], hourglass: float, folded: FoldedElements) -> list[str]:
        """Warnings on the quality of the result."""
        warnings = [*self.notes]
        if hourglass > HOURGLASS_WARNING_SHARE:
            warnings.append(
                f"hourglass energy reaches {100 * hourglass:.0f} % of the elastic energy: the mesh is coarse for this "
                "deformation; compare with model.refinement = 2."
            )
        most = max((point.folded for point in curve), default=0)
        if folded["elements"] or most:
            when = "at the end" if folded["elements"] else "at one of the loads, but none at the end"
            warnings.append(
                f"{folded['elements'] or most} of {self.model.mesh.element_count} elements are inverted {when}. One-point "
                'integration does not prevent this; set model.refinement = 2 or element = "hex8-full" and compare.'
            )
        depth = max((point.displacement_m for point in curve), default=0.0)
        thickness = 1e-3 * self.scenario.model.thickness_mm
        if depth > DEPTH_WARNING_SHARE * thickness:
            warnings.append(
                f"the indentation of {1e3 * depth:.1f} mm is large for a thickness of {1e3 * thickness:.1f} mm: the result "
                "depends on the thickness and the support of the specimen."
            )
        if self.scenario.tool.shape == "sphere" and depth > 1e-3 * self.scenario.tool.outer_radius_mm:
            warnings.append("the indentation exceeds the radius of the ball; the shaft of a real tool is not modelled.")
        ratio = max((p.penetration_m / p.displacement_m for p in curve if p.displacement_m > 0.0), default=0.0)
        if ratio > PENETRATION_SHARE and self.scenario.tool.shape != "bonded-disc":
            warnings.append(f"the surface penetrates the tool by up to {100 * ratio:.2f} % of the indentation.")
        # where the answer depends on the path, a force need not rise all along
        by_path = self.scenario.tool.friction != 0.0 or any(effect.depends_on_path for effect in self.scenario.effects.chosen)
        return [*warnings, *equilibrium_notes(curve, elastic=not by_path)]


def _equilibria(rows: Mapping[str, np.ndarray]) -> list[Equilibrium]:
    """The loads of a history."""
    columns = {name: rows[column].tolist() for name, column in EQUILIBRIUM_COLUMNS.items()}
    curve = [Equilibrium(**dict(zip(columns, numbers, strict=True))) for numbers in zip(*columns.values(), strict=True)]
    return [replace(point, iterations=int(point.iterations), folded=int(point.folded)) for point in curve]
