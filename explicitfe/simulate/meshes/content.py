"""What a mesh file holds: nodes, solid elements, and sets by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.inputs.table import LONGEST_NAME_CHARACTERS
from explicitfe.platform.errors import InputError

# Solid elements that can be computed, or cut into hexahedra, and how many nodes each has.
SOLIDS = {"hexahedron": 8, "wedge": 6, "tetra": 4}
_OTHER_SOLIDS = ("pyramid", "tetra", "wedge", "hexahedron")  # with more nodes, such as tetra10


@dataclass
class FileMesh:
    """The content of a mesh file, in its unit of length.

    Attributes
    ----------
    points : (n, 3).
    cells : (m, 8) nodes of the solid elements; those of fewer nodes end in -1.
    node_sets : name -> nodes; groups of surfaces and of elements are sets of their nodes too.
    element_sets : name -> elements.
    point_data : name -> one number for each node, (n,).
    cell_data : name -> one number for each element, (m,).
    labels : (n,) numbers of the nodes in the file; empty where they have none, or none of their own.
    """

    points: np.ndarray
    cells: np.ndarray
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
        plain = {"points": self.points, "cells": self.cells, "labels": self.labels}
        tables = {kind: getattr(self, kind) for kind in _TABLES}
        return plain | {f"{kind}:{name}": values for kind, table in tables.items() for name, values in table.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray]) -> FileMesh:
        """The content that :meth:`arrays` gave."""
        mesh = cls(arrays["points"], arrays["cells"], labels=arrays["labels"])
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
    other = {kind: n for kind, n in counts.items() if n and kind.startswith(_OTHER_SOLIDS) and kind not in SOLIDS}
    if other:
        listed = ", ".join(f"{count} {kind}" for kind, count in other.items())
        raise InputError(
            f"the mesh contains {listed} cells; only hexahedra, wedges and tetrahedra with nodes at their corners alone are "
            "supported; mesh the body with them, of first order."
        )
    if not any(counts.get(kind) for kind in SOLIDS):
        listed = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count) or "no elements"
        raise InputError(
            f"the mesh contains no hexahedra and no tetrahedra ({listed}); save the elements of its volume too. A closed "
            "surface is meshed by `explicitfe new model --mesh SURFACE --size MM`."
        )


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
        cells = np.full((solid.sum(), 8), -1)
        for row, (_, nodes) in zip(cells, (cell for cell in self.cells if cell[0] in SOLIDS), strict=True):
            row[: len(nodes)] = nodes
        mesh = FileMesh(np.concatenate(self.points), cells, labels=np.array(self.labels, dtype=np.int64))
        nodes_named, cells_named = (self._shared[what] | self._sets[what] for what in ("node", "cell"))
        for name, members in cells_named.items():
            mesh.element_sets[name] = number[[cell for cell in members if solid[cell]]]
            mesh.node_sets[name] = np.unique([node for cell in members for node in self.cells[cell][1]]).astype(np.int64)
        mesh.node_sets |= {name: np.unique(nodes).astype(np.int64) for name, nodes in nodes_named.items()}
        mesh.element_sets = {name: np.unique(cells) for name, cells in mesh.element_sets.items() if len(cells)}
        return mesh
