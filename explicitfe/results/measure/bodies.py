"""The bodies of a result: the tongue, and a velum that makes a vocal tract with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.triangles import corners_of, surface_triangles
from explicitfe.results.files import Recorded
from explicitfe.results.measure.tract import PALATE

VELUM = "velum"  # as scenarios call this body


def tongue_of(result: Recorded, step: int) -> tuple[HexMesh, np.ndarray]:
    """The body of ``[model]`` alone, and the displacement (n, 3) m of its nodes at a step.

    Its nodes and elements come before those of further bodies.
    """
    mesh, names = result.mesh, _further(result)
    if not names:
        return mesh, result.displacement(step)
    nodes = min(int(mesh.node_sets[name].min()) for name in names)
    own = HexMesh(
        mesh.points[:nodes],
        mesh.hexes[mesh.hexes[:, 0] < nodes],
        {name: members for name, members in mesh.node_sets.items() if members.max(initial=0) < nodes},
        {name: point for name, point in mesh.named_points.items() if name.partition(".")[0] not in names},
    )
    return own, result.displacement(step)[:nodes]


def roof_of(result: Recorded, step: int, palate: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Triangles (m, 3 corners, 3) m of the bone "palate", whose points and triangles are given, and of a velum at a step."""
    corners = corners_of(*palate)
    if VELUM not in _further(result):
        return corners
    mesh = result.mesh
    hexes = mesh.hexes[np.isin(mesh.hexes[:, 0], mesh.node_sets[VELUM])]
    velum, _ = surface_triangles(HexMesh(mesh.points, hexes, {}, {}), mesh.points + result.displacement(step))
    return np.concatenate([corners, velum])


def value_of_palate(result: Recorded, key: str) -> Any:
    """A value of the ``[[bone]]`` table of the palate in the scenario of a result; None if it is not given."""
    tables = result.model.get("scenario", {}).get("bone", [])
    return next((table.get(key) for table in tables if table.get("name") == PALATE), None)


def _further(result: Recorded) -> list[str]:
    return [table["name"] for table in result.model.get("scenario", {}).get("body", [])]
