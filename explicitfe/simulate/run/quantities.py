"""What a run in time stores: the fields of every sample and the columns of the history, each with its unit and its meaning."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from explicitfe.fem.model.holders import Holder
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.observe import Recording
from explicitfe.platform.compiled.arrays import (
    BARRIER,
    BONE_AREA,
    BONE_DEPTH,
    BONE_FORCE,
    DAMPED,
    EXTERNAL,
    HOURGLASS,
    IN_CONTACT,
    IN_TIES,
    INTERNAL,
    KINETIC,
    LOST,
    RUBBED,
)
from explicitfe.results.files import Quantity
from explicitfe.simulate.run.stress_fields import stress_fields, stress_quantities

# Column of the history -> entry of the energies of a sample.
ENERGY_COLUMNS = {
    "internal_energy": INTERNAL,
    "hourglass_energy": HOURGLASS,
    "barrier_energy": BARRIER,
    "kinetic_energy": KINETIC,
    "external_work": EXTERNAL,
    "damping_loss": DAMPED,
    "material_loss": LOST,
    "contact_energy": IN_CONTACT,
    "contact_loss": RUBBED,
    "tied_energy": IN_TIES,
}
# Columns of the history that every run in time has.
_HISTORY = {
    "step": Quantity("1", 1, "steps done"),
    "dt": Quantity("s", 1, "time step"),
    "internal_energy": Quantity("J", 1, "strain energy of the law, without hourglass energy"),
    "hourglass_energy": Quantity("J", 1, "energy of hourglass control"),
    "barrier_energy": Quantity("J", 1, "energy of the barrier against folding"),
    "kinetic_energy": Quantity("J", 1, "1/2 v(-).M v(+) of the half steps before and after"),
    "external_work": Quantity("J", 1, "work of muscles, loads and gravity"),
    "damping_loss": Quantity("J", 1, "energy lost to mass-proportional damping"),
    "material_loss": Quantity("J", 1, "energy lost in the material: work of its stress, less what is stored"),
    "contact_energy": Quantity("J", 1, "stored in the contact with bones"),
    "contact_loss": Quantity("J", 1, "energy lost in the contact with bones: its dampers, and friction"),
    "tied_energy": Quantity("J", 1, "stored in the ties to bones, and in the springs that hold these"),
    "balance_error": Quantity("1", 1, "largest energy balance error so far, relative"),
    "smallest_J": Quantity("1", 1, "smallest J of all elements in all steps so far"),
}

SURFACE_PRESSURE = "surface_pressure"
_CELL_FIELDS = {
    "J": Quantity("1", 1, "volume over reference volume, det F"),
    "hourglass_energy": Quantity("J", 1, "hourglass energy of the element"),
}


def point_fields(wanted: Collection[str], model: Model) -> dict[str, Quantity]:
    """Fields of nodes beside the displacement: those of ``record.fields`` that are wanted, and pressures."""
    fields = {"velocity": Quantity("m/s", 3, "velocity of the nodes")} if "velocity" in wanted else {}
    for bone in model.bones:
        fields[f"contact_pressure_{bone.name}"] = Quantity("Pa", 1, f"pressure of {bone.name} on the surface")
    if model.surfaces is not None:
        fields[SURFACE_PRESSURE] = Quantity("Pa", 1, "pressure of surfaces on each other")
    return fields | stress_quantities(wanted, "point")


def cell_fields(wanted: Collection[str]) -> dict[str, Quantity]:
    """Fields of elements, those of ``record.fields`` that are wanted."""
    return {name: quantity for name, quantity in _CELL_FIELDS.items() if name in wanted} | stress_quantities(wanted, "cell")


def pairs_of(bodies: Sequence[str]) -> list[tuple[int, int, str]]:
    """Numbers and column of the history of each pair of bodies in contact, a body with itself included."""
    numbers = [(a, b) for a in range(len(bodies)) for b in range(a, len(bodies))]
    return [(a, b, f"contact_{bodies[a]}_{bodies[b]}_depth") for a, b in numbers]


def history_columns(model: Model, bodies: Sequence[str], holders: Iterable[Holder]) -> dict[str, Quantity]:
    """Columns of the history: energies, reactions, probes, contact with bones and of bodies, and where bones are that move."""
    columns = dict(_HISTORY)
    columns["applied_force"] = Quantity("N", 3, "sum of all loads on the body: forces, weight, pull of strings, drag")
    for holder in holders:
        columns[f"reaction_{holder.name}_force"] = Quantity("N", 3, f"force of {holder.name}, which holds the body, on it")
        columns[f"reaction_{holder.name}_displacement"] = Quantity("m", 3, f"displacement of {holder.name}, which holds the body")
    for a, b, name in pairs_of(bodies):
        columns[name] = Quantity("m", 1, f"deepest point of a surface of {bodies[a]} and {bodies[b]} in the other one")
    for name in model.probes:
        columns[f"probe_{name}_displacement"] = Quantity("m", 3, f"displacement of {name}")
        columns[f"probe_{name}_velocity"] = Quantity("m/s", 3, f"velocity of {name}")
    for bone, motion in ((bone.name, bone.motion) for bone in model.bones):
        columns[f"contact_{bone}_force"] = Quantity("N", 3, f"force of {bone} on the body")
        columns[f"contact_{bone}_depth"] = Quantity("m", 1, f"deepest point of the surface in {bone}, beyond its depth at rest")
        columns[f"contact_{bone}_area"] = Quantity("m^2", 1, f"area of the surface that {bone} touches")
        if motion is not None:
            placed = f"where {bone} is: rotation R by rows, and shift s [m]; a point X of it at rest is at R X + s"
            columns[f"bone_{bone}_placement"] = Quantity("1", 12, placed)
    return columns


def history_rows(recording: Recording, count: int, bodies: Sequence[str]) -> dict[str, np.ndarray]:
    """Those columns of the first ``count`` samples of a recording, but for ``balance_error``."""
    model, some, samples = recording.model, slice(0, count), recording.arrays
    times_s, displacement, velocity = recording.time_s[some], samples.displacement[some], samples.velocity[some]
    rows: dict[str, np.ndarray] = {
        "step": recording.steps[some],
        "dt": recording.dt_s[some],
        **{name: samples.energies[some, entry] for name, entry in ENERGY_COLUMNS.items()},
        "smallest_J": samples.smallest_J[some],
        "applied_force": samples.reaction[some, -1],
    }
    for number, holder in enumerate(recording.holders):
        rows[f"reaction_{holder.name}_force"] = samples.reaction[some, number]
        rows[f"reaction_{holder.name}_displacement"] = holder.displacement(times_s, displacement)
    for number, bone in enumerate(model.bones):
        rows[f"contact_{bone.name}_force"] = samples.contact[some, number, BONE_FORCE : BONE_FORCE + 3]
        rows[f"contact_{bone.name}_depth"] = samples.contact[some, number, BONE_DEPTH]
        rows[f"contact_{bone.name}_area"] = samples.contact[some, number, BONE_AREA]
        if bone.motion is not None:
            rotation, shift = bone.motion.placement(times_s)
            rows[f"bone_{bone.name}_placement"] = np.concatenate([rotation.reshape(count, 9), shift], axis=1)
    for a, b, column in pairs_of(bodies):
        rows[column] = samples.pairs[some, a, b]
    for name, point in model.probes.items():
        rows[f"probe_{name}_displacement"] = model.mesh.at(point, displacement.transpose(1, 0, 2))[0]
        rows[f"probe_{name}_velocity"] = model.mesh.at(point, velocity.transpose(1, 0, 2))[0]
    return rows


def fields_of(recording: Recording, count: int, wanted: Collection[str]) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Fields of nodes and of elements of the first ``count`` samples of a recording."""
    model, some, samples = recording.model, slice(0, count), recording.arrays
    points = {"displacement": samples.displacement[some]}
    if "velocity" in wanted:
        points["velocity"] = samples.velocity[some]
    for number, bone in enumerate(model.bones):
        points[f"contact_pressure_{bone.name}"] = samples.pressure[some, number]
    if model.surfaces is not None:
        points[SURFACE_PRESSURE] = samples.pressed[some]
    cells = {"J": samples.J[some], "hourglass_energy": samples.hourglass[some]}
    more_points, more_cells = stress_fields(model.mesh, wanted, samples.displacement[some], samples.stress[some])
    return points | more_points, {name: value for name, value in cells.items() if name in wanted} | more_cells
