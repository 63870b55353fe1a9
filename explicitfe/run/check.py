"""What is known of a scenario before it runs, and lists of what comes with the program."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.effects import EFFECTS
from explicitfe.errors import Progress
from explicitfe.mesh.quality import assess
from explicitfe.model import catalogue
from explicitfe.run.prepare import Prepared, describe, prepare
from explicitfe.scenario.indentation import IndentationScenario
from explicitfe.scenario.read import read_scenario
from explicitfe.solve.stable_step import FRACTION
from explicitfe.solve.transient import FIRST_TURNS

ITERATIONS = 3000  # that a load takes at a residual of 1e-4 and Poisson's ratio 0.499, as seen on the default specimen


def check(path: Path | str, settings: Sequence[str], progress: Progress) -> dict[str, Any]:
    """Validate, build and measure a scenario; nothing is run and nothing written.

    The wall time is predicted from the time that the element forces take now, on this machine.

    Raises
    ------
    InputError : what is wrong with it, in one sentence.
    """
    prepared = prepare(path, settings)
    quality = assess(prepared.model.mesh)
    progress("compile", 0.0)
    found = {
        **describe(prepared),
        "smallest_edge_mm": 1e3 * quality.smallest_edge_m,
        "largest_edge_mm": 1e3 * quality.largest_edge_m,
        "smallest_scaled_jacobian": quality.smallest_scaled_jacobian,
        "worst_element": quality.worst_element,
    }
    return found | (
        _indentation(prepared, progress) if isinstance(prepared.scenario, IndentationScenario) else _transient(prepared, progress)
    )


def _indentation(prepared: Prepared, progress: Progress) -> dict[str, Any]:
    """How long an indentation will take, from a few iterations and from what loads have taken so far."""
    body, scenario, mesh = prepared.relaxation, prepared.scenario, prepared.model.mesh
    body.compile(lambda share: progress("compile", share))
    loads = len(scenario.analysis.course)
    cells = len({"J", "hourglass_energy", "strain_energy_density"} & set(scenario.record.fields))
    iterations = loads * ITERATIONS
    return {
        "loads": loads,
        "contact_points": len(prepared.model.tool.areas_m2),
        "predicted_iterations": iterations,
        "predicted_wall_s": iterations * _seconds_per_step(body.internal_force, body.displacement),
        "kernel_memory_MB": sum(array.nbytes for array in [*body.blocks, *body.nodes, *body.state]) / 1e6,
        "result_size_MB": (loads + 1) * 8 * (3 * mesh.node_count + cells * mesh.element_count) / 1e6,
    }


def _transient(prepared: Prepared, progress: Progress) -> dict[str, Any]:
    simulation, scenario = prepared.simulation, prepared.scenario
    simulation.compile(lambda share: progress("compile", share))
    bound_s, element = simulation.stable_bound()
    limit_s = simulation.stable_limit(FIRST_TURNS)
    fixed = scenario.analysis.step_us
    dt_s = FRACTION * limit_s if fixed is None else 1e-6 * fixed
    steps = int(np.ceil(1e-3 * scenario.analysis.duration_ms / dt_s))
    samples = int(scenario.analysis.duration_ms / scenario.record.every_ms) + 1
    per_node = 8 * 3 * (1 + ("velocity" in scenario.record.fields))
    per_element = 8 * len({"J", "hourglass_energy"} & set(scenario.record.fields))
    mesh = prepared.model.mesh
    arrays = [*simulation.blocks, *simulation.nodes, *simulation.state]
    return {
        "stable_step_us": 1e6 * limit_s,
        "stable_step_bound_us": 1e6 * bound_s,
        "limiting_element": element,
        "step_us": 1e6 * dt_s,
        "stable": bool(dt_s <= limit_s),
        "predicted_steps": steps,
        "predicted_wall_s": steps * _seconds_per_step(simulation.internal_force, simulation.displacement),
        "kernel_memory_MB": sum(array.nbytes for array in arrays) / 1e6,
        "result_size_MB": samples * (per_node * mesh.node_count + per_element * mesh.element_count) / 1e6,
    }


def _seconds_per_step(force: Callable[[np.ndarray], np.ndarray], displacement: np.ndarray) -> float:
    """Best of a few force evaluations: they are most of a step."""
    best = np.inf
    for _ in range(5):
        begin = time.perf_counter()
        force(displacement)
        best = min(best, time.perf_counter() - begin)
    return best


def _models() -> list[dict[str, Any]]:
    rows = []
    for name in catalogue.model_folders():
        for resolution, cells in catalogue.contour(name).resolutions.items():
            rows.append({"model": name, "resolution": resolution, "cells": list(cells), "hexes": int(np.prod(cells))})
    rows.append({"model": "specimen", "resolution": "from the tool", "cells": [], "hexes": None})
    return rows


def _muscles() -> list[dict[str, Any]]:
    return [
        {
            "muscle": muscle.name,
            "name": muscle.title,
            "action": muscle.action,
            "fibres": len(muscle.fibres),
            "max_force_N": muscle.max_force_N,
            "model": model,
        }
        for model in catalogue.model_folders()
        for muscle in catalogue.built_in(model).muscles.values()
    ]


def _scenarios() -> list[dict[str, Any]]:
    rows = []
    for path in catalogue.scenario_files():
        scenario, _ = read_scenario(path)
        rows.append({"scenario": path.name, "title": scenario.title, "question": scenario.question, "file": str(path)})
    return rows


def _materials() -> list[dict[str, Any]]:
    return [
        {
            "material": name,
            "law": law.law,
            "constants": {key: value for key, value in law.model_dump().items() if key not in ("law", "source")},
            "source": law.source,
        }
        for name, law in catalogue.materials().items()
    ]


def _effects() -> list[dict[str, Any]]:
    return [
        {
            "effect": name,
            "title": kind.about.title,
            "where": kind.about.where,
            "keys": list(kind.model_fields),
            "needs": kind.about.needs,
            "source": kind.about.source,
        }
        for name, kind in EFFECTS.items()
    ]


LISTS: dict[str, Callable[[], list[dict[str, Any]]]] = {
    "models": _models,
    "muscles": _muscles,
    "scenarios": _scenarios,
    "materials": _materials,
    "effects": _effects,
}
