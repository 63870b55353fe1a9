"""What a mesh file holds: nodes, solid elements, and sets by name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.inputs.table import LONGEST_NAME_CHARACTERS
from explicitfe.platform.errors import InputError

# Solid elements that can be computed, or cut into hexahedra, and how many corners each has. Those of second order have nodes at
# the middles of edges behind the corners, in the order of SOLID_EDGES (VTK, Abaqus, FEBio); others behind them are not read.
SOLIDS = {"hexahedron": 8, "wedge": 6, "tetra": 4}
SOLIDS |= {"hexahedron20": 8, "hexahedron24": 8, "hexahedron27": 8, "wedge15": 6, "wedge18": 6, "tetra10": 4, "tetra15": 4}
SOLID_EDGES = {
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    8: ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
}
_SOLID_KIND = re.compile("pyramid|tetra|wedge|hexa|prism|polyhedron", re.IGNORECASE)  # with more nodes, such as tetra20
DAMAGED = "it is damaged, or its format does not match its suffix"
_FARTHEST_MIDDLE_SHARE = 0.5  # of an edge; so far at most is a node in its middle from the straight line


@dataclass
class FileMesh:
    """The content of a mesh file, in its unit of length.

    Attributes
    ----------
    points : (n, 3).
    cells : (m, 8) corners of the solid elements; those of fewer corners end in -1.
    middles : (k, 3) two corners, and the node in the middle of the edge between them; of elements of second order only.
    node_sets : name -> nodes; groups of surfaces and of elements are sets of their nodes too.
    element_sets : name -> elements.
    point_data : name -> one number for each node, (n,).
    cell_data : name -> one number for each element, (m,).
    labels : (n,) numbers of the nodes in the file; empty where they have none, or none of their own.
    """

    points: np.ndarray
    cells: np.ndarray
    middles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    element_sets: dict[str, np.ndarray] = field(default_factory=dict)
    point_data: dict[str, np.ndarray] = field(default_factory=dict)
    cell_data: dict[str, np.ndarray] = field(default_factory=dict)
    labels: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def add_flags(self) -> None:
        """Name the nodes and elements of arrays that hold 0 and 1 only."""
        for name, values in self.point_data.items():
            if set(np.unique(values)) == {0, 1}:
                self.node_sets.setdefault(name, np.flatnonzero(values))
        for name, values in self.cell_data.items():
            if set(np.unique(values)) == {0, 1}:
                self.element_sets.setdefault(name, np.flatnonzero(values))
                self.node_sets.setdefault(name, nodes_of_cells(self.cells[values == 1]))

    def arrays(self) -> dict[str, np.ndarray]:
        """The content as arrays by name, for another process."""
        plain = {name: getattr(self, name) for name in ("points", "cells", "middles", "labels")}
        tables = {kind: getattr(self, kind) for kind in _TABLES}
        return plain | {f"{kind}:{name}": values for kind, table in tables.items() for name, values in table.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray]) -> FileMesh:
        """The content that :meth:`arrays` gave."""
        mesh = cls(arrays["points"], arrays["cells"], arrays["middles"], labels=arrays["labels"])
        for key, values in arrays.items():
            kind, colon, name = key.partition(":")
            if colon:
                getattr(mesh, kind)[name] = values
        return mesh


_TABLES = ("node_sets", "element_sets", "point_data", "cell_data")


def nodes_of_cells(cells: np.ndarray) -> np.ndarray:
    """Nodes (k,) of elements (m, 8), sorted."""
    nodes = np.unique(cells)
    return nodes[nodes >= 0]


def set_name(name: str) -> str:
    """The name of a set as a result file can hold it: without "/", and not too long."""
    return name.strip().replace("/", "-")[:LONGEST_NAME_CHARACTERS] or "unnamed"


def check_kinds(counts: Mapping[str, int]) -> None:
    """Refuse solid elements that cannot be computed; ``counts`` of elements by kind, such as tetra10.

    Raises
    ------
    InputError : there are such elements, or no solid ones.
    """
    other = {kind: n for kind, n in counts.items() if n and _SOLID_KIND.search(kind) and kind not in SOLIDS}
    if other:
        listed = ", ".join(f"{count} {kind}" for kind, count in other.items())
        why = "only elements of first and second order are supported; mesh the body with them (in Gmsh: -order 2)."
        if all(kind.startswith("pyramid") for kind in other):
            why = (
                "four edges meet at the apex of a pyramid, so that it cannot be cut into hexahedra; mesh the body with "
                "tetrahedra alone, or with hexahedra and wedges."
            )
        raise InputError(f"the mesh contains {listed} cells, and {why}")
    if not any(counts.get(kind) for kind in SOLIDS):
        listed = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count) or "no elements"
        raise InputError(
            f"the mesh contains no hexahedra and no tetrahedra ({listed}); save the elements of its volume too. A closed "
            "surface, saved as STL, OBJ, PLY or VTP, is meshed by `explicitfe new model --mesh SURFACE --size MM`."
        )


def corners_and_middles(kind: str, nodes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (m, 8) and middles (k, 3), as in :class:`FileMesh`, of solid elements of one kind.

    Raises
    ------
    InputError : a node that should be in the middle of an edge lies elsewhere.
    """
    count = SOLIDS[kind]
    corners = np.pad(nodes[:, :count], ((0, 0), (0, 8 - count)), constant_values=-1)
    if nodes.shape[1] == count:
        return corners, np.zeros((0, 3), dtype=np.int64)
    if not ((nodes >= 0) & (nodes < len(points))).all():
        raise InputError(f"{kind} cells name nodes that the file does not have.")
    ends = np.array(SOLID_EDGES[count])
    middles = np.concatenate([nodes[:, ends], nodes[:, count : count + len(ends), None]], axis=2).reshape(-1, 3)
    first, last, middle = points[middles.T]
    away = np.linalg.norm(middle - 0.5 * (first + last), axis=1) > _FARTHEST_MIDDLE_SHARE * np.linalg.norm(last - first, axis=1)
    if away.any():
        raise InputError(
            f"the {kind} cells have nodes that do not lie near the middle of their edges, {away.sum()} of {len(away)}: their "
            "order is not that of the format, or they are damaged; save the mesh with elements of first order."
        )
    return corners, middles


