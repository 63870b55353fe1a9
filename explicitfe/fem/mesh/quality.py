"""Validity of a mesh, and quality of its elements.

The Jacobian at a corner of a hex is the determinant of the three edges that leave it, in the order of the natural axes:
the volume of the parallelepiped that they span. The scaled Jacobian is the same with the edges normalised: 1 for a
brick, 0 for a flat corner, negative for an inverted one (Knupp 2000, Int. J. Numer. Meth. Engng 48:1165-1185).
A hexahedron can be inverted between its corners only; ``mesh/validity.py`` certifies that it is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.mesh.hexmesh import CORNERS, FACES, HexMesh, face_groups
from explicitfe.fem.mesh.validity import certify
from explicitfe.platform.errors import InputError

# The neighbours of each corner along xi, eta, zeta, and the sign of turning its edges towards growing xi, eta, zeta.
_CORNER_NEIGHBOURS = np.array([[1, 3, 4], [0, 2, 5], [3, 1, 6], [2, 0, 7], [5, 7, 0], [4, 6, 1], [7, 5, 2], [6, 4, 3]])
_CORNER_SIGNS = np.prod(-CORNERS, axis=1)

# The 12 edges of a hex as pairs of corners.
_CORNERS_OF_EDGES = np.array([(a, b) for a in range(8) for b in _CORNER_NEIGHBOURS[a] if a < b])

# A corner whose scaled Jacobian is below this counts as flat: far below any usable element, far above rounding.
_FLAT_SCALED_JACOBIAN = 1e-9

# So many elements are assessed together: their arrays fit into the processor's cache.
_BATCH_ELEMENTS = 4096

# Gauss points of the 2 x 2 x 2 rule, exact for the volume of a trilinear hex.
_GAUSS_POINTS = CORNERS / np.sqrt(3.0)


def _corner_edges(points: np.ndarray, hexes: np.ndarray) -> Iterator[tuple[slice, int, np.ndarray]]:
    """Part of the elements, corner, and the three edges (3 edges, 3, k) m that leave it in each; not turned.

    Part after part: a million elements then need megabytes, not half a gigabyte.
    """
    for first in range(0, len(hexes), _BATCH_ELEMENTS):
        part = slice(first, first + _BATCH_ELEMENTS)
        places = np.ascontiguousarray(points[hexes[part]].transpose(1, 2, 0))
        for corner in range(8):
            yield part, corner, places[_CORNER_NEIGHBOURS[corner]] - places[corner]


def _determinant(a: np.ndarray) -> np.ndarray:
    """Determinants of (3, 3, m) by the triple product: faster than LAPACK on many small matrices."""
    (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = a
    return x1 * (y2 * z3 - z2 * y3) + y1 * (z2 * x3 - x2 * z3) + z1 * (x2 * y3 - y2 * x3)


def corner_jacobians(points: np.ndarray, hexes: np.ndarray) -> np.ndarray:
    """Determinant of the three edges at every corner, (m, 8), m^3. Negative: inverted.

    Parameters
    ----------
    points : (n, 3) node positions, m.
    hexes : (m, 8) node numbers, VTK order.
    """
    determinants = np.empty(hexes.shape)
    for part, corner, edges in _corner_edges(points, hexes):
        determinants[part, corner] = _CORNER_SIGNS[corner] * _determinant(edges)
    return determinants


def scaled_jacobians(points: np.ndarray, hexes: np.ndarray) -> np.ndarray:
    """Scaled Jacobian at every corner, (m, 8), between -1 and 1; 0 where an edge has no length."""
    scaled = np.zeros(hexes.shape)
    for part, corner, edges in _corner_edges(points, hexes):
        lengths = np.sqrt(np.prod(np.sum(edges * edges, axis=1), axis=0))
        np.divide(_CORNER_SIGNS[corner] * _determinant(edges), lengths, out=scaled[part, corner], where=lengths > 0.0)
    return scaled


def volumes(points: np.ndarray, hexes: np.ndarray) -> np.ndarray:
    """Volume of every hex, (m,), m^3: exact for trilinear hexes."""
    corners = points[hexes]
    total = np.zeros(len(hexes))
    for gauss in _GAUSS_POINTS:
        factors = 1.0 + gauss * CORNERS
        gradient = np.stack([CORNERS[:, i] * factors[:, (i + 1) % 3] * factors[:, (i + 2) % 3] / 8.0 for i in range(3)])
        total += _determinant(np.einsum("ja,mai->jim", gradient, corners))
    return total


def edge_lengths(points: np.ndarray, hexes: np.ndarray) -> np.ndarray:
    """Length of the 12 edges of every hex, (m, 12), m."""
    corners = points[hexes]
    return np.linalg.norm(corners[:, _CORNERS_OF_EDGES[:, 1]] - corners[:, _CORNERS_OF_EDGES[:, 0]], axis=-1)


@dataclass(frozen=True)
class MeshQuality:
    """The figures that a report gives of a mesh.

    Attributes
    ----------
    element_count, node_count
    volume_m3 : volume of all elements, m^3.
    smallest_edge_m, largest_edge_m : shortest and longest element edge, m.
    smallest_scaled_jacobian : the worst corner of the mesh, 1 at best.
    worst_element : the element with that corner.
    """

    element_count: int
    node_count: int
    volume_m3: float
    smallest_edge_m: float
    largest_edge_m: float
    smallest_scaled_jacobian: float
    worst_element: int


def assess(mesh: HexMesh) -> MeshQuality:
    """The quality of a mesh. It judges shape only: ``check`` says whether the mesh can be used at all."""
    smallest = scaled_jacobians(mesh.points, mesh.hexes).min(axis=1)
    edges = edge_lengths(mesh.points, mesh.hexes)
    worst = int(np.argmin(smallest))
    return MeshQuality(
        element_count=mesh.element_count,
        node_count=mesh.node_count,
        volume_m3=float(volumes(mesh.points, mesh.hexes).sum()),
        smallest_edge_m=float(edges.min()),
        largest_edge_m=float(edges.max()),
        smallest_scaled_jacobian=float(smallest[worst]),
        worst_element=worst,
    )


def check(mesh: HexMesh, where: str) -> None:
    """Refuse a mesh that cannot be computed on.

    Parameters
    ----------
    mesh : the mesh to check.
    where : how the message names the mesh, such as its file.

    Raises
    ------
    InputError
        The first of these faults, with numbers from 0: no elements, a node twice in an element, a face of more than two elements,
        a flat or inverted corner, an element that is inverted between its corners, an unused node. ``HexMesh`` has refused
        arrays of another shape, positions that are not finite, missing nodes and repeated elements.
    """
    points, hexes = mesh.points, mesh.hexes
    if len(hexes) == 0:
        raise InputError(f"{where}: the mesh has no elements.")

    ordered = np.sort(hexes, axis=1)
    twice = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if len(twice):
        element = twice[0]
        numbers, counts = np.unique(hexes[element], return_counts=True)
        node = numbers[counts > 1][0]
        corners = _list(np.flatnonzero(hexes[element] == node))
        raise InputError(
            f"{where}: element {element} has node {node} at corners {corners}; a hexahedron needs 8 different nodes"
            f"{_more(twice, 'element')}."
        )

    # A face has two sides: of three elements at it two lie in one place, with twice the mass and the stiffness of the tissue.
    order, begins = face_groups(hexes)
    crowded = np.flatnonzero(np.diff(begins, append=len(order)) > 2)
    if len(crowded):
        elements = np.sort(order[begins[crowded[0]] : np.append(begins, len(order))[crowded[0] + 1]] // len(FACES))
        raise InputError(
            f"{where}: elements {_list(elements)} share a face, which can belong to two elements at most; remove or reconnect "
            f"one of them{_more(crowded, 'face')}."
        )

    scaled = scaled_jacobians(points, hexes)
    bad = np.flatnonzero(scaled.min(axis=1) < _FLAT_SCALED_JACOBIAN)
    if len(bad):
        element = bad[0]
        corner = int(np.argmin(scaled[element]))
        node = hexes[element, corner]
        if scaled[element, corner] > -_FLAT_SCALED_JACOBIAN:
            fault = f"has no volume at corner {corner} (node {node}): its edges lie in a plane or have no length"
            remedy = "merge or move its nodes"
        elif (scaled[element] < 0.0).all():
            fault = f"is inverted: negative Jacobian at all corners, the lowest at corner {corner} (node {node})"
            remedy = "check the node order (VTK: the lower face counter-clockwise seen from above, then the upper one)"
        else:
            fault = f"is inverted at corner {corner} (node {node}): negative Jacobian"
            remedy = "check the node order (VTK) or repair the mesh"
        raise InputError(f"{where}: element {element} {fault}; {remedy}{_more(bad, 'element')}.")

    certificate = certify(points, hexes)
    bad = np.flatnonzero(certificate.folded)
    if len(bad):
        xi, eta, zeta = certificate.natural[bad[0]]
        raise InputError(
            f"{where}: element {bad[0]} is inverted between its corners: negative Jacobian at xi, eta, zeta = "
            f"{xi:.3g}, {eta:.3g}, {zeta:.3g}, but positive at all corners; move its nodes{_more(bad, 'element')}."
        )

    used = np.zeros(len(points), dtype=bool)
    used[hexes] = True
    unused = np.flatnonzero(~used)
    if len(unused):
        raise InputError(
            f"{where}: node {unused[0]} belongs to no element and would have no mass; remove it{_more(unused, 'node')}."
        )


def _more(faulty: np.ndarray, what: str) -> str:
    """' (and 3 more elements)' after the first of several faults."""
    count = len(faulty) - 1
    if count == 0:
        return ""
    return f" (and {count} more {what}{'s' if count > 1 else ''})"


def _list(numbers: np.ndarray) -> str:
    words = [str(number) for number in numbers]
    return ", ".join(words[:-1]) + " and " + words[-1]
