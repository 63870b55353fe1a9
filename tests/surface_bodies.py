"""Bodies that tests of contact between deformable surfaces share, and what their contact passes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.solve.simulation import Simulation


def moved(mesh: HexMesh, shift_m: tuple[float, float, float]) -> HexMesh:
    return replace(mesh, points=mesh.points + np.array(shift_m), named_points={})


def graded(fine_m: float, reach_m: float, largest_m: float, size_m: float, growth: float = 1.3) -> np.ndarray:
    """Stations from 0: equal up to a reach, then each longer than the one before by a ratio, up to a largest length."""
    stations = list(np.linspace(0.0, reach_m, round(reach_m / fine_m) + 1))
    length = fine_m
    while stations[-1] < size_m:
        length = min(largest_m, growth * length)
        stations.append(stations[-1] + length)
    x = np.array(stations)
    beyond = x > reach_m * (1.0 + 1e-9)
    x[beyond] = reach_m + (x[beyond] - reach_m) * (size_m - reach_m) / (x[-1] - reach_m)
    return x


def half_cylinder(x_m: np.ndarray, depth_m: np.ndarray, thickness_m: float, radius_m: float, *, lower: bool) -> HexMesh:
    """Half of a block, one element thick along y, whose face at z = 0 is the parabola of a cylinder; its axis is at x = 0."""
    mesh = box((len(x_m) - 1, 1, len(depth_m) - 1), (1.0, thickness_m, 1.0))
    x = x_m[np.rint(mesh.points[:, 0] * (len(x_m) - 1)).astype(int)]
    layer = np.rint(mesh.points[:, 2] * (len(depth_m) - 1)).astype(int)
    depth = depth_m[len(depth_m) - 1 - layer] if lower else depth_m[layer]
    away = depth + x**2 / (2.0 * radius_m) * (1.0 - depth / depth_m[-1])
    return replace(mesh, points=np.column_stack([x, mesh.points[:, 1], -away if lower else away]), named_points={})


def pushes(body: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Points that touch a face now: where they are (k, 3) m, and the elastic force on each (k,) N; either side has half."""
    surfaces, count = body.surfaces, int(body.surfaces.touches[0])
    point = surfaces.touching[:count]
    corners = surfaces.place[surfaces.face[surfaces.point_face[point]]]
    return np.einsum("qc,qcx->qx", surfaces.share[point], corners), push_N(body)


def push_N(body: Simulation) -> np.ndarray:
    """Elastic force on each point that touches a face now, (k,)."""
    surfaces, count = body.surfaces, int(body.surfaces.touches[0])
    spring, doubled_m, _ = surfaces.stiff[:count].T
    depth = surfaces.out[:count, 3]
    return spring * depth * (1.0 + depth / doubled_m)
