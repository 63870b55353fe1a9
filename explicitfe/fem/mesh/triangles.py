"""Triangles in space: distance of points, and intersection with a plane."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.platform.host.kept import kept


@kept(4)  # of a fine surface they take much memory
def corners_of(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Corners (m, 3 corners, 3) m of triangles (m, 3) of points (n, 3) m."""
    return points[triangles]


def triangle_distance(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance (k,) m of points (k, 3) m from one triangle each, (k, 3 corners, 3) m: from its plane or its edges."""
    squared = np.full(len(points), np.inf)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    above = np.ones(len(points), dtype=bool)
    for i in range(3):
        edge = corners[:, (i + 1) % 3] - corners[:, i]
        offset = points - corners[:, i]
        share = np.clip(np.einsum("ij,ij->i", offset, edge) / np.einsum("ij,ij->i", edge, edge), 0.0, 1.0)
        apart = offset - share[:, None] * edge
        squared = np.minimum(squared, np.einsum("ij,ij->i", apart, apart))
        above &= np.einsum("ij,ij->i", np.cross(normal, edge), offset) >= 0.0
    height = np.einsum("ij,ij->i", points - corners[:, 0], normal)
    plane = height * height / np.einsum("ij,ij->i", normal, normal)
    return np.sqrt(np.where(above, plane, squared))


def triangle_samples(corners: np.ndarray, spacing: float, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 3) on triangles (m, 3 corners, 3), a spacing apart or less, and the triangle (k,) of each.

    The centres of the triangles, halved across their longest edge until that is no longer than the spacing; none far outside of
    the box (2, 3).
    """
    triangle = np.arange(len(corners))
    points, owner = [np.zeros((0, 3))], [triangle[:0]]
    while len(triangle):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        small = edges.max(axis=1) <= spacing
        points.append(corners[small].mean(axis=1))
        owner.append(triangle[small])
        split = ~small & ((corners.max(axis=1) >= box[0]) & (corners.min(axis=1) <= box[1])).all(axis=1)
        corners, triangle, edges = corners[split], triangle[split], edges[split]
        order = (edges.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        triangle = np.tile(triangle, 2)
    return np.concatenate(points), np.concatenate(owner)


def surface_triangles(mesh: HexMesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The surface of a body whose nodes are at ``points`` (n, 3) m: corners of triangles (4 f, 3, 3) m, and its faces (f, 4).

    Each face is cut into four triangles around its middle, face after face: mirror images of faces so have mirror images of
    triangles. Normals point outwards.
    """
    element, face = free_faces(mesh.hexes)
    quads = mesh.hexes[element[:, None], FACES[face]]
    x = points[quads]
    middle = np.broadcast_to(x.mean(axis=1, keepdims=True), x.shape)
    return np.stack([x, np.roll(x, -1, axis=1), middle], axis=2).reshape(-1, 3, 3), quads


def plane_segments(corners: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Where the plane through ``point`` across ``normal`` cuts triangles (m, 3 corners, 3): segments (k, 2 ends, 3).

    A corner in the plane counts as before it, so a closed surface gives closed lines.
    """
    return segments_of_planes(corners, point[None], normal[None])[0]


def segments_of_planes(corners: np.ndarray, points: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """What :func:`plane_segments` gives for each of the planes through ``points`` (p, 3) across ``normals`` (p, 3)."""
    # Plane after plane: heights of all triangles over all planes would be many times the surface.
    heights, triangles = [], []
    for point, normal in zip(points, normals, strict=True):
        height = ((corners - point).reshape(-1, 3) @ normal).reshape(-1, 3)
        a, b, c = (height > 0.0).T
        cut = np.flatnonzero((a != b) | (b != c))
        heights.append(height[cut])
        triangles.append(cut)
    corners, height = corners[np.concatenate(triangles)], np.concatenate(heights)
    behind = height > 0.0
    # The corner that is alone on its side comes first: the plane cuts the two edges that meet there.
    alone = np.argmax(behind == (behind.sum(axis=1) == 1)[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(corners, order[:, :, None], axis=1)
    height = np.take_along_axis(height, order, axis=1)
    share = height[:, :1] / (height[:, :1] - height[:, 1:])
    segments = corners[:, :1] + share[:, :, None] * (corners[:, 1:] - corners[:, :1])
    return np.split(segments, np.cumsum([len(cut) for cut in triangles])[:-1])
