"""The mesh that everything else receives: nodes, hexahedra, named sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from explicitfe.fem.mesh.checked_arrays import FARTHEST_POINT_M, check_range, index_array, number_array
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.kept import kept

_HEXES = "HexMesh: " + "hexes"  # in messages

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
    """A mesh of 8-node hexahedra with named node sets and named points.

    The arrays are checked, converted and copied when the mesh is created, and are read-only afterwards. Two meshes are equal only
    if they are the same object.

    Parameters
    ----------
    points : (n, 3) reference positions of the nodes, m; converted to float64. At most 100 m from the origin.
    hexes : (m, 8) node numbers of each element in VTK order (VTK_HEXAHEDRON), from 0; converted to int64.
    node_sets : name -> (k,) node numbers, each once, such as the attachments ``jaw`` and ``hyoid``.
    named_points : name -> one point of the mesh, such as ``tip``; see :meth:`with_named_nodes`.

    Raises
    ------
    InputError : an array of another shape or type, a number that is not finite, or a node that does not exist.
    """

    points: np.ndarray
    hexes: np.ndarray
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    named_points: dict[str, MaterialPoints] = field(default_factory=dict)

    def __post_init__(self) -> None:
        points = number_array("HexMesh: points", self.points, ("n", 3), largest=FARTHEST_POINT_M, rows="node")
        object.__setattr__(self, "points", points)
        hexes = index_array(_HEXES, self.hexes, None, "node", columns=8)
        _check_elements(hexes, len(points))
        object.__setattr__(self, "hexes", hexes)
        for name, table in (("node_sets", self.node_sets), ("named_points", self.named_points)):
            if not isinstance(table, Mapping) or not all(isinstance(key, str) for key in table):
                raise InputError(f"HexMesh: {name} must be a dictionary with names as keys, not {shortened(repr(table))}.")
        sets = {
            name: index_array(f'HexMesh: node_sets["{name}"]', nodes, len(points), "node", unique=True)
            for name, nodes in self.node_sets.items()
        }
        object.__setattr__(self, "node_sets", sets)
        object.__setattr__(self, "named_points", dict(self.named_points))
        for name, point in self.named_points.items():
            if not isinstance(point, MaterialPoints):
                raise InputError(
                    f'HexMesh: named_points["{name}"] must be a point of the mesh, not {shortened(repr(point))}; use '
                    "mesh.with_named_nodes({name: node})."
                )

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def element_count(self) -> int:
        """Number of elements."""
        return len(self.hexes)

    def nodes_of(self, name: str) -> np.ndarray:
        """Node numbers of a named set.

        Parameters
        ----------
        name : of the set.

        Returns
        -------
        (k,) int64.

        Raises
        ------
        InputError : the mesh has no such set.
        """
        if not isinstance(name, str) or name not in self.node_sets:
            raise InputError(f'unknown node set "{shortened(str(name))}"; {nearest(str(name), self.node_sets)}')
        return self.node_sets[name]

    def held(self, *names: str, along: str = "xyz") -> np.ndarray:
        """Mask of the displacement components that are fixed.

        ``mesh.held("z0")`` clamps a face, ``mesh.held("x0", along="x")`` lets it slide; ``|`` joins two masks.

        Parameters
        ----------
        names : node sets whose nodes are fixed.
        along : the axes along which they are fixed, any of "x", "y" and "z".

        Returns
        -------
        (n, 3) bool, for ``Model(held=...)``.

        Raises
        ------
        InputError : the mesh has no such set, or there is no such axis.
        """
        if not isinstance(along, str) or not along or set(along) - set("xyz"):
            raise InputError(f"held: along = {shortened(repr(along))} is not possible; name axes, such as 'x' or 'yz'.")
        mask = np.zeros((self.node_count, 3), dtype=bool)
        for name in names:
            mask[np.ix_(self.nodes_of(name), np.array(["xyz".index(axis) for axis in along]))] = True
        return mask

    def at(self, points: MaterialPoints, values: np.ndarray) -> np.ndarray:
        """Interpolate nodal values at points of the mesh by the shape functions; exact at a node.

        Parameters
        ----------
        points : k points, such as ``mesh.named_points["tip"]`` or ``mesh.points_at_nodes(...)``.
        values : (n, ...) values at the nodes.

        Returns
        -------
        (k, ...) values at the points.

        Raises
        ------
        InputError : ``values`` does not have a row for each node, or a point is of another mesh.
        """
        check_range("at: points", points.element, self.element_count, "element")
        if np.shape(values)[:1] != (self.node_count,):
            raise InputError(f"at: values must have a row for each of {self.node_count} nodes, not the shape {np.shape(values)}.")
        corners = np.asarray(values)[self.hexes[points.element]]
        return np.einsum("ka,ka...->k...", shape_functions(points.natural), corners)

    def points_in(self, element: np.ndarray, natural: np.ndarray) -> MaterialPoints:
        """Points given by their elements and natural coordinates.

        Parameters
        ----------
        element : (k,) element numbers.
        natural : (k, 3) natural coordinates in them, each in [-1, 1].
        """
        unplaced = MaterialPoints(element, natural, np.empty_like(natural))
        return replace(unplaced, position=self.at(unplaced, self.points))

    def points_at_nodes(self, nodes: Sequence[int] | np.ndarray) -> MaterialPoints:
        """Nodes as points of the mesh: each is a corner of the first element that has it.

        Parameters
        ----------
        nodes : (k,) node numbers.

        Raises
        ------
        InputError : a node that does not exist or belongs to no element.
        """
        numbers = index_array("points_at_nodes: nodes", nodes, self.node_count, "node")
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
        """The same mesh with named points at nodes, in place of those that it has.

        Parameters
        ----------
        nodes : name -> node number.

        Raises
        ------
        InputError : a node that does not exist or belongs to no element.
        """
        return replace(self, named_points={name: self.points_at_nodes([node]) for name, node in nodes.items()})


def _check_elements(hexes: np.ndarray, node_count: int) -> None:
    """Refuse a node that does not exist, and an element that occurs twice: it would have twice its mass and stiffness."""
    outside = np.argwhere((hexes < 0) | (hexes >= node_count))
    if len(outside):
        element, corner = outside[0]
        raise InputError(
            f"{_HEXES}: corner {corner} of element {element} is node {hexes[element, corner]}, but the nodes run from 0 to "
            f"{node_count - 1}."
        )
    nodes = np.sort(hexes, axis=1).astype(np.uint64)
    # Elements of the same nodes have the same sum; only those of the same sum are compared.
    sums = nodes @ (np.arange(1, 16, 2, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15))
    order = np.argsort(sums, kind="stable")
    for first, again in order[np.flatnonzero(np.diff(sums[order]) == 0)[:, None] + [0, 1]]:
        if np.array_equal(nodes[first], nodes[again]):
            raise InputError(f"{_HEXES}: element {again} has the same 8 nodes as element {first}; remove one of them.")


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
    """All faces (6 m,), numbered 6 times the element plus the place in ``FACES``; faces of the same nodes are neighbours.

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
