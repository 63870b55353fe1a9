"""Closed triangle surfaces, and their checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from explicitfe.fem.mesh.triangles import triangle_distance
from explicitfe.platform.errors import InputError

# The extent of a bone compared to that of the body: beyond these it was given in another unit of length.
_LARGEST_EXTENT_SHARE = 30.0
_SMALLEST_EXTENT_SHARE = 0.01
# A triangle whose area is a smaller share of the extent squared is none: it has no normal.
_SMALLEST_AREA_SHARE = 1e-14


@dataclass(frozen=True)
class TriangleSurface:
    """The surface of a bone.

    Attributes
    ----------
    points : (n, 3) m.
    triangles : (m, 3) int64. Corners, counter-clockwise seen from outside the bone.
    """

    points: np.ndarray
    triangles: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        """Corners of the triangles, (m, 3 corners, 3) m."""
        return self.points[self.triangles]

    @property
    def volume_m3(self) -> float:
        """Volume inside, by the divergence theorem; negative if the surface is inside out."""
        a, b, c = np.moveaxis(self.corners - self.points.mean(axis=0), 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @cached_property
    def box_m(self) -> np.ndarray:
        """Lowest and highest corner of the bounding box of the triangles, (2, 3) m."""
        corners = self.corners.reshape(-1, 3)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])


def shifted(surface: TriangleSurface, shift_m: np.ndarray) -> TriangleSurface:
    """The same surface somewhere else."""
    return TriangleSurface(surface.points + np.asarray(shift_m, dtype=float), surface.triangles)


def depth_inside(surface: TriangleSurface, points: np.ndarray) -> np.ndarray:
    """How deep points (k, 3) m lie inside a closed surface, (k,) m; 0 outside.

    A point is inside if more triangles above it face up than down.
    """
    depth = np.zeros(len(points))
    corners = surface.corners
    low, high = corners.min(axis=1), corners.max(axis=1)
    for k in np.flatnonzero(((points > surface.box_m[0]) & (points < surface.box_m[1])).all(axis=1)):
        point = points[k]
        above = (low[:, :2] <= point[:2]).all(axis=1) & (high[:, :2] >= point[:2]).all(axis=1) & (high[:, 2] > point[2])
        if _winding(corners[above], point) > 0:
            reach = np.sqrt(((corners[:, 0] - point) ** 2).sum(axis=1).min())
            near = corners[((low <= point + reach) & (high >= point - reach)).all(axis=1)]
            depth[k] = triangle_distance(np.broadcast_to(point, near[:, 0].shape), near).min()
    return depth


def _winding(corners: np.ndarray, point: np.ndarray) -> int:
    """How many triangles (m, 3, 3) above a point (3,) face up, less those that face down.

    A point above an edge or a corner counts for one of the triangles there, whose common edge is computed alike.
    """
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    ends = np.stack([corners, np.roll(corners, -1, axis=1)])
    rises = ends[0, :, :, 1] < ends[1, :, :, 1]
    first, last = np.where(rises[..., None], ends[0], ends[1]), np.where(rises[..., None], ends[1], ends[0])
    passed = (first[..., 1] <= point[1]) & (last[..., 1] > point[1])
    share = (point[1] - first[..., 1]) / np.where(passed, last[..., 1] - first[..., 1], 1.0)
    left = passed & (point[0] < first[..., 0] + share * (last[..., 0] - first[..., 0]))
    inside = left.sum(axis=1) % 2 == 1
    side = np.einsum("ij,ij->i", corners[:, 0] - point, normal)  # its sign is that of the normal where the triangle is above
    return int(np.sum(np.sign(normal[inside & (side * normal[:, 2] > 0.0), 2])))


def in_mm(point_m: np.ndarray) -> str:
    """'(57.8, 0.0, 97.1) mm', for a sentence."""
    return "(" + ", ".join(f"{1e3 * value + 0.0:.1f}" for value in point_m) + ") mm"


def check_surface(surface: TriangleSurface, what: str, body_points: np.ndarray | None = None) -> None:
    """Refuse a surface that is no solid body, or of another size than the body that is to rest on it.

    Parameters
    ----------
    what : names the surface in the message: 'bone "palate" (palate.stl)'.
    body_points : (n, 3) m. Points of the body at rest; without them the size is not judged.

    Raises
    ------
    InputError
        No triangles; points that are not finite; a triangle without area; edges that are not shared by two triangles;
        neighbours that face opposite ways; inside out; an extent more than thirty times that of the body, or less than
        a hundredth of it.
    """
    if not len(surface.triangles):
        raise InputError(f"{what}: contains no triangles; export it as a closed triangle surface.")
    if not np.isfinite(surface.points).all():
        raise InputError(f"{what}: point {np.flatnonzero(~np.isfinite(surface.points).all(axis=1))[0]} is not a finite number.")
    extent = float(np.linalg.norm(np.diff(surface.box_m, axis=0)))
    if body_points is not None:
        _check_size(extent, what, body_points)
    a, b, c = np.moveaxis(surface.corners, 1, 0)
    flat = np.flatnonzero(np.linalg.norm(np.cross(b - a, c - a), axis=1) <= _SMALLEST_AREA_SHARE * extent * extent)
    if len(flat):
        raise InputError(f"{what}: {len(flat)} triangles have no area, one at {in_mm(a[flat[0]])}; remove them from the surface.")
    _check_edges(surface, what)
    if surface.volume_m3 <= 0.0:
        raise InputError(f"{what}: is inside out: its normals point into the bone; reverse the corner order of all triangles.")


def _length(metres: float) -> str:
    millimetres = 1e3 * metres
    return f"{millimetres:.0f} mm" if millimetres >= 1.0 else f"{millimetres:.2g} mm"


def _check_size(extent: float, what: str, body_points: np.ndarray) -> None:
    body = float(np.linalg.norm(np.ptp(body_points, axis=0)))
    for wrong, size in ((extent > _LARGEST_EXTENT_SHARE * body, "large"), (extent < _SMALLEST_EXTENT_SHARE * body, "small")):
        if wrong:
            raise InputError(
                f"{what}: is far too {size}, {_length(extent)} along its diagonal, for a body of {_length(body)}; "
                "check length_unit."
            )


def _check_edges(surface: TriangleSurface, what: str) -> None:
    """Every edge belongs to two triangles, which run along it in opposite directions."""
    directed = np.concatenate([surface.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    edges, number, shared = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    open_edges = np.flatnonzero(shared != 2)
    if len(open_edges):
        place = surface.points[edges[open_edges[0]]].mean(axis=0)
        raise InputError(
            f"{what}: is not closed: {len(open_edges)} edges do not belong to exactly two triangles, one at {in_mm(place)}; "
            "fill the hole, merge the corners of neighbouring triangles, or thicken the sheet to a closed surface."
        )
    turn = np.bincount(number.ravel(), weights=np.where(directed[:, 0] < directed[:, 1], 1.0, -1.0))
    twisted = np.flatnonzero(turn != 0.0)
    if len(twisted):
        place = surface.points[edges[twisted[0]]].mean(axis=0)
        raise InputError(
            f"{what}: neighbouring triangles have opposite normals at {len(twisted)} edges, one at {in_mm(place)}; "
            "make the normals consistent in the program that made the surface."
        )
