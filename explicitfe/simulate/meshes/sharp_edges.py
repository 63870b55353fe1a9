"""Sharp edges of a closed surface: its smooth patches, the patch of each outer face of a mesh, and the places of its outer nodes.

Outer faces get the patch that is near and has their direction, with few differences between neighbours. A node between two
patches lies on their common edge, and one between three at a corner. Where a face would have two sides on one edge, a sheet of
hexahedra around its patch gives it at most one (pillowing: Mitchell & Tautges 1995).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import scipy

from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.mesh.triangles import triangle_samples

SHARP_COSINE = float(np.cos(np.radians(40.0)))  # between the normals of two triangles
_SAMPLES_PER_EDGE = 4  # along an edge of an element
_NEIGHBOUR_COST = 0.3  # cost of a neighbour of another patch, where a distance of one element costs 1
_LABEL_ROUNDS = 10


class Patches:
    """The patches of a surface between its sharp edges.

    Attributes
    ----------
    count : number of patches.
    """

    def __init__(self, surface: TriangleSurface, size_m: float, sharpest: float = SHARP_COSINE) -> None:
        corners = surface.corners
        crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normal = crossed / np.linalg.norm(crossed, axis=1, keepdims=True)
        directed = np.concatenate([surface.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
        order = np.lexsort(np.sort(directed, axis=1).T)
        edges = directed[order[::2]]
        pairs = order.reshape(-1, 2) % len(corners)  # the two triangles at each edge
        sharp = np.einsum("ei,ei->e", *self._normal[pairs.T]) < sharpest
        patch = _components(pairs[~sharp], len(corners))
        area = np.bincount(patch, weights=0.5 * np.linalg.norm(crossed, axis=1))
        sharp &= (area[patch[pairs]] > size_m**2).all(axis=1)  # smaller ones are folds of the triangulation
        patch = _components(pairs[~sharp], len(corners))
        self.count = int(patch.max()) + 1
        sharp &= patch[pairs[:, 0]] != patch[pairs[:, 1]]
        self._surface, self._size = surface, size_m
        samples, owner = triangle_samples(corners, size_m / _SAMPLES_PER_EDGE, surface.box_m)
        self._owner = [owner[patch[owner] == k] for k in range(self.count)]
        self._trees = [scipy.spatial.cKDTree(samples[patch[owner] == k]) for k in range(self.count)]
        curves: defaultdict[frozenset[int], list[np.ndarray]] = defaultdict(list)
        around: defaultdict[int, set[int]] = defaultdict(set)
        for edge, pair in zip(edges[sharp].tolist(), map(frozenset[int], patch[pairs[sharp]].tolist()), strict=True):
            first, last = surface.points[edge]
            parts = 1 + int(_SAMPLES_PER_EDGE * np.linalg.norm(last - first) / size_m)
            ends = first + np.linspace(0.0, 1.0, parts + 1)[:, None] * (last - first)
            curves[pair].append(np.stack([ends[:-1], ends[1:]], axis=1))
            for point in edge:
                around[point] |= pair
        self._curves = {pair: np.concatenate(pieces) for pair, pieces in curves.items()}
        self._corners = {point: patches for point, patches in around.items() if len(patches) > 2}

    def labels(self, quads: np.ndarray, points: np.ndarray) -> np.ndarray:
        """The patch (f,) of each outer face (f, 4) of a mesh inside the surface."""
        x = points[quads]
        normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        cost = np.empty((len(quads), self.count))
        for k, tree in enumerate(self._trees):
            distance, at = tree.query(x.mean(axis=1))
            cost[:, k] = distance / self._size + 1.0 - np.einsum("fi,fi->f", normal, self._normal[self._owner[k][at]])
        label = cost.argmin(axis=1)
        across = neighbours(quads)
        for _ in range(_LABEL_ROUNDS):
            before = label.copy()
            for face in np.flatnonzero((label[across] != label[:, None]).any(axis=1)):
                same = np.bincount(label[across[face]], minlength=self.count)
                label[face] = np.argmin(cost[face] - _NEIGHBOUR_COST * same)
            if np.array_equal(before, label):
                break
        return label

    def places(self, labels: Sequence[frozenset[int]], points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places on the surface near outer nodes (k, 3), and projections (k, 3, 3) to the directions in which these may move.

        Parameters
        ----------
        labels : the patches around each node.
        """
        places, free = points.copy(), np.zeros((len(points), 3, 3))
        groups: defaultdict[frozenset[int], list[int]] = defaultdict(list)
        claims = []
        for node, of in enumerate(labels):
            groups[of].append(node)
            at = [point for point, patches in self._corners.items() if len(of) > 2 and patches >= of]
            claims += [(float(np.linalg.norm(points[node] - self._surface.points[point])), node, point) for point in at]
        taken: dict[int, int] = {}  # one node at each corner
        for _, node, point in sorted(claims):
            if node not in taken and point not in taken.values():
                taken[node] = point
                places[node] = self._surface.points[point]
        for of, nodes in groups.items():
            nodes = [node for node in nodes if node not in taken]
            curves = [self._curves[pair] for pair in self._curves if pair <= of]
            if not nodes:
                continue
            if curves:
                places[nodes], free[nodes] = _on_segments(points[nodes], np.concatenate(curves))
            else:
                places[nodes], free[nodes] = self._on_patch(points[nodes], min(of))
        return places, free

    def _on_patch(self, points: np.ndarray, patch: int) -> tuple[np.ndarray, np.ndarray]:
        triangle = self._owner[patch][self._trees[patch].query(points)[1]]
        normal = self._normal[triangle]
        height = np.einsum("ki,ki->k", points - self._surface.points[self._surface.triangles[triangle, 0]], normal)
        return points - height[:, None] * normal, np.eye(3) - normal[:, :, None] * normal[:, None, :]


