"""Plane cuts of the reference shape that move with the material, and measures on them.

A section is cut where the tissue is at rest. Later it shows where the tissue of that section went, not what else came into its
plane. The axes are x backwards, y to the speaker's right, z up.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.platform.host.kept import kept

X, Y, Z = 0, 1, 2
# Nodes nearer to a plane than this share of the extent across it lie in it.
IN_PLANE_SHARE = 1e-9
# The plane y = 0 is that of the middle where at least this share of the width lies on either side of it.
LEAST_SIDE_SHARE = 0.1
# Where coronal sections of a mesh without these named points are cut, as a share of its length from the tip.
STATION_SHARES = {"front": 0.4, "dorsum": 0.55, "back": 0.7}


@dataclass(frozen=True)
class PlaneCut:
    """Outline of a plane cut of the reference shape: points on edges of the surface, which move with them.

    Attributes
    ----------
    ends : (k, 2) int64. Nodes of the edge that each point lies on; twice the same where it is a node.
    share : (k,) Weight of the second node.
    loops : closed outlines as point numbers in order; the last joins the first.
    """

    ends: np.ndarray
    share: np.ndarray
    loops: tuple[np.ndarray, ...]

    def at(self, values: np.ndarray) -> np.ndarray:
        """Values of the nodes, (n, ...), interpolated at the points, (k, ...)."""
        share = self.share.reshape(-1, *[1] * (values.ndim - 1))
        return (1.0 - share) * values[self.ends[:, 0]] + share * values[self.ends[:, 1]]

    def outline(self, points: np.ndarray) -> np.ndarray:
        """All loops as one line, (j, 3): closed, with a row of NaN after each."""
        at = self.at(points)
        gap = np.full((1, points.shape[1]), np.nan)
        return np.concatenate([part for loop in self.loops for part in (at[loop], at[loop[:1]], gap)] or [gap])


@kept(32)
def section(mesh: HexMesh, axis: int, position: float) -> PlaneCut:
    """Cut the reference shape by the plane where coordinate ``axis`` is ``position`` (m)."""
    element, face = free_faces(mesh.hexes)
    return cut_surface(mesh.hexes[element[:, None], FACES[face]], mesh.points[:, axis] - position)


def cut_surface(faces: np.ndarray, distance: np.ndarray) -> PlaneCut:
    """Cut a closed surface of polygons (f, corners), nodes in cyclic order, by a plane at ``distance`` (n,) m from the nodes."""
    distance = np.where(np.abs(distance) < IN_PLANE_SHARE * np.ptp(distance), 0.0, distance)
    segments: list[tuple[tuple[int, int], tuple[int, int]]] = []
    # Nodes in the plane count as above it. A half model that ends in the plane has nothing below: then they count as below.
    for above in (distance >= 0.0, distance > 0.0):
        changes = above[faces] != above[np.roll(faces, -1, axis=1)]
        for polygon, change in zip(faces[changes.any(axis=1)], changes[changes.any(axis=1)], strict=True):
            cut = [_crossing(polygon[k], polygon[(k + 1) % len(polygon)], distance) for k in np.flatnonzero(change)]
            segments += [(a, b) for a, b in zip(cut[::2], cut[1::2], strict=True) if a != b]
        if segments:
            break
    edges = sorted({edge for segment in segments for edge in segment})
    number = {edge: k for k, edge in enumerate(edges)}
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2)
    low, high = distance[ends].T
    share = np.divide(low, low - high, out=np.zeros(len(ends)), where=low != high)
    return PlaneCut(ends, share, tuple(_loops([(number[a], number[b]) for a, b in segments])))


def midsagittal(mesh: HexMesh) -> PlaneCut:
    """The section in the plane of :func:`middle`."""
    return section(mesh, Y, middle(mesh))


def middle(mesh: HexMesh) -> float:
    """The y of the midsagittal plane, m: 0 where that is well inside the body, else halfway between its sides.

    A mesh of one's own may begin at y = 0: there is its side, and nothing to be cut.
    """
    low, high = float(mesh.points[:, Y].min()), float(mesh.points[:, Y].max())
    side = LEAST_SIDE_SHARE * (high - low)
    return 0.0 if low + side <= 0.0 <= high - side else 0.5 * (low + high)


def station(mesh: HexMesh, name: str) -> float:
    """The x of a coronal section, m: that of a named point, else by ``STATION_SHARES``."""
    if name in mesh.named_points:
        return float(mesh.named_points[name].position[0, X])
    x = mesh.points[:, X]
    return float(x.min() + STATION_SHARES[name] * np.ptp(x))


def midline(reference: np.ndarray) -> np.ndarray:
    """Numbers of the points of a coronal outline, (k, 3), nearest to its middle, from the lowest to the highest."""
    away = np.abs(reference[:, Y] - 0.5 * (reference[:, Y].min() + reference[:, Y].max()))
    nearest = np.flatnonzero(away < away.min() + 1e-6 * away.max())
    return nearest[np.argsort(reference[nearest, Z])]


def groove_depth(reference: np.ndarray, now: np.ndarray) -> float:
    """Depth of the midline of a coronal outline below the lower of the highest points of its sides, m; 0: no groove.

    Parameters
    ----------
    reference, now : (k, 3) m. Points of one outline in the reference shape, which says what is middle, left, right and
        above, and where they are now.
    """
    y = reference[:, Y] - 0.5 * (reference[:, Y].min() + reference[:, Y].max())
    top = midline(reference)[-1]
    # Only points of the upper half count: in a strong twist a lower corner could come up.
    upper = reference[:, Z] > 0.5 * (reference[:, Z].min() + reference[:, Z].max())
    sides = [now[upper & side, Z].max(initial=-np.inf) for side in (y < 0.0, y > 0.0)]
    return max(0.0, float(min(sides) - now[top, Z]))


def _crossing(a: int, b: int, distance: np.ndarray) -> tuple[int, int]:
    """Name of the point where an edge crosses the plane: both faces at the edge give it the same name, as all edges at a node do
    that lies in the plane.
    """
    if distance[a] == 0.0:
        return int(a), int(a)
    if distance[b] == 0.0:
        return int(b), int(b)
    return int(min(a, b)), int(max(a, b))


def _loops(segments: Sequence[tuple[int, int]]) -> Iterator[np.ndarray]:
    """Join segments to closed loops."""
    at = defaultdict(set)
    for k, (a, b) in enumerate(segments):
        at[a].add(k)
        at[b].add(k)
    unused = set(range(len(segments)))
    while unused:
        first = min(unused)
        start, point = segments[first]
        loop, segment = [start], first
        while True:
            unused.discard(segment)
            at[segments[segment][0]].discard(segment)
            at[segments[segment][1]].discard(segment)
            if point == start or not at[point]:
                break
            loop.append(point)
            segment = min(at[point])
            a, b = segments[segment]
            point = b if a == point else a
        if len(loop) > 2:
            yield np.array(loop)
