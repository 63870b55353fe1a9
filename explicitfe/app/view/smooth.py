"""A smooth surface for display: the skin of a mesh, subdivided by the rules of Catmull and Clark (1978).

Places and values of the drawn points are linear in those of the nodes. The matrices are computed once, and hold for every sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import Self

import numpy as np
import scipy

# A tongue is round where its elements are large; a specimen has edges where faces meet at more than this angle at rest.
SHARP_EDGE_DEG = 40.0


@dataclass(frozen=True, eq=False)
class SmoothSurface:
    """A subdivided surface.

    Attributes
    ----------
    quads : (f, 4) points of each face, counter-clockwise seen from outside; a triangle repeats a point.
    face : (f,) number of the face of the mesh that each is a part of.
    group : (f,) of each face. Faces of a higher group end at those of a lower one and do not change their shape: a cut face is 1,
        the skin 0.
    lines : (l, 2) pieces of the edges of the mesh, drawn on the surface.
    sharp : (s, 2) pieces of the edges that stay sharp.
    steps : matrices that lead from the nodes to the points, the first of them to be applied first.
    """

    quads: np.ndarray
    face: np.ndarray
    group: np.ndarray
    lines: np.ndarray
    sharp: np.ndarray
    steps: tuple[scipy.sparse.csr_array, ...]

    @classmethod
    def of(
        cls, points: np.ndarray, quads: np.ndarray, group: np.ndarray | None = None, *, levels: int, round_edges: bool
    ) -> Self:
        """Subdivide the faces of a mesh.

        Subdivision alone rounds off what is convex, by about a sixth of the square of an element's size times the curvature.
        Therefore the nodes are first moved outwards by as much as subdivision would move them inwards.

        Parameters
        ----------
        points : (n, 3) m, at rest.
        quads, group : as the attributes, by nodes; one group if left out.
        levels : how often each face is divided in four.
        round_edges : whether edges of any angle become round.
        """
        group = np.zeros(len(quads), dtype=np.int64) if group is None else group
        edges = _Edges.of(quads, group)
        sharp = edges.ends[:0] if round_edges else edges.ends[_angle_deg(points, quads, edges) > SHARP_EDGE_DEG]
        same = scipy.sparse.eye_array(len(points), format="csr")
        fine = cls(quads, np.arange(len(quads)), group, edges.ends, sharp, (same,))
        for _ in range(levels):
            fine = fine._next_level()
        outwards = (2.0 * same - fine.matrix[: len(points)]).tocsr()
        return replace(fine, steps=(outwards, *fine.steps[1:]))

    @property
    def matrix(self) -> scipy.sparse.csr_array:
        """(p, n): from values of the nodes to those of the points; each row has the sum 1."""
        return reduce(lambda before, step: step @ before, self.steps)

    def _next_level(self) -> Self:
        """Each face divided in as many as it has corners; the points keep their numbers, and those of edges and faces follow."""
        count = self.steps[-1].shape[0]
        edges = _Edges.of(self.quads, self.group)
        faces, ends = len(self.quads), edges.ends
        size = np.bincount(edges.face, minlength=faces)
        to_face = _rows(edges.face, edges.corner, 1.0 / size[edges.face], (faces, count))
        # The middle of an edge, or, where two faces meet smoothly, the mean of its ends and of the middles of the faces.
        keys = edges.keys(count)
        smooth = (edges.faces_of_edge == 2) & ~np.isin(keys, np.sort(self.sharp, axis=1) @ [count, 1])
        middle = _rows(np.repeat(np.arange(len(ends)), 2), ends.ravel(), 0.5, (len(ends), count))
        counted = edges.counted & smooth[edges.edge]
        across = _rows(edges.edge[counted], edges.face[counted], 0.5, (len(ends), faces)) @ to_face
        to_edge = _row_times(middle, np.where(smooth, 0.5, 1.0)) + 0.5 * across
        to_point = self._point_rule(edges, smooth, to_face, middle, count)
        at_edge, at_face = count + edges.edge, count + len(ends) + edges.face
        quads = np.stack([edges.corner, at_edge, at_face, at_edge[edges.before]], axis=-1)

        def halves(lines: np.ndarray) -> np.ndarray:
            at = count + np.searchsorted(keys, np.sort(lines, axis=1) @ [count, 1])
            return np.concatenate([np.column_stack([lines[:, 0], at]), np.column_stack([at, lines[:, 1]])])

        step = scipy.sparse.vstack([to_point, to_edge, to_face], format="csr")
        face, group = self.face[edges.face], self.group[edges.face]
        return replace(
            self,
            quads=quads,
            face=face,
            group=group,
            lines=halves(self.lines),
            sharp=halves(self.sharp),
            steps=(*self.steps, step),
        )

    def _point_rule(
        self,
        edges: _Edges,
        smooth: np.ndarray,
        to_face: scipy.sparse.csr_array,
        middle: scipy.sparse.csr_array,
        count: int,
    ) -> scipy.sparse.csr_array:
        """New places of the points: (Q + 2 R + (n - 3) P) / n on smooth skin, (A + 6 P + B) / 8 on a sharp edge from A to B.

        Q is the mean of the middles of the n faces at P, R that of the middles of its edges. A point
        stays where more than two sharp edges meet, and where no face is.
        """
        lowest = np.full(count, self.group.max(initial=0) + 1)
        np.minimum.at(lowest, edges.corner, self.group[edges.face])
        own = self.group[edges.face] == lowest[edges.corner]
        around = _rows(edges.corner[own], edges.face[own], 1.0, (count, len(self.quads)))
        faces_at = np.bincount(edges.corner[own], minlength=count)
        edge, end = np.repeat(np.arange(len(edges.ends)), 2), edges.ends.ravel()
        own = edges.group[edge] == lowest[end]
        spokes = _rows(end[own], edge[own], 1.0, (count, len(edges.ends)))
        edges_at = np.bincount(end[own], minlength=count)
        own &= ~smooth[edge]
        creases = _rows(end[own], edge[own], 1.0, (count, len(edges.ends)))
        creases_at = np.bincount(end[own], minlength=count)
        is_smooth, is_crease = (faces_at > 2) & (creases_at < 2), creases_at == 2
        share = np.where(is_smooth, 1.0 / np.maximum(faces_at, 1), 0.0)
        stays = np.where(is_smooth, (faces_at - 3.0) * share, np.where(is_crease, 0.5, 1.0))
        return (
            _row_times(around @ to_face, share / np.maximum(faces_at, 1))
            + _row_times(spokes @ middle, 2.0 * share / np.maximum(edges_at, 1))
            + _row_times(creases @ middle, np.where(is_crease, 0.25, 0.0))
            + scipy.sparse.diags_array(stays)
        ).tocsr()


@dataclass(frozen=True, eq=False)
class _Edges:
    """Corners of faces, and the edges between them.

    Attributes
    ----------
    face, corner, edge, before : (c,) of each corner of a face: the face, the point, the edge to the next corner of the face, and
        the number of the corner before it in this list.
    ends : (e, 2) points of each edge, the lower number first.
    group, faces_of_edge : (e,) the lowest group of the faces at an edge, and the number of its faces in that group.
    counted : (c,) whether the face of a corner is one of those at its edge.
    """

    face: np.ndarray
    corner: np.ndarray
    edge: np.ndarray
    before: np.ndarray
    ends: np.ndarray
    group: np.ndarray
    faces_of_edge: np.ndarray
    counted: np.ndarray

    @classmethod
    def of(cls, quads: np.ndarray, group: np.ndarray) -> Self:
        """Of faces with four corners, of which neighbours may coincide."""
        distinct = quads != np.roll(quads, -1, axis=1)
        distinct[distinct.sum(axis=1) < 3] = False
        face, place = np.nonzero(distinct)
        corner, number = quads[face, place], np.arange(len(face))
        size = np.bincount(face, minlength=len(quads))
        first = (np.cumsum(size) - size)[face]
        after = np.where(number + 1 < first + size[face], number + 1, first)
        before = np.empty_like(number)
        before[after] = number
        ends, edge = np.unique(np.sort(np.column_stack([corner, corner[after]]), axis=1), axis=0, return_inverse=True)
        edge = edge.ravel()
        lowest = np.full(len(ends), group.max(initial=0) + 1)
        np.minimum.at(lowest, edge, group[face])
        counted = group[face] == lowest[edge]
        return cls(face, corner, edge, before, ends, lowest, np.bincount(edge[counted], minlength=len(ends)), counted)

    def keys(self, count: int) -> np.ndarray:
        """A number for each edge, rising."""
        keys: np.ndarray = self.ends @ [count, 1]
        return keys


def _angle_deg(points: np.ndarray, quads: np.ndarray, edges: _Edges) -> np.ndarray:
    """(e,) angle between the normals of the two faces at each edge, degrees; 0 at an edge with another number of faces."""
    normal = np.cross(points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    order = np.flatnonzero(edges.counted)
    order = order[np.argsort(edges.edge[order], kind="stable")]
    two = edges.faces_of_edge == 2
    pair = edges.face[order[two[edges.edge[order]]]].reshape(-1, 2)
    angle = np.zeros(len(edges.ends))
    angle[two] = np.degrees(np.arccos(np.clip(np.sum(normal[pair[:, 0]] * normal[pair[:, 1]], axis=1), -1.0, 1.0)))
    return angle


def _rows(row: np.ndarray, column: np.ndarray, value: np.ndarray | float, shape: tuple[int, int]) -> scipy.sparse.csr_array:
    return scipy.sparse.csr_array((np.broadcast_to(value, row.shape).astype(float), (row, column)), shape=shape)


def _row_times(matrix: scipy.sparse.csr_array, factor: np.ndarray) -> scipy.sparse.csr_array:
    """Each row times its factor."""
    return scipy.sparse.diags_array(factor) @ matrix
