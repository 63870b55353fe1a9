"""Detection of self-penetration, which the mechanics does not prevent."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

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
# Cells are that much larger than boxes, so that rounding does not put the two ends of one three cells apart.
_CELL_SHARE = 1.0 + 1e-6


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
    elsewhere = ~_are_neighbours(neighbours, mesh.node_count, node, mesh.hexes[element]).any(axis=1)
    element, node = element[elsewhere], node[elsewhere]

    inside = _inside(x[mesh.hexes[element]], x[node])
    element, node = element[inside], node[inside]
    nodes = np.unique(node)
    nobody = SelfPenetration(0, 0.0, None, element[:0])
    if not len(nodes):
        return nobody

    tried = min(_TRIANGLES_TRIED, len(triangles))
    near = scipy.spatial.cKDTree(triangles.mean(axis=1)).query(x[nodes], k=np.arange(1, tried + 1))[1]
    own = _are_neighbours(neighbours, mesh.node_count, np.repeat(nodes, tried), quads[near.ravel() // 4])
    own = own.any(axis=1).reshape(near.shape)
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
def _neighbours(hexes: np.ndarray, surface: np.ndarray, node_count: int) -> np.ndarray:
    """All pairs of a node of the surface and a node of one of its elements, each as ``node_count * first + second``, sorted."""
    element, corner = np.nonzero(np.isin(hexes, surface))
    return np.unique(node_count * hexes[element, corner][:, None] + hexes[element])


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
    low, high = x[hexes].min(axis=1), x[hexes].max(axis=1)
    scale = np.frexp((high - low).max(axis=1))[1]
    element, point = [], []
    for boxes in (np.flatnonzero(scale == one) for one in np.unique(scale)):
        box, inside = _in_boxes_alike(low[boxes], high[boxes], points)
        element.append(boxes[box])
        point.append(inside)
    return np.concatenate(element), np.concatenate(point)


def _in_boxes_alike(low: np.ndarray, high: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs (k,), (k,) of a box, with corners (m, 3), and a point in it.

    The points are sorted into cells as large as the largest box: along each axis a box reaches into two.
    """
    origin, end = low.min(axis=0), high.max(axis=0)
    size = _CELL_SHARE * np.maximum((high - low).max(axis=0), np.finfo(float).tiny)
    count = ((end - origin) / size).astype(np.int64) + 2
    stride = np.array([count[1] * count[2], count[2], 1])
    near = np.flatnonzero(((points >= origin) & (points <= end)).all(axis=1))
    cell = ((points[near] - origin) / size).astype(np.int64) @ stride
    order = near[np.argsort(cell, kind="stable")]
    cell.sort()
    box, point = [], []
    for x, y in product((0, 1), repeat=2):
        first = ((low - origin) / size).astype(np.int64) @ stride + x * stride[0] + y * stride[1]
        begin, after = np.searchsorted(cell, [first, first + 2])
        hits = after - begin
        number = np.repeat(np.arange(len(low)), hits)
        candidate = order[np.arange(len(number)) + np.repeat(begin - np.cumsum(hits) + hits, hits)]
        inside = ((points[candidate] >= low[number]) & (points[candidate] <= high[number])).all(axis=1)
        box.append(number[inside])
        point.append(candidate[inside])
    return np.concatenate(box), np.concatenate(point)


def _are_neighbours(neighbours: np.ndarray, node_count: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Which nodes (k, c) belong to an element of the node of the surface (k,)."""
    pair = node_count * first[:, None] + second
    return neighbours[np.minimum(np.searchsorted(neighbours, pair), len(neighbours) - 1)] == pair
