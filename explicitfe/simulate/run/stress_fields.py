"""Fields of stress and strain that a result stores on request, of every analysis."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from explicitfe.fem.elements.stress_measures import (
    at_nodes,
    deformation_gradients,
    green_lagrange,
    pressure,
    principal_stretches,
    von_mises,
)
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.results.files import Quantity

_COMPONENTS = "xx, yy, zz, xy, yz, xz"
# Name in record.fields -> kind, and the fields that it stores.
_FIELDS: dict[str, tuple[str, dict[str, Quantity]]] = {
    "stress": ("cell", {"stress": Quantity("Pa", 6, f"mean Cauchy stress of the element: {_COMPONENTS}")}),
    "von_mises": ("cell", {"von_mises": Quantity("Pa", 1, "von Mises stress of the mean stress of the element")}),
    "pressure": ("cell", {"pressure": Quantity("Pa", 1, "pressure in the element, minus a third of the trace of the stress")}),
    "strain": ("cell", {"strain": Quantity("1", 6, f"Green-Lagrange strain of the element, tensor components: {_COMPONENTS}")}),
    "stretches": (
        "cell",
        {f"stretch_{k}": Quantity("1", 1, f"principal stretch {k} of the element, 1 is the largest") for k in (1, 2, 3)},
    ),
    "nodal_stress": (
        "point",
        {"nodal_stress": Quantity("Pa", 6, f"mean stress of the elements at a node: {_COMPONENTS}")},
    ),
    "nodal_von_mises": ("point", {"nodal_von_mises": Quantity("Pa", 1, "von Mises stress of nodal_stress")}),
    "nodal_pressure": ("point", {"nodal_pressure": Quantity("Pa", 1, "pressure of nodal_stress")}),
}
_OF_STRESS = {"stress", "von_mises", "pressure", "nodal_stress", "nodal_von_mises", "nodal_pressure"}


def needs_stress(wanted: Collection[str]) -> bool:
    """Whether fields of ``record.fields`` need the stress of the elements."""
    return not _OF_STRESS.isdisjoint(wanted)


def numbers_per(wanted: Collection[str], kind: str) -> int:
    """Numbers that those fields store for each node or element, "point" or "cell"."""
    return sum(quantity.components for quantity in stress_quantities(wanted, kind).values())


def stress_quantities(wanted: Collection[str], kind: str) -> dict[str, Quantity]:
    """The fields of stress and strain that are wanted, of a kind: "point" or "cell"."""
    return {name: one for key, (own, fields) in _FIELDS.items() if key in wanted and own == kind for name, one in fields.items()}


def stress_fields(
    mesh: HexMesh, wanted: Collection[str], displacement: np.ndarray, stress: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Values of those fields of nodes and of elements at displacements (..., n, 3) m and stresses (..., m, 6) Pa."""
    points: dict[str, np.ndarray] = {}
    cells: dict[str, np.ndarray] = {}
    if not {"nodal_stress", "nodal_von_mises", "nodal_pressure"}.isdisjoint(wanted):
        mean = at_nodes(mesh, stress)
        points = {"nodal_stress": mean, "nodal_von_mises": von_mises(mean), "nodal_pressure": pressure(mean)}
    if not {"stress", "von_mises", "pressure"}.isdisjoint(wanted):
        cells = {"stress": stress, "von_mises": von_mises(stress), "pressure": pressure(stress)}
    if not {"strain", "stretches"}.isdisjoint(wanted):
        F = deformation_gradients(mesh, displacement)
        cells["strain"] = green_lagrange(F)
        if "stretches" in wanted:
            stretches = principal_stretches(F)
            cells |= {f"stretch_{k}": stretches[..., k - 1] for k in (1, 2, 3)}
    declared = stress_quantities(wanted, "point") | stress_quantities(wanted, "cell")
    chosen = ({name: values for name, values in some.items() if name in declared} for some in (points, cells))
    return next(chosen), next(chosen)
