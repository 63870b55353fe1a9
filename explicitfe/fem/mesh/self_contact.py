"""Detection of self-penetration, which the mechanics does not prevent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.muscle_lines import natural_coordinates
from explicitfe.fem.mesh.triangles import surface_triangles, triangle_distance
from explicitfe.platform.host.kept import kept

# A node is in an element up to this natural coordinate, so that none is lost between two elements.
_INSIDE_COORDINATE = 1.0 + 1e-9
# What is less deep than this share of the body's extent just touches.
_TOUCHING_SHARE = 1e-8
# The depth of a node is its distance from the nearest of so many triangles around it, those nearest by their middles: several
# times as many as belong to its own neighbourhood, which do not count.
_TRIANGLES_TRIED = 256


@dataclass(frozen=True)
class SelfPenetration:
    """Where a body passes through itself.

    Attributes
    ----------
    count : nodes of the surface that lie inside elements elsewhere in the body.
    deepest_m : m. How far the deepest of them lies below the surface that it passed through; 0 where there is none.
    where_m : (3,) m. The place of the deepest node in the reference shape; None where there is none.
    elements : (k,) the elements that these nodes lie in.
    """

    count: int
    deepest_m: float
    where_m: np.ndarray | None
    elements: np.ndarray


@kept(4)
def self_penetration(mesh: HexMesh, displacement: np.ndarray) -> SelfPenetration:
    """Find the nodes of the surface that lie inside elements of another part of the body.

    Another part: elements that have no node in common with the elements of the node. So a fold within two elements is not
    seen, nor are edges that pass each other where no node is inside.

    Parameters
    ----------
    displacement : (n, 3) m, finite.
    """
    x = mesh.points + displacement
    triangles, quads = surface_triangles(mesh, x)
    surface = np.unique(quads)
    element, row = _in_boxes(x, mesh.hexes, x[surface])
    node = surface[row]

    neighbours = _neighbours(mesh.hexes, surface, mesh.node_count)
    elsewhere = _entries(neighbours, row, mesh.hexes[element]).max(axis=1, initial=0) == 0
    element, node = element[elsewhere], node[elsewhere]

    inside = _inside(x[mesh.hexes[element]], x[node])
    element, node = element[inside], node[inside]
    nodes = np.unique(node)
    nobody = SelfPenetration(0, 0.0, None, element[:0])
    if not len(nodes):
        return nobody

    tried = min(_TRIANGLES_TRIED, len(triangles))
    near = scipy.spatial.cKDTree(triangles.mean(axis=1)).query(x[nodes], k=np.arange(1, tried + 1))[1]
    rows = np.repeat(np.searchsorted(surface, nodes), tried)
    own = _entries(neighbours, rows, quads[near.ravel() // 4]).max(axis=1).reshape(near.shape) > 0
    distance = triangle_distance(np.repeat(x[nodes], tried, axis=0), triangles[near.ravel()]).reshape(near.shape)
    depth = np.where(own, np.inf, distance).min(axis=1)
    depth = np.where(np.isfinite(depth), depth, distance.max(axis=1))  # nothing else is near: at least so deep
    deepest = int(np.argmax(depth))
    through = nodes[depth > _TOUCHING_SHARE * np.ptp(mesh.points, axis=0).max()]
    if not len(through):
        return nobody
    elements = np.unique(element[np.isin(node, through)])
    return SelfPenetration(len(through), float(depth[deepest]), mesh.points[nodes[deepest]].copy(), elements)


@kept(4)
def _neighbours(hexes: np.ndarray, surface: np.ndarray, node_count: int) -> scipy.sparse.csr_array:
    """Which nodes the elements of each node of the surface have: entries that are not 0, (surface nodes, nodes)."""
    incidence = scipy.sparse.csr_array(
        (np.ones(hexes.size, dtype=np.int32), hexes.ravel(), 8 * np.arange(len(hexes) + 1)), shape=(len(hexes), node_count)
    )
    return (incidence[:, surface].T @ incidence).tocsr()


def middles_in_elements(mesh: HexMesh) -> np.ndarray:
    """The elements (k,) whose middle, the mean of the corners, lies in another element."""
    x, hexes = mesh.points, mesh.hexes
    middles = x[hexes].mean(axis=1)
    element, other = _in_boxes(x, hexes, middles)
    element, other = element[element != other], other[element != other]
    return np.unique(other[_inside(x[hexes[element]], middles[other])])


def _inside(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points (k, 3) lie in the hexes with corners (k, 8, 3)."""
    natural, converged = natural_coordinates(corners, points, np.zeros((1, 3)))
    return converged & (np.abs(natural) <= _INSIDE_COORDINATE).all(axis=1)


def _in_boxes(x: np.ndarray, hexes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs (k,), (k,) of an element and a point, of those given, that lies in its bounding box."""
    corners = x[hexes]
    low, high = corners.min(axis=1), corners.max(axis=1)
    reach = 0.5 * np.linalg.norm(high - low, axis=1)
    near = scipy.spatial.cKDTree(points).query_ball_point(0.5 * (low + high), reach)
    element = np.repeat(np.arange(len(hexes)), [len(numbers) for numbers in near])
    point = np.concatenate(near).astype(np.int64)
    inside = ((points[point] >= low[element]) & (points[point] <= high[element])).all(axis=1)
    return element[inside], point[inside]


def _entries(matrix: scipy.sparse.csr_array, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Entries (k, c) of a sparse matrix in rows (k,) and columns (k, c)."""
    if not columns.size:
        return np.zeros(columns.shape, dtype=np.int32)
    picked = matrix[np.repeat(rows, columns.shape[1]), columns.ravel()]
    return np.asarray(picked).reshape(columns.shape)
