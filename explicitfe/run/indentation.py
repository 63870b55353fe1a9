"""One indentation from scenario to result file: load after load to equilibrium, recorded and summed up."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from explicitfe.errors import InputError, Progress
from explicitfe.mesh.quality import corner_jacobians
from explicitfe.results import Quantity, ResultWriter, provenance
from explicitfe.run.prepare import Prepared, describe
from explicitfe.scenario.indentation import IndentationScenario
from explicitfe.solve.contact_points import PENETRATION_SHARE
from explicitfe.solve.equilibrium import Equilibrium, Stuck

FINISHED, INTERRUPTED = "finished", "interrupted"
HOURGLASS_WARNING = 0.05
DEEP = 0.4  # of the thickness: an indentation that deserves a warning

HISTORY = {
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
    "external_work": Quantity("J", 1, "work of the tool, by a spline through the loads, and of gravity since first touch"),
    "friction_loss": Quantity("J", 1, "energy lost to friction"),
    "material_loss": Quantity("J", 1, "energy lost in the material: work of its stress, less what is stored"),
    "smallest_J": Quantity("1", 1, "smallest J of any element"),
}
CELLS = {
    "J": Quantity("1", 1, "volume over reference volume, det F"),
    "strain_energy_density": Quantity("Pa", 1, "strain energy over reference volume, with that of hourglass control"),
    "hourglass_energy": Quantity("J", 1, "hourglass energy of the element"),
}


def run_indentation(prepared: Prepared, target: Path, overwrite: bool, progress: Progress, begin: float) -> dict[str, Any]:
    """Run an indentation to its end and store its result; ``begin`` is when the whole run began.

    Returns
    -------
    The summary: what ``explicitfe run --json`` prints. Where a load is not reached, ``status`` and ``message`` say why, and
    ``curve`` ends with the last load that converged.

    Raises
    ------
    InputError : nothing was run and nothing written.
    """
    scenario, body = prepared.scenario, prepared.relaxation
    assert isinstance(scenario, IndentationScenario)
    analysis = scenario.analysis
    by_force = analysis.forces_N is not None
    loads = [load if by_force else 1e-3 * load for load in analysis.course]
    times = analysis.times_s or [float(k) for k in range(1, len(loads) + 1)]

    with _writer(prepared, target, overwrite, len(loads) + 1) as writer:
        compile_s = body.compile(lambda share: progress("compile", share))
        started = time.perf_counter()
        progress("run", 0.0)
        curve: list[Equilibrium] = []
        state, message = FINISHED, ""
        try:
            found = body.settle()
            if isinstance(found, Stuck):
                raise InputError(_stuck(prepared, found, "gravity alone"))
            curve.append(found)
            _store(writer, prepared, curve, 0.0)
            for k, (load, at) in enumerate(zip(loads, times, strict=True)):
                go = body.press if by_force else body.move
                found = go(load, lambda share, k=k: progress("run", (k + share) / len(loads)), at_s=at)
                if isinstance(found, Stuck):
                    name = f"{load:g} N" if by_force else f"{1e3 * load:g} mm"
                    state, message = found.reason, _stuck(prepared, found, name)
                    break
                curve.append(found)
                _store(writer, prepared, curve, at)
                progress("run", (k + 1) / len(loads))
        except KeyboardInterrupt:
            state, message = (
                INTERRUPTED,
                f"stopped by hand after load {len(curve) - 1} of {len(loads)}; what is stored is complete.",
            )
        summary = _summary(prepared, target, state, message, curve, compile_s, time.perf_counter() - started)
        summary["total_s"] = time.perf_counter() - begin
        writer.finish(state, message, summary)
    return summary


def _writer(prepared: Prepared, target: Path, overwrite: bool, samples: int) -> ResultWriter:
    wanted = prepared.scenario.record.fields
    return ResultWriter(
        target,
        mesh=prepared.model.mesh,
        cell_fields={name: quantity for name, quantity in CELLS.items() if name in wanted},
        history=HISTORY,
        scenario_text=prepared.text,
        model=describe(prepared),
        provenance=provenance(),
        expected_samples=samples,
        overwrite=overwrite,
    )


def _store(writer: ResultWriter, prepared: Prepared, curve: list[Equilibrium], time_s: float) -> None:
    last = curve[-1]
    row = {
        "force": last.force_N,
        "indentation": last.displacement_m,
        "iterations": last.iterations,
        "residual": last.residual,
        "kinetic_ratio": last.kinetic_ratio,
        "base_reaction": last.reaction_N,
        "penetration": last.penetration_m,
        "contact_radius": last.contact_radius_m,
        "internal_energy": last.internal_J,
        "hourglass_energy": last.hourglass_J,
        "contact_energy": last.contact_J,
        "external_work": external_work(curve),
        "friction_loss": last.friction_loss_J,
        "material_loss": last.material_loss_J,
        "smallest_J": last.smallest_J,
    }
    writer.history(time_s, row)
    fields = prepared.relaxation.element_fields()
    cells = {name: fields[name] for name in CELLS if name in prepared.scenario.record.fields}
    writer.sample(time_s, {"displacement": prepared.relaxation.displacement}, cells)


def external_work(curve: list[Equilibrium]) -> float:
    """Work of tool and dead loads since the first equilibrium [J]: the force along each way in one direction, by a spline."""
    force = np.array([point.force_N for point in curve])
    way = np.array([point.displacement_m for point in curve])
    work = curve[-1].dead_work_J - curve[0].dead_work_J
    keep = np.append(True, np.diff(way) != 0.0)
    force, way = force[keep], way[keep]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(way)))) + 1
    for start, stop in zip([0, *turns], [*turns, len(way) - 1], strict=True):
        f, d = force[start : stop + 1], way[start : stop + 1]
        if len(d) > 2:
            order = np.argsort(d)
            area = CubicSpline(d[order], f[order]).integrate(d[order][0], d[order][-1])
            work += float(area) if d[-1] > d[0] else -float(area)
        elif len(d) == 2:
            work += 0.5 * float((f[0] + f[1]) * (d[1] - d[0]))
    return work


def balance_error(curve: list[Equilibrium]) -> float:
    """Energy that is missing or too much, relative to the largest of stored energy and work."""
    first, last = curve[0], curve[-1]
    stored = sum(
        getattr(last, name) - getattr(first, name)
        for name in ("internal_J", "hourglass_J", "contact_J", "friction_loss_J", "material_loss_J")
    )
    largest = max(max(point.internal_J for point in curve), abs(external_work(curve)))
    return abs(stored - external_work(curve)) / largest if largest > 0.0 else 0.0


def _stuck(prepared: Prepared, stuck: Stuck, load: str) -> str:
    """What stopped the run, where, and what to do, in one sentence."""
    x, y, z = 1e3 * stuck.place_m
    place = f"near ({x:.1f}, {y:.1f}, {z:.1f}) mm"
    by_force = prepared.scenario.analysis.forces_N is not None
    reached = f"{stuck.reached:.4g} N" if by_force else f"{1e3 * stuck.reached:.4g} mm"
    if stuck.reason == "inverted":
        why = f"an element {place} turns inside out"
    else:
        why = f"the forces do not settle (relative residual {stuck.residual:.2g}, largest {place})"
    return (
        f"{load} was not reached: {why}; {reached} is as far as it went. The tissue may be too soft for this load, "
        "or the elements at the tool's edge too large: lower the load, or give a larger edge_radius_mm or a smaller edge_size_mm."
    )


def _summary(
    prepared: Prepared, target: Path, state: str, message: str, curve: list[Equilibrium], compile_s: float, wall_s: float
) -> dict[str, Any]:
    mesh = prepared.model.mesh
    loaded = curve[1:]
    elastic = [point.internal_J + point.hourglass_J for point in curve]
    shares = [point.hourglass_J / e for point, e in zip(curve, elastic, strict=True) if e > 0.0]
    pressed = [point for point in loaded if point.displacement_m > 0.0 and point.force_N > 0.0]
    return {
        "status": state,
        "message": message,
        "warnings": _warnings(prepared, curve, max(shares, default=0.0)),
        "result": str(target),
        "title": prepared.scenario.title,
        "nodes": mesh.node_count,
        "hexes": mesh.element_count,
        "copies": prepared.model.copies,
        "curve": [{"force_N": point.force_N, "displacement_mm": 1e3 * point.displacement_m} for point in loaded],
        "loads": [
            {key: value for key, value in asdict(point).items() if key not in ("force_N", "displacement_m")} for point in loaded
        ],
        "tolerance": prepared.relaxation.tolerance,
        "iterations": prepared.relaxation.iterations,
        "threads": len(prepared.relaxation.parts),
        "wall_s": wall_s,
        "compile_s": compile_s,
        "touch_mm": 1e3 * prepared.relaxation.touch_m,
        "penetration_ratio": max((point.penetration_m / point.displacement_m for point in pressed), default=0.0),
        "reaction_error": max((abs(point.reaction_N / point.force_N - 1.0) for point in pressed), default=0.0),
        "energy_balance_error": balance_error(curve) if curve else None,
        "hourglass_share": max(shares, default=0.0),
        "hourglass_share_end": shares[-1] if shares else 0.0,
        "min_J": min((point.smallest_J for point in curve), default=1.0),
    }


def _warnings(prepared: Prepared, curve: list[Equilibrium], hourglass: float) -> list[str]:
    """What a user should know before believing the result."""
    mesh, body = prepared.model.mesh, prepared.relaxation
    found = [*prepared.notes]
    if hourglass > HOURGLASS_WARNING:
        found.append(
            f"hourglass energy reaches {100 * hourglass:.0f} % of the elastic energy: the mesh is coarse for this deformation; "
            "compare with model.refinement = 2 before quoting numbers."
        )
    # Corners on a sector's axis have no volume to begin with.
    reference = corner_jacobians(mesh.points, mesh.hexes)
    there = reference > 1e-6 * reference.max()
    folded = int(np.sum(np.any((corner_jacobians(mesh.points + body.displacement, mesh.hexes) <= 0.0) & there, axis=1)))
    if folded:
        found.append(
            f"{folded} of {mesh.element_count} elements are folded at a corner at the end, which one integration point does not "
            'resist: compare with model.refinement = 2 and with element = "hex8-full".'
        )
    depth = max((point.displacement_m for point in curve), default=0.0)
    thickness = 1e-3 * prepared.scenario.model.thickness_mm
    if depth > DEEP * thickness:
        found.append(
            f"the tool goes {1e3 * depth:.1f} mm into {1e3 * thickness:.1f} mm of tissue: its height and base decide the answer."
        )
    if prepared.scenario.tool.shape == "sphere" and depth > 1e-3 * prepared.scenario.tool.radius_mm:
        found.append("the ball has sunk in by more than its radius: a real one has a shaft, which is not modelled.")
    ratio = max((p.penetration_m / p.displacement_m for p in curve if p.displacement_m > 0.0), default=0.0)
    if ratio > PENETRATION_SHARE and prepared.scenario.tool.shape != "bonded-disc":
        found.append(f"the surface is up to {100 * ratio:.2f} % of the indentation inside the tool.")
    return found
