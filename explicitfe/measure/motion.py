"""How far and how fast the body and its named points have moved."""

from __future__ import annotations

import numpy as np
import scipy

from explicitfe.host.kept import kept
from explicitfe.measure.document import BodyMotion, MaterialPlace, PointMotion, SelfPenetrationFigures
from explicitfe.measure.sections import X, Y, Z, middle
from explicitfe.mesh.hexmesh import HexMesh
from explicitfe.mesh.quality import volumes
from explicitfe.mesh.self_contact import self_penetration
from explicitfe.results import Recorded

RISE_SHARE = 0.9
# A displacement below this is none: a time until it is reached would be that of rounding.
SMALLEST_MOTION_M = 1e-6
# A body has settled when no node would move by more than this share of the largest displacement in so long at its present speed.
SETTLED_SHARE, SETTLED_WITHIN_S = 0.05, 0.1
# Nodes are mirror images of each other up to this share of the mesh's extent.
MIRROR_SHARE_OF_EXTENT = 1e-6


def point_motions(result: Recorded, step: int) -> dict[str, PointMotion]:
    """The named points that the run recorded, in the order of its model; of others the samples are read."""
    motions = {}
    for name in result.model.get("probes", result.mesh.named_points):
        times, path, velocity = _course(result, name, step)
        speeds = np.linalg.norm(velocity, axis=1)
        right, up = 1e3 * path[-1, [Y, Z]]
        motions[name] = PointMotion(
            forward_mm=unsigned_zero(-1e3 * path[-1, X]),
            up_mm=unsigned_zero(up),
            right_mm=unsigned_zero(right),
            time_to_90_ms=_in_ms(rise_time(times, path)),
            peak_speed_mm_s=1e3 * float(speeds.max()),
            speed_mm_s=1e3 * float(speeds[-1]),
        )
    return motions


def body_motion(result: Recorded, step: int) -> BodyMotion:
    """The whole body."""
    mesh, u = result.mesh, result.displacement(step)
    largest = float(np.linalg.norm(u, axis=1).max())
    fastest = float(np.linalg.norm(_velocity(result, step), axis=1).max())
    rest_m3, now_m3 = float(_rest_volumes(mesh).sum()), float(volumes(mesh.points + u, mesh.hexes).sum())
    passed = self_penetration(mesh, u)
    difference = left_right_difference(mesh, u)
    return BodyMotion(
        largest_displacement_mm=1e3 * largest,
        fastest_mm_s=1e3 * fastest,
        settled=has_settled(fastest, largest),
        time_to_90_ms=_in_ms(_body_rise_time(result, step)),
        volume_change_percent=100.0 * (now_m3 / rest_m3 - 1.0),
        left_right_mm=None if difference is None else 1e3 * difference,
        self_penetration=SelfPenetrationFigures(
            nodes=passed.count,
            deepest_mm=1e3 * passed.deepest_m,
            deepest_at_rest=None if passed.where_m is None else _place(passed.where_m),
        ),
    )


def has_settled(fastest_m_s: float, largest_m: float) -> bool:
    """Whether no node would move by 5 % of the largest displacement in another 100 ms at the speed of the fastest."""
    return SETTLED_WITHIN_S * fastest_m_s <= SETTLED_SHARE * largest_m


def rise_time(times: np.ndarray, path: np.ndarray) -> float | None:
    """When a displacement (t, 3), m, first comes to 90 % of its last value, along it, s after the first of ``times`` (t,).

    Between samples it is interpolated. None where it ends within a micrometre of where it began.
    """
    end = path[-1]
    if not np.linalg.norm(end) > SMALLEST_MOTION_M:
        return None
    return _first_crossing(times, path @ end / (end @ end))


def left_right_difference(mesh: HexMesh, displacement: np.ndarray) -> float | None:
    """Largest |u(mirror image) - mirror image of u| of all nodes, m; None where the mesh is not its own mirror image."""
    partner = _mirror_images(mesh)
    if partner is None:
        return None
    return float(np.linalg.norm(displacement[partner] - displacement * [1.0, -1.0, 1.0], axis=1).max())


@kept(8)
def _mirror_images(mesh: HexMesh) -> np.ndarray | None:
    """The node (n,) that is the mirror image of each; None where the mesh is not its own mirror image."""
    mirrored = mesh.points.copy()
    mirrored[:, Y] = 2.0 * middle(mesh) - mirrored[:, Y]
    distance, partner = scipy.spatial.cKDTree(mesh.points).query(mirrored)
    return None if distance.max() > MIRROR_SHARE_OF_EXTENT * np.ptp(mesh.points, axis=0).max() else partner


@kept(8)
def _rest_volumes(mesh: HexMesh) -> np.ndarray:
    return volumes(mesh.points, mesh.hexes)


def unsigned_zero(value: float) -> float:
    """The same number, with 0 for -0."""
    return float(value) + 0.0


def _course(result: Recorded, name: str, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (t,), displacement (t, 3) and velocity (t, 3) of a point up to a step."""
    if f"probe_{name}_displacement" in result.history_names:
        times, path = result.history("time"), result.history(f"probe_{name}_displacement")
    else:
        times, path = result.times, result.probe(name)
    rows = max(1, int(np.searchsorted(times, result.times[step], side="right")))
    if f"probe_{name}_velocity" in result.history_names:
        velocity = result.history(f"probe_{name}_velocity")[:rows]
    elif rows > 1:
        velocity = np.gradient(path[:rows], times[:rows], axis=0)
    else:
        velocity = np.zeros((1, 3))
    return times[:rows], path[:rows], velocity


def _velocity(result: Recorded, step: int) -> np.ndarray:
    """Velocity of the nodes (n, 3) m/s: as stored, else the mean since the sample before."""
    if "velocity" in result.fields:
        return result.field("velocity", step)
    if step == 0:
        return np.zeros_like(result.mesh.points)
    return (result.displacement(step) - result.displacement(step - 1)) / (result.times[step] - result.times[step - 1])


def _body_rise_time(result: Recorded, step: int) -> float | None:
    """The same as ``rise_time`` for the displacement field, each node weighted by its share of the volume."""
    mesh = result.mesh
    shares = np.repeat(_rest_volumes(mesh) / 8.0, 8)
    weights = np.bincount(mesh.hexes.ravel(), shares, mesh.node_count) / shares.sum()
    towards = weights[:, None] * result.displacement(step)
    size = float(np.sum(towards * result.displacement(step)))
    if not np.sqrt(size) > SMALLEST_MOTION_M:
        return None
    reached: list[float] = []
    for number in range(step + 1):
        reached.append(float(np.sum(towards * result.displacement(number))) / size)
        if reached[-1] >= RISE_SHARE:
            break
    return _first_crossing(result.times[: len(reached)], np.array(reached))


def _first_crossing(times: np.ndarray, share: np.ndarray) -> float:
    """When ``share``, which ends at 1 or where it first passes 90 %, first passes 90 %, s after the first time."""
    after = int(np.argmax(share >= RISE_SHARE))
    if after == 0:
        return 0.0
    part = (RISE_SHARE - share[after - 1]) / (share[after] - share[after - 1])
    return float(times[after - 1] + part * (times[after] - times[after - 1]) - times[0])


def _in_ms(seconds: float | None) -> float | None:
    return None if seconds is None else 1e3 * seconds


def _place(position_m: np.ndarray) -> MaterialPlace:
    back, right, up = 1e3 * position_m
    return MaterialPlace(back_mm=unsigned_zero(back), right_mm=unsigned_zero(right), up_mm=unsigned_zero(up))
