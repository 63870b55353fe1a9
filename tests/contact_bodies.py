"""Bones and bodies that tests of contact share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from explicitfe.fem.bones.distance import DistanceField, distance_field
from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.materials.law import Law
from explicitfe.fem.mesh.box import box, grid_hexes
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.model import Bone


def box_surface(low_m: Sequence[float], high_m: Sequence[float], rotation: np.ndarray | None = None) -> TriangleSurface:
    """A box with these lowest and highest corners, then turned about the origin."""
    low, high = np.asarray(low_m, dtype=float), np.asarray(high_m, dtype=float)
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    points = (low + corners * (high - low)) @ (np.eye(3) if rotation is None else rotation).T
    return TriangleSurface(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int64))


def plate(*, motion: RigidMotion | None = None, friction: float = 0.0, rotation: np.ndarray | None = None) -> Bone:
    """A plate of 100 x 100 x 10 mm whose upper face is z = 0, turned about the origin, by the distance of its triangles."""
    surface = box_surface((-0.05, -0.05, -0.01), (0.05, 0.05, 0.0), rotation)
    reach = np.array([[-0.03, -0.03, -0.02], [0.03, 0.03, 0.03]])
    return Bone("plate", distance_field(surface, region=reach), surface, motion, friction)


def rigid_ball(radius_m: float, centre_m: Sequence[float], *, spacing_m: float, region: np.ndarray, motion: RigidMotion) -> Bone:
    """A ball by its exact distance at the nodes of a grid; for pictures it has a box."""
    low, high = np.floor(region / spacing_m).astype(int)
    axes = [spacing_m * np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    centre = np.asarray(centre_m, dtype=float)
    values = np.linalg.norm(grid - centre, axis=-1) - radius_m
    field = DistanceField(spacing_m * low.astype(float), spacing_m, values)
    return Bone("ball", field, box_surface(centre - radius_m, centre + radius_m), motion)


def shift(by_m: Sequence[float], time_s: Sequence[float], course: Sequence[float]) -> RigidMotion:
    """A bone that shifts without turning."""
    return RigidMotion(np.zeros(3), np.zeros(3), np.array(by_m, dtype=float), np.array(time_s), np.array(course))


def round_body(cells: int, radius_m: float) -> HexMesh:
    """A cube of cells**3 elements pulled four fifths of the way to a ball: at the whole, elements at its edges would be flat."""
    mesh = box((cells, cells, cells), (2.0, 2.0, 2.0))
    points = mesh.points - 1.0
    length = np.linalg.norm(points, axis=1)
    onto_ball = np.divide(np.abs(points).max(axis=1), length, out=np.ones_like(length), where=length > 0.0)
    return replace(mesh, points=radius_m * points * (0.8 * onto_ball + 0.2)[:, None])


def stations(fine_m: float, fine_to_m: float, to_m: float, growth: float) -> np.ndarray:
    """Stations from 0, even at first, then growing."""
    x = list(np.arange(0.0, fine_to_m + 0.5 * fine_m, fine_m))
    while x[-1] < to_m:
        x.append(x[-1] + (x[-1] - x[-2]) * growth)
    return np.array(x)


def half_space(
    x: np.ndarray, law: Law, radius_m: float = np.inf, *, above: bool = False
) -> tuple[HexMesh, np.ndarray, np.ndarray]:
    """A quarter of a half space below or above z = 0, its far nodes, and their displacement by a point load of 1 N.

    Its surface is a paraboloid with this radius of curvature (Boussinesq 1885; Johnson 1985, eq. 3.18).
    """
    side, nu = 1.0 if above else -1.0, law.poisson
    points = np.stack(np.meshgrid(x, x, x if above else -x[::-1], indexing="ij"), axis=-1).reshape(-1, 3)
    far = np.flatnonzero((np.abs(points) == x[-1]).any(axis=1))
    r, depth = np.linalg.norm(points[far], axis=1), np.abs(points[far, 2])
    per_N = 1.0 / (4.0 * np.pi * law.shear_modulus_Pa)
    outwards = per_N * (depth / r**3 - (1.0 - 2.0 * nu) / (r * (r + depth)))
    inwards = per_N * (depth**2 / r**3 + 2.0 * (1.0 - nu) / r)
    gap = (points[:, 0] ** 2 + points[:, 1] ** 2) / (2.0 * radius_m) * (1.0 - np.abs(points[:, 2]) / x[-1])
    mesh = HexMesh(points + np.outer(gap, [0.0, 0.0, side]), grid_hexes(np.arange(len(points)).reshape(3 * (len(x),))))
    return mesh, far, np.column_stack([outwards[:, None] * points[far, :2], side * inwards])
