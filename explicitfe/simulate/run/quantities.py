"""What a run in time stores: the fields of every sample and the columns of the history, each with its unit and its meaning."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from explicitfe.results.files import Quantity

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


def point_fields(wanted: Collection[str], bones: Iterable[str], *, surfaces: bool = False) -> dict[str, Quantity]:
    """Fields of nodes beside the displacement: those of ``record.fields`` that are wanted, and pressures.

    Parameters
    ----------
    bones : those that press on the surface.
    surfaces : whether surfaces press on each other.
    """
    fields = {"velocity": Quantity("m/s", 3, "velocity of the nodes")} if "velocity" in wanted else {}
    fields |= {f"contact_pressure_{bone}": Quantity("Pa", 1, f"pressure of {bone} on the surface") for bone in bones}
    return fields | ({SURFACE_PRESSURE: Quantity("Pa", 1, "pressure of surfaces on each other")} if surfaces else {})


def cell_fields(wanted: Collection[str]) -> dict[str, Quantity]:
    """Fields of elements, those of ``record.fields`` that are wanted."""
    return {name: quantity for name, quantity in _CELL_FIELDS.items() if name in wanted}


def pairs_of(bodies: Sequence[str]) -> list[tuple[int, int, str]]:
    """Numbers and column of the history of each pair of bodies in contact, a body with itself included."""
    numbers = [(a, b) for a in range(len(bodies)) for b in range(a, len(bodies))]
    return [(a, b, f"contact_{bodies[a]}_{bodies[b]}_depth") for a, b in numbers]


def history_columns(
    probes: Iterable[str], bones: Iterable[str], moving: Collection[str], bodies: Sequence[str] = ()
) -> dict[str, Quantity]:
    """Columns of the history: energies, probes, contact with each bone and of bodies, and where those bones are that move."""
    columns = dict(_HISTORY)
    for a, b, name in pairs_of(bodies):
        columns[name] = Quantity("m", 1, f"deepest point of a surface of {bodies[a]} and {bodies[b]} in the other one")
    for name in probes:
        columns[f"probe_{name}_displacement"] = Quantity("m", 3, f"displacement of {name}")
        columns[f"probe_{name}_velocity"] = Quantity("m/s", 3, f"velocity of {name}")
    for bone in bones:
        columns[f"contact_{bone}_force"] = Quantity("N", 3, f"force of {bone} on the body")
        columns[f"contact_{bone}_depth"] = Quantity("m", 1, f"deepest point of the surface in {bone}, beyond its depth at rest")
        columns[f"contact_{bone}_area"] = Quantity("m^2", 1, f"area of the surface that {bone} touches")
        if bone in moving:
            placed = f"where {bone} is: rotation R by rows, and shift s [m]; a point X of it at rest is at R X + s"
            columns[f"bone_{bone}_placement"] = Quantity("1", 12, placed)
    return columns
