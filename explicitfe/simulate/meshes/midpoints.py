"""Cut tetrahedra and wedges into hexahedra at the middles of their edges, faces and volumes.

A tetrahedron gives four hexahedra, one at each corner, a wedge six, and next to wedges a hexahedron eight: faces between
elements are cut alike on both sides. The volume is the same, and no element is inverted where the elements were not. Elements of
second order are all cut, so that each node in the middle of an edge becomes a corner, and curved edges stay so.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.platform.errors import InputError
from explicitfe.simulate.meshes.content import SOLID_EDGES

# Of each corner its three neighbours, such that the edges to them form a right-handed system.
_NEIGHBOURS = {
    4: ((1, 2, 3), (2, 0, 3), (0, 1, 3), (0, 2, 1)),
    6: ((1, 2, 3), (2, 0, 4), (0, 1, 5), (5, 4, 0), (3, 5, 1), (4, 3, 2)),
    8: ((1, 3, 4), (2, 0, 5), (3, 1, 6), (0, 2, 7), (7, 5, 0), (4, 6, 1), (5, 7, 2), (6, 4, 3)),
}
_FACES_OF = {
    4: ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    6: ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 2, 5, 3)),
    8: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 3, 7, 4)),
}
_WORDS = {4: "tetrahedra", 6: "wedges", 8: "hexahedra"}


@dataclass
class Hexahedra:
    """Hexahedra, and how sets of the nodes and elements that they were made of become sets of theirs.

    Attributes
    ----------
    points : (n, 3); the first are the nodes of the file, in their order.
    hexes : (m, 8).
    of_cell : (m,) element that each was made of.
    note : what was cut, in a sentence; empty where all were hexahedra.
    """

    points: np.ndarray
    hexes: np.ndarray
    of_cell: np.ndarray
    note: str = ""
    _parents: list[np.ndarray] = field(default_factory=list)
    _outside: list[np.ndarray] = field(default_factory=list)
    _on_surface: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    _number: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def nodes(self, nodes: np.ndarray) -> np.ndarray:
        """A set of nodes with the new ones between them: on the surface, or next to a node of the set inside the body."""
        if not self._parents:
            return nodes
        member = np.zeros(len(self._on_surface) + 1, dtype=bool)
        member[nodes] = member[-1] = True  # -1 stands for no parent
        inside = np.append(~self._on_surface, False)
        new = [
            member[parents].all(axis=1) & (outside | inside[parents].any(axis=1))
            for parents, outside in zip(self._parents, self._outside, strict=True)
        ]
        return np.unique(self._number[np.concatenate([member[:-1], *new])])

    def elements(self, cells: np.ndarray) -> np.ndarray:
        """The hexahedra made of a set of elements."""
        return np.flatnonzero(np.isin(self.of_cell, cells))


def hexahedra(points: np.ndarray, cells: np.ndarray, middles: np.ndarray) -> Hexahedra:
    """The hexahedra of solid elements.

    Parameters
    ----------
    points, cells, middles : as in :class:`explicitfe.simulate.meshes.content.FileMesh`.

    Raises
    ------
    InputError : a triangle of one element lies on a quadrilateral of another, so that faces do not fit together.
    """
    size = (cells >= 0).sum(axis=1)
    cells = _right_handed(points, cells, size)
    if (size == 8).all() and not len(middles):
        return Hexahedra(points, cells, np.arange(len(cells)))
    kinds = [(count, np.flatnonzero(size == count)) for count in map(int, np.unique(size))]
    ends = [cells[of][:, SOLID_EDGES[count]].reshape(-1, 2) for count, of in kinds]
    edge, _ = _unique(np.sort(np.concatenate(ends), axis=1))
    sides = {
        (count, frozenset(place)): np.pad(
            np.sort(cells[of][:, place], axis=1)[:, ::-1], ((0, 0), (0, 4 - len(place))), constant_values=-1
        )
        for count, of in kinds
        for place in _FACES_OF[count]
    }
    face, face_of = _unique(np.concatenate([*sides.values()]))
    outside = np.bincount(face_of, minlength=len(face)) == 1
    _check_faces(face[outside], size)

    between, bends = _edge_nodes(points, edge, middles)
    first_face = len(points) + len(edge)
    first_cell = first_face + len(face)
    face_at = dict(zip(sides, np.split(first_face + face_of, np.cumsum([*map(len, sides.values())])[:-1]), strict=True))
    hexes, of_cell = [], []
    for (count, of), corner in ((kind, corner) for kind in kinds for corner in range(kind[0])):
        a, b, c = _NEIGHBOURS[count][corner]
        to_a, to_b, to_c = (between[_edge_of(edge, cells[of][:, [corner, other]])] for other in (a, b, c))

        def across(one: int, other: int, count: int = count, corner: int = corner) -> np.ndarray:
            return next(at for (kind, place), at in face_at.items() if kind == count and {corner, one, other} <= place)

        hexes.append(
            np.column_stack([cells[of, corner], to_a, across(a, b), to_b, to_c, across(a, c), first_cell + of, across(b, c)])
        )
        of_cell.append(of)
    order = np.argsort(np.concatenate(of_cell), kind="stable")
    on_surface = np.zeros(len(points) + 1, dtype=bool)
    on_surface[face[outside]] = True
    pairs = np.concatenate([face[outside][:, [i, j]] for i, j in combinations(range(4), 2)])
    edge_outside = np.isin(_key(edge), _key(np.sort(pairs, axis=1)))
    parents = [edge, face, cells]
    places = [_middle(points, of) for of in parents]
    # Centres of faces and volumes by the shape functions of second order, those of a wedge nearly.
    places[0] += bends[:-1]
    for centre, corners_of, share in zip(places[1:], parents[1:], (np.where(face[:, 3:] < 0, 4 / 9, 0.5), 0.25), strict=True):
        for i, j in combinations(range(cells.shape[1]), 2):
            centre += share * bends[_edge_of(edge, corners_of[:, [i, j]])] if j < corners_of.shape[1] else 0.0
    counts = {_WORDS[count]: int((size == count).sum()) for count in np.unique(size)}
    order_of = " of second order" if len(middles) else ""
    note = (
        f"{' and '.join(f'{n} {name}' for name, n in counts.items())}{order_of} were cut into {sum(map(len, hexes))} hexahedra."
    )
    number = np.arange(len(points) + sum(map(len, places)))
    number[len(points) : first_face] = between
    return Hexahedra(
        np.concatenate([points, *places]), np.concatenate(hexes)[order], np.concatenate(of_cell)[order], note,
        parents, [edge_outside, outside, np.zeros(len(cells), dtype=bool)], on_surface[:-1], number,
    )  # fmt: skip


def without_loose_nodes(body: Hexahedra) -> tuple[np.ndarray, HexMesh]:
    """The mesh of the nodes that elements have, and the number (n,) of each node in it; -1: it belongs to no element.

    Generators leave nodes of points, curves and reference points, which have no mass.
    """
    used = np.zeros(len(body.points), dtype=bool)
    inside = (body.hexes >= 0) & (body.hexes < len(used))  # HexMesh refuses others
    used[body.hexes[inside]] = True
    number = np.where(used, np.cumsum(used) - 1, -1)
    if not inside.all() or used.all():
        return np.arange(len(used)), HexMesh(body.points, body.hexes)
    return number, HexMesh(body.points[used], number[body.hexes])


def _edge_of(edge: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Row of each pair of nodes (k, 2) in sorted edges (n, 2); -1: it is none."""
    pairs = np.sort(pairs, axis=1)
    keys, wanted = (np.ascontiguousarray(of) @ np.array([edge.max() + 2, 1]) for of in (edge, pairs))
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where((keys[at] == wanted) & (pairs[:, 0] >= 0), at, -1)


