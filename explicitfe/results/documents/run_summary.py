"""What a run and a check say of themselves: the dictionaries that are stored in a result and printed with ``--json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NotRequired

import numpy as np
from pydantic import JsonValue
from typing_extensions import TypedDict

from explicitfe.fem.mesh.hexmesh import MaterialPoints
from explicitfe.results.documents.document import Computed


class ModelDescription(TypedDict):
    """A model in words and numbers; ``scenario`` is what was run with ``--set`` and all defaults, ready to be run again.

    A result also holds ``scenario_file``, where that stood; ``file_sums``, the SHA-256 of each file that the scenario names; and
    ``notes``, sentences on what was seen when it was built.
    """

    name: str
    nodes: int
    hexes: int
    volume_mm3: float
    mass_g: float
    element: str
    material: dict[str, JsonValue]
    fixed_nodes: int
    scenario: dict[str, JsonValue]
    scenario_file: NotRequired[str]
    file_sums: NotRequired[dict[str, str]]
    notes: NotRequired[list[str]]


class PointAtRest(TypedDict):
    """Where a point of the body is in the reference shape: x, y, z."""

    position_mm: list[float]


def point_at_rest(point: MaterialPoints) -> PointAtRest:
    """Where one point is in the reference shape."""
    return {"position_mm": (1e3 * point.position[0]).tolist()}


class SurgeryReport(TypedDict):
    """What surgery took, put in and stiffened; ``muscle_loss_percent``: of the work of a uniform contraction of each muscle."""

    removed_elements: int
    removed_mm3: float
    graft_elements: int
    graft_mm3: float
    scar_mm3: float
    muscle_loss_percent: dict[str, float]
    notes: list[str]


class TransientModelDescription(ModelDescription):
    """What else a model under muscles has; ``probes`` are points by name.

    ``surgery`` is None where nothing was cut, ``airway`` (see ``airway_table.py``) for a mesh of one's own.
    """

    alpha_per_s: float
    beta_s: float
    muscles: list[dict[str, JsonValue]]
    bones: list[str]
    held_area_mm2: dict[str, float]
    surgery: SurgeryReport | None
    airway: dict[str, JsonValue] | None
    probes: dict[str, PointAtRest]


class IndentationModelDescription(ModelDescription):
    """What else a specimen under a tool has; ``copies`` of what is computed make the whole."""

    copies: float
    tool: dict[str, JsonValue]


def kind_of(model: Mapping[str, Any]) -> str:
    """The kind of analysis that a stored model says of itself, "transient" or "relaxation"; the former where it says nothing."""
    return model.get("scenario", {}).get("analysis", {}).get("type", "transient")


class FoldedElements(TypedDict):
    """How many elements are folded for certain, and of how many it is not known; all others are certain not to be."""

    elements: int
    undecided: int


class RunSummary(TypedDict):
    """What any run came to. ``message`` says why a run ended early; ``plots`` are there where pictures were drawn."""

    status: str
    message: str
    warnings: list[str]
    result: str
    title: str
    nodes: int
    hexes: int
    threads: int
    wall_s: float
    compile_s: float
    total_s: NotRequired[float]
    energy_balance_error: Computed | None
    hourglass_share: Computed
    hourglass_share_end: Computed
    min_J: Computed
    folded: FoldedElements
    plots: NotRequired[list[str]]


class ProbeAtEnd(TypedDict):
    """Where a probe has gone at the end, along x, y, z and in the words of anatomy, and how fast it is."""

    displacement_mm: list[Computed]
    forward_mm: Computed
    up_mm: Computed
    right_mm: Computed
    speed_mm_s: Computed


class TransientSummary(RunSummary):
    """What a run in time came to."""

    simulated_s: float
    steps: int
    dt_s: Computed
    dt_fraction_of_limit: Computed
    limiting_element: int | None
    loop_s: float
    look_s: float
    sample_s: float
    real_time_factor: Computed
    settled: bool
    largest_displacement_mm: Computed
    largest_speed_mm_s: Computed
    probes: dict[str, ProbeAtEnd]


class CurvePoint(TypedDict):
    """A load that was reached."""

    force_N: float
    displacement_mm: float


class IndentationSummary(RunSummary):
    """What an indentation came to; ``loads`` holds the other numbers of each equilibrium, by their names in ``Equilibrium``.

    ``energy_balance_doubt``: by how much the error may be wrong, as the work is known from the loads alone.
    """

    copies: float
    curve: list[CurvePoint]
    loads: list[dict[str, Computed]]
    tolerance: float
    iterations: int
    touch_mm: float
    penetration_ratio: Computed
    reaction_error: Computed
    energy_balance_doubt: Computed | None


# Column of the history of an indentation -> what a summary calls it: together all of an ``Equilibrium``.
CURVE_COLUMNS = {"force": "force_N", "indentation": "displacement_m"}
LOAD_COLUMNS = {
    "iterations": "iterations",
    "residual": "residual",
    "kinetic_ratio": "kinetic_ratio",
    "base_reaction": "reaction_N",
    "penetration": "penetration_m",
    "contact_radius": "contact_radius_m",
    "internal_energy": "internal_J",
    "hourglass_energy": "hourglass_J",
    "contact_energy": "contact_J",
    "dead_work": "dead_work_J",
    "friction_loss": "friction_loss_J",
    "material_loss": "material_loss_J",
    "smallest_J": "smallest_J",
    "folded_elements": "folded",
}


def curve_of(history: Mapping[str, np.ndarray]) -> list[CurvePoint]:
    """``curve`` of a summary: the rows but the first, at which the tool touches."""
    pairs = zip(history["force"][1:].tolist(), history["indentation"][1:].tolist(), strict=True)
    return [{"force_N": force, "displacement_mm": 1e3 * way_m} for force, way_m in pairs]


def loads_of(history: Mapping[str, np.ndarray]) -> list[dict[str, float]]:
    """``loads`` of a summary."""
    columns = {key: history[column][1:].tolist() for column, key in LOAD_COLUMNS.items()}
    for counted in ("iterations", "folded"):
        columns[counted] = [int(count) for count in columns[counted]]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def probes_of(history: Mapping[str, np.ndarray]) -> dict[str, ProbeAtEnd]:
    """``probes`` of a summary: where they are in the last row, and how fast."""
    probes: dict[str, ProbeAtEnd] = {}
    for column, displacement in history.items():
        name = column.removeprefix("probe_").removesuffix("_displacement")
        if column == f"probe_{name}_displacement" and len(displacement):
            speed = np.linalg.norm(history[f"probe_{name}_velocity"][-1])
            back, right, up = (1e3 * displacement[-1] + 0.0).tolist()  # 0 for -0
            probes[name] = {
                "displacement_mm": [back, right, up],
                "forward_mm": 0.0 - back,
                "up_mm": up,
                "right_mm": right,
                "speed_mm_s": float(1e3 * speed),
            }
    return probes


# What a summary says of the history, which is not stored a second time: a curve may have any number of points.
FROM_HISTORY = {"curve": curve_of, "loads": loads_of, "probes": probes_of}


def without_history(summary: Mapping[str, object]) -> dict[str, object]:
    """A summary as it is stored: None for what the history says."""
    return {key: None if key in FROM_HISTORY else value for key, value in summary.items()}


def with_history(stored: Mapping[str, object], history: Mapping[str, np.ndarray]) -> dict[str, object]:
    """A summary as it was before :func:`without_history`."""
    return {key: FROM_HISTORY[key](history) if key in FROM_HISTORY and value is None else value for key, value in stored.items()}


class MeshReport(TypedDict):
    """What a mesh is like; ``warnings`` are sentences on what a user should know before a run."""

    smallest_edge_mm: float
    largest_edge_mm: float
    smallest_scaled_jacobian: float
    worst_element: int
    folded: FoldedElements
    warnings: list[str]


class SpeedRow(TypedDict):
    """Nanoseconds per element and step: of one thread, as documented for as many lanes, and of several threads."""

    elements: int
    element: str
    ns: float
    reference_ns: float | None
    threads: int | None
    ns_threads: float | None


class ScenarioSpeed(TypedDict):
    """The loop of a scenario against real time."""

    name: str
    hexes: int
    steps: int
    loop_s: float
    real_time_factor: float


class MachineCode(TypedDict):
    """What machine code was made for, and the seconds that it took: what ``explicitfe warmup --json`` prints."""

    seconds: dict[str, float]


class SpeedReport(TypedDict):
    """How fast this machine is: what ``explicitfe bench --json`` prints.

    ``load``: processes that wanted to compute in the minute before, on average; None where the system does not say.
    """

    lanes: int
    cores: int
    load: float | None
    rows: list[SpeedRow]
    scenario: ScenarioSpeed


class CheckReport(ModelDescription, MeshReport):
    """What is known of any scenario before it runs."""

    predicted_wall_s: float
    kernel_memory_MB: float
    result_size_MB: float


class TransientCheckReport(CheckReport, TransientModelDescription):
    """What is known of a run in time before it runs."""

    stable_step_us: float
    stable_step_bound_us: float
    limiting_element: int
    step_us: float
    stable: bool
    predicted_steps: int


class IndentationCheckReport(CheckReport, IndentationModelDescription):
    """What is known of an indentation before it runs."""

    loads: int
    contact_points: int
    predicted_iterations: int
