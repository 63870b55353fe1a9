"""The mesh that everything else receives: nodes, hexes, named sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from explicitfe.errors import InputError, nearest
from explicitfe.host.kept import kept

# Natural coordinates of the 8 corners in VTK order (VTK_HEXAHEDRON).
CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=float
)

# Its 6 faces, corner after corner, seen from outside counter-clockwise.
FACES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])


@dataclass(frozen=True)
class MaterialPoints:
    """Points that move with the material, or, where ``element`` is -1, points fixed in space (on a bone).

    Attributes
    ----------
    element : (k,) int64. The element that holds each point; -1: fixed in space.
    natural : (k, 3) float64. Natural coordinates in that element, each in [-1, 1]; 0 where fixed in space.
    position : (k, 3) float64, m. Reference position.
    """

    element: np.ndarray
    natural: np.ndarray
    position: np.ndarray

    def __len__(self) -> int:
        return len(self.element)


@dataclass(frozen=True, eq=False)
class HexMesh:
    """Nodes and 8-node hexes with their named sets; never changed, and equal only to itself.

    Attributes
    ----------
    points : (n, 3) float64, m. Reference positions.
    hexes : (m, 8) int64. Node numbers of each element in VTK order.
    node_sets : name -> (k,) int64. Sets of nodes, such as the attachments ``jaw`` and ``hyoid``.
    named_points : name -> one point. Points that a user asks for by name, such as ``tip``.
    """

    points: np.ndarray
    hexes: np.ndarray
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    named_points: dict[str, MaterialPoints] = field(default_factory=dict)

    @property
    def node_count(self) -> int:
        return len(self.points)

    @property
    def element_count(self) -> int:
        return len(self.hexes)

    def nodes_of(self, name: str) -> np.ndarray:
        """Node numbers (k,) of the set called ``name``.

        Raises
        ------
        InputError : the mesh has no such set.
        """
        if name not in self.node_sets:
            raise InputError(f'unknown node set "{name}"; {nearest(name, self.node_sets)}')
        return self.node_sets[name]

    def held(self, *names: str, along: str = "xyz") -> np.ndarray:
        """Mask (n, 3) of the components that do not move: those ``along`` the axes named, of the nodes in the sets named.

        ``mesh.held("z0")`` clamps a face, ``mesh.held("x0", along="x")`` lets it slide; ``|`` joins two masks.

        Raises
        ------
        InputError : the mesh has no such set.
        """
        mask = np.zeros((self.node_count, 3), dtype=bool)
        for name in names:
            mask[np.ix_(self.nodes_of(name), np.array(["xyz".index(axis) for axis in along]))] = True
        return mask

    def at(self, points: MaterialPoints, values: np.ndarray) -> np.ndarray:
        """Values of the nodes, (n, ...), interpolated by the shape functions at points in the mesh, (k, ...).

        At a node it is the node's value to the last bit.
        """
        return np.einsum("ka,ka...->k...", shape_functions(points.natural), values[self.hexes[points.element]])

    def points_in(self, element: np.ndarray, natural: np.ndarray) -> MaterialPoints:
        """The points with these natural coordinates, (k, 3), in these elements, (k,)."""
        unplaced = MaterialPoints(element, natural, np.empty_like(natural))
        return replace(unplaced, position=self.at(unplaced, self.points))

    def points_at_nodes(self, nodes: Sequence[int] | np.ndarray) -> MaterialPoints:
        """Nodes as material points: each in the first element that holds it, at its corner.

        Raises
        ------
        InputError : a node number out of range, or a node of no element.
        """
        numbers = np.asarray(nodes, dtype=np.int64)
        outside = numbers[(numbers < 0) | (numbers >= self.node_count)]
        if len(outside):
            raise InputError(f"node {outside[0]} is not in the mesh: its nodes run from 0 to {self.node_count - 1}.")
        flat = self.hexes.ravel()
        first = np.full(self.node_count, -1)
        # Of repeated indices the last assignment stays: reversed, that is the first element.
        first[flat[::-1]] = np.arange(len(flat))[::-1]
        place = first[numbers]
        if (place < 0).any():
            raise InputError(f"node {numbers[place < 0][0]} belongs to no element.")
        element, corner = np.divmod(place, 8)
        return MaterialPoints(element=element, natural=CORNERS[corner], position=self.points[numbers])

    def with_named_nodes(self, nodes: Mapping[str, int]) -> HexMesh:
        """The same mesh with named points at nodes.

        Raises
        ------
        InputError : see ``points_at_nodes``.
        """
        return replace(self, named_points={name: self.points_at_nodes([node]) for name, node in nodes.items()})


def joined_points(parts: Sequence[MaterialPoints]) -> MaterialPoints:
    """Several sets of material points as one, in their order."""
    return MaterialPoints(
        element=np.concatenate([part.element for part in parts]),
        natural=np.concatenate([part.natural for part in parts]),
        position=np.concatenate([part.position for part in parts]),
    )


def shape_functions(natural: np.ndarray) -> np.ndarray:
    """Trilinear shape functions N_a, (..., 8), at natural coordinates (..., 3) (Hughes 2000, eq. 3.5.20)."""
    return np.prod(1.0 + natural[..., None, :] * CORNERS, axis=-1) / 8.0


def shape_gradients(natural: np.ndarray) -> np.ndarray:
    """Gradients dN_a / d(xi, eta, zeta), (..., 8, 3), at natural coordinates (..., 3)."""
    factors = 1.0 + natural[..., None, :] * CORNERS
    others = np.stack([factors[..., (i + 1) % 3] * factors[..., (i + 2) % 3] for i in range(3)], axis=-1)
    return CORNERS * others / 8.0


def face_groups(hexes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All faces (6 m,), numbered 6 times the element plus the place in ``FACES``, those of the same nodes beside each other.

    And where each group of these begins. The groups lie in the order of their sorted nodes, the faces of a group in their own.
    """
    nodes = np.sort(hexes[:, FACES].reshape(-1, 4), axis=1)
    size = int(hexes.max(initial=0)) + 1
    first, second = nodes[:, 0] * size + nodes[:, 1], nodes[:, 2] * size + nodes[:, 3]
    order = np.lexsort((second, first))
    begins = np.append(True, (np.diff(first[order]) != 0) | (np.diff(second[order]) != 0))
    return order, np.flatnonzero(begins[: len(order)])


def inner_faces(hexes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The faces that two elements share: the two elements of each, (f, 2), and its nodes in the order of the first, (f, 4)."""
    order, begins = face_groups(hexes)
    two = begins[np.diff(begins, append=len(order)) == 2]
    pairs = np.stack([order[two], order[two + 1]], axis=1)
    return pairs // len(FACES), hexes[:, FACES].reshape(-1, 4)[pairs[:, 0]]


@kept(8)
def free_faces(hexes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The faces that belong to one element only: element and place in ``FACES`` of each, (f,) and (f,), element after element."""
    order, begins = face_groups(hexes)
    element, face = np.divmod(np.sort(order[begins[np.diff(begins, append=len(order)) == 1]]), len(FACES))
    return element, face
