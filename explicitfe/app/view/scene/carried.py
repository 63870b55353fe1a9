"""Points that move with a mesh, such as those of a cut face: their places, and values of fields at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints, shape_functions

# Points nearer to a node than this share of the mesh are that node, but for rounding.
AT_NODE_SHARE = 1e-9


@dataclass(frozen=True)
class CarriedPoints:
    """Points (k) and the nodes that carry them.

    Attributes
    ----------
    reference : (k, 3) m, where they are in the reference shape.
    nodes, weights : (k, 8). The nodes of the element that holds each, and its shape functions there; all 0 for a point that is
        fixed in space.
    """

    reference: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, mesh: HexMesh, points: MaterialPoints) -> Self:
        """Material points, those fixed in space among them."""
        weights = np.where(points.element[:, None] < 0, 0.0, shape_functions(points.natural))
        return cls(points.position, mesh.hexes[np.maximum(points.element, 0)], weights)

    @classmethod
    def at(cls, mesh: HexMesh, places: np.ndarray) -> Self:
        """Whatever points of the mesh stand at ``places`` (k, 3) m in the reference shape."""
        from scipy.spatial import cKDTree

        from explicitfe.fem.mesh.muscle_lines import locate_in_mesh

        distance, node = cKDTree(mesh.points).query(places)
        nodes, weights = np.tile(node[:, None], 8), np.zeros((len(places), 8))
        weights[:, 0] = 1.0
        between = np.flatnonzero(distance > AT_NODE_SHARE * np.ptp(mesh.points, axis=0).max())
        if len(between):
            located = locate_in_mesh(mesh, places[between], tolerance=np.inf)
            nodes[between], weights[between] = mesh.hexes[located.element], shape_functions(located.natural)
        return cls(np.asarray(places, dtype=float), nodes, weights)

    def values(self, field: np.ndarray) -> np.ndarray:
        """A field of the nodes, (n, ...), at the points, (k, ...)."""
        return np.einsum("ka,ka...->k...", self.weights, field[self.nodes])

    def matrix(self, node_count: int) -> scipy.sparse.csr_array:
        """(k, node_count), which leads from a field of the nodes to :meth:`values`."""
        begin = np.arange(0, self.nodes.size + 1, self.nodes.shape[1])
        return scipy.sparse.csr_array((self.weights.ravel(), self.nodes.ravel(), begin), shape=(len(self.nodes), node_count))

    def places(self, displacement: np.ndarray) -> np.ndarray:
        """Places of the points, (k, 3) m, for displacements (n, 3) m of the nodes."""
        return self.reference + self.values(displacement)


def joined(parts: Sequence[CarriedPoints]) -> CarriedPoints:
    """The points of several one after the other."""
    columns = [(part.reference, part.nodes, part.weights) for part in parts]
    return CarriedPoints(*(np.concatenate(column) for column in zip(*columns, strict=True)))