def _components(pairs: np.ndarray, count: int) -> np.ndarray:
    graph = scipy.sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    label: np.ndarray = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    return label


def _on_segments(points: np.ndarray, segments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest places to points (k, 3) on segments (s, 2, 3), and the projections to their directions (k, 3, 3)."""
    near = scipy.spatial.cKDTree(segments.mean(axis=1)).query(points, k=range(1, 1 + min(4, len(segments))))[1]
    start, along = segments[near, 0], segments[near, 1] - segments[near, 0]
    share = np.einsum("ksi,ksi->ks", points[:, None] - start, along) / np.einsum("ksi,ksi->ks", along, along)
    place = start + np.clip(share, 0.0, 1.0)[:, :, None] * along
    best = np.arange(len(points)), np.linalg.norm(points[:, None] - place, axis=2).argmin(axis=1)
    direction = along[best] / np.linalg.norm(along[best], axis=1, keepdims=True)
    return place[best], direction[:, :, None] * direction[:, None, :]


def neighbours(quads: np.ndarray) -> np.ndarray:
    """The faces (f, 4) across the edges of the faces (f, 4) of a closed surface; edge k is that from corner k to the next one."""
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    across = np.empty(len(order), dtype=np.int64)
    across[order[::2]], across[order[1::2]] = order[1::2] // 4, order[::2] // 4
    return across.reshape(-1, 4)


def patches_at(quads: np.ndarray, label: np.ndarray) -> dict[int, frozenset[int]]:
    """Node -> the patches of the faces around it."""
    around: defaultdict[int, set[int]] = defaultdict(set)
    for quad, of in zip(quads.tolist(), label.tolist(), strict=True):
        for node in quad:
            around[node].add(of)
    return {node: frozenset(of) for node, of in around.items()}


def pillow_patches(
    points: np.ndarray, layer: np.ndarray, label: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Insert a sheet around each patch of which a face has two neighbouring sides on an edge between two patches.

    Parameters
    ----------
    points, layer : nodes (n, 3), and hexahedra (f, 8) whose last four nodes are on the surface.
    label : (f,) their patches.

    Returns
    -------
    All nodes, the layer with the sheets' hexahedra on the surface, the patch of each, and hexahedra inside.
    """
    inside = np.zeros((0, 8), dtype=np.int64)
    for patch in range(int(label.max()) + 1):
        quads = layer[:, 4:]
        patches = patches_at(quads, label)
        border = label[neighbours(quads)] != label[:, None]
        turns = border & np.roll(border, 1, axis=1) & (label == patch)[:, None]
        if all(len(patches[node]) > 2 for node in quads[turns]):
            continue
        own = np.flatnonzero(label == patch)
        face, side = np.nonzero(border[own])
        number = np.arange(len(points))
        borders = [layer[own[face], 4 + corner] for corner in (side, (side + 1) % 4)]
        moved = np.unique(np.concatenate([layer[own, :4].ravel(), *borders]))
        number[moved] = len(points) + np.arange(len(moved))
        old = layer[own]
        new = number[old]
        middle, count = np.zeros_like(points), np.zeros((len(points), 1))
        np.add.at(middle, old, points[old].mean(axis=1)[:, None])
        np.add.at(count, old, 1.0)
        points = np.concatenate([points, points[moved] + 0.4 * (middle / np.maximum(count, 1.0) - points)[moved]])
        first, last = side, (side + 1) % 4
        around = np.stack([of[face, at] for up in (0, 4) for of, at in (
            (old, up + first), (old, up + last), (new, up + last), (new, up + first))], axis=1)  # fmt: skip
        inside = np.concatenate([inside, np.concatenate([old[:, :4], new[:, :4]], axis=1)])
        layer = layer.copy()
        layer[own] = new
        layer = np.concatenate([layer, around])
        label = np.append(label, np.full(len(around), patch))
    return points, layer, label, inside