class MeshBuilder:
    """Collects nodes, elements and sets one after the other."""

    def __init__(self) -> None:
        self.points: list[np.ndarray] = []
        self.labels: list[int] = []
        self.cells: list[tuple[str, list[int]]] = []
        self._sets: dict[str, dict[str, list[int]]] = {"node": {}, "cell": {}}
        self._shared: dict[str, dict[str, list[int]]] = {"node": {}, "cell": {}}

    def add_points(self, points: np.ndarray, labels: Sequence[int]) -> range:
        """Add nodes (k, 3) with their labels in the file; their numbers."""
        first = len(self.labels)
        self.points.append(points)
        self.labels += labels
        return range(first, len(self.labels))

    def add_cell(self, kind: str, nodes: list[int]) -> int:
        """Add an element, solid or not; its number."""
        self.cells.append((kind, nodes))
        return len(self.cells) - 1

    def name_nodes(self, name: str, nodes: Sequence[int], owner: str = "") -> None:
        """Name nodes; those of an owner, such as an instance, have its name in front, and are a part of the set without it."""
        self._name("node", name, nodes, owner)

    def name_cells(self, name: str, cells: Sequence[int], owner: str = "") -> None:
        """Name elements, and their nodes where no set of nodes has that name."""
        self._name("cell", name, cells, owner)

    def _name(self, what: str, name: str, members: Sequence[int], owner: str) -> None:
        if owner:
            self._shared[what].setdefault(set_name(name), []).extend(members)
        self._sets[what].setdefault(set_name(f"{owner}.{name}" if owner else name), []).extend(members)

    def finish(self) -> FileMesh:
        """All that was added.

        Raises
        ------
        InputError : elements that are not supported, or no solid ones.
        """
        kinds = [kind for kind, _ in self.cells]
        check_kinds({kind: kinds.count(kind) for kind in dict.fromkeys(kinds)})
        solid = np.array([kind in SOLIDS for kind in kinds])
        number = np.cumsum(solid) - 1
        points, cells = np.concatenate(self.points), np.full((solid.sum(), 8), -1)
        middles = [np.zeros((0, 3), dtype=np.int64)]
        for kind in sorted(SOLIDS.keys() & set(kinds)):
            nodes = np.array([nodes for of, nodes in self.cells if of == kind])
            cells[number[[of == kind for of in kinds]]], of_edges = corners_and_middles(kind, nodes, points)
            middles.append(of_edges)
        mesh = FileMesh(points, cells, np.concatenate(middles), labels=np.array(self.labels, dtype=np.int64))
        nodes_named, cells_named = (self._shared[what] | self._sets[what] for what in ("node", "cell"))
        for name, members in cells_named.items():
            mesh.element_sets[name] = number[[cell for cell in members if solid[cell]]]
            mesh.node_sets[name] = np.unique([node for cell in members for node in self.cells[cell][1]]).astype(np.int64)
        mesh.node_sets |= {name: np.unique(nodes).astype(np.int64) for name, nodes in nodes_named.items()}
        mesh.element_sets = {name: np.unique(cells) for name, cells in mesh.element_sets.items() if len(cells)}
        return mesh
