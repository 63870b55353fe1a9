"""Connectivity of a mesh: parts, joints, coincident nodes, and overlapping elements.

A mesh can be fit for computing (``quality.check``) and still not be the body that its maker meant: nodes that were not merged, a
part that floats beside the others, lengths in another unit. Nothing here is an error of itself; who runs a mesh tells its user.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, face_groups
from explicitfe.fem.mesh.quality import edge_lengths
from explicitfe.fem.mesh.self_contact import middles_in_elements, self_penetration
from explicitfe.platform.host.stored import store_answers

# Nodes nearer to each other than this share of the shortest edge lie at one place: far above what a file rounds to.
_ONE_PLACE_SHARE = 1e-2
# Bodies that lie in each other by less than this share of the shortest edge only touch.
_OVERLAP_SHARE = 1e-2


@dataclass(frozen=True)
class Soundness:
    """What a mesh is as a body.

    Attributes
    ----------
    part : (m,) number of the part that each element belongs to, from 0; elements of different parts have no node in common.
    piece : (m,) the same for pieces that faces join: a part of several pieces has joints at edges or single nodes.
    same_place : (k, 2) pairs of nodes that lie at one place.
    overlapping : (j,) elements whose middle lies in another element, or that a node of another part of the surface lies in.
    extent_m : the longest side of the box around it [m].
    """

    part: np.ndarray
    piece: np.ndarray
    same_place: np.ndarray
    overlapping: np.ndarray
    extent_m: float

    @property
    def part_count(self) -> int:
        return int(self.part.max()) + 1

    @property
    def piece_count(self) -> int:
        return int(self.piece.max()) + 1


@store_answers(Soundness, sources=("fem/mesh",))
def soundness(mesh: HexMesh, *, overlap: bool = True) -> Soundness:
    """What a mesh is as a body; about a second for 100 000 elements.

    ``overlap``: whether to look for elements in the place of others, which takes far longer where elements are thin.
    """
    edges = edge_lengths(mesh.points, mesh.hexes)
    shortest_m = float(edges[edges > 0.0].min())
    elements = np.repeat(np.arange(mesh.element_count), 8)
    first = mesh.hexes[:, :1].repeat(8, axis=1).ravel()
    size = mesh.node_count
    graph = scipy.sparse.coo_array((np.ones(len(elements), dtype=np.int8), (first, mesh.hexes.ravel())), shape=(size, size))
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    return Soundness(
        part=np.unique(label[mesh.hexes[:, 0]], return_inverse=True)[1].ravel(),
        piece=_pieces(mesh.hexes),
        same_place=scipy.spatial.cKDTree(mesh.points).query_pairs(_ONE_PLACE_SHARE * shortest_m, output_type="ndarray"),
        overlapping=_overlapping(mesh, shortest_m) if overlap else np.zeros(0, dtype=np.int64),
        extent_m=float(np.ptp(mesh.points, axis=0).max()),
    )


def _pieces(hexes: np.ndarray) -> np.ndarray:
    """The piece (m,) of each element; faces join the elements of a piece."""
    order, begins = face_groups(hexes)
    joined = np.delete(np.stack([order[:-1], order[1:]], axis=1), begins[1:] - 1, axis=0) // len(FACES)
    graph = scipy.sparse.coo_array(
        (np.ones(len(joined), dtype=np.int8), (joined[:, 0], joined[:, 1])), shape=(len(hexes), len(hexes))
    )
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def _overlapping(mesh: HexMesh, shortest_m: float) -> np.ndarray:
    """Elements (j,) that fill, in part, the same space as others."""
    filled = middles_in_elements(mesh)
    through = self_penetration(mesh, np.zeros_like(mesh.points))
    deep = through.elements if through.deepest_m > _OVERLAP_SHARE * shortest_m else filled[:0]
    return np.union1d(filled, deep)