def _edge_nodes(points: np.ndarray, edge: np.ndarray, middles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Node in the middle of each edge, of the file or a new one, and its distance (n + 1, 3) from the straight edge.

    The last row of distances is zero.
    """
    number, bends = len(points) + np.arange(len(edge)), np.zeros((len(edge) + 1, 3))
    at = _edge_of(edge, middles[:, :2])
    number[at] = middles[:, 2]
    bends[at] = points[middles[:, 2]] - _middle(points, middles[:, :2])
    return number, bends


def _right_handed(points: np.ndarray, cells: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The elements in the order of nodes that gives them a positive volume; hexahedra only if all are turned, as in MED files."""
    cells = cells.copy()
    for count, turned in ((4, [1, 0, 2, 3]), (6, [3, 4, 5, 0, 1, 2]), (8, [4, 5, 6, 7, 0, 1, 2, 3])):
        of = np.flatnonzero(size == count)
        x = points[np.minimum(cells[of][:, :count], len(points) - 1)]
        total = np.zeros(len(of))
        with np.errstate(invalid="ignore"):  # HexMesh refuses nodes that are not finite
            for corner, near in enumerate(_NEIGHBOURS[count]):
                total += np.linalg.det(x[:, near] - x[:, [corner]])
        wrong = of[total < 0.0] if count < 8 or (total < 0.0).all() else of[:0]
        cells[wrong[:, None], np.arange(count)] = cells[wrong[:, None], turned]
    return cells


def _check_faces(faces: np.ndarray, size: np.ndarray) -> None:
    """Refuse triangles that lie on quadrilaterals; of free faces (f, 4), triangles end in -1."""
    triangle = faces[:, 3] < 0
    halves = [faces[~triangle][:, of] for of in combinations(range(4), 3)]
    on_quads = np.isin(_key(faces[triangle][:, :3]), _key(np.concatenate(halves)))
    if on_quads.any():
        counts = ", ".join(f"{(size == count).sum()} {'tetra' if count == 4 else _WORDS[count]}" for count in np.unique(size))
        raise InputError(
            f"the mesh contains {counts}, and {on_quads.sum()} triangles of one kind lie on quadrilaterals of another, so that "
            "their faces do not fit together; mesh the body with one kind of element."
        )


def _unique(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    _, first, inverse = np.unique(_key(rows), return_index=True, return_inverse=True)
    return rows[first], inverse.ravel()


def _key(rows: np.ndarray) -> np.ndarray:
    """One value for each row of node numbers."""
    rows = np.ascontiguousarray(rows.astype(np.int64))
    return rows.view([("", np.int64)] * rows.shape[1]).ravel()


def _middle(points: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Means (k, 3) of the points of each row; -1 stands for none."""
    present = parents >= 0
    return np.einsum("ijk,ij->ik", points[parents], present) / present.sum(axis=1)[:, None]
