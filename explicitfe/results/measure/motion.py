"""Displacements and speeds of the body and of its named points."""

from __future__ import annotations

import numpy as np
import scipy

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.mesh.self_contact import self_penetration
from explicitfe.platform.host.kept import kept
from explicitfe.results.files import Recorded
from explicitfe.results.measure.document import BodyMotion, MaterialPlace, PointMotion, SelfPenetrationFigures
from explicitfe.results.measure.sections import X, Y, Z, middle

RISE_SHARE = 0.9
# A smaller displacement counts as none: the time to reach a share of it would be determined by rounding.
SMALLEST_MOTION_M = 1e-6
# A movement has returned when it ends nearer to rest than this share of its largest displacement. Even an undamped step response
# overshoots to no more than twice the displacement at which it ends, so that a held movement is never taken for a returned one.
RETURNED_SHARE = 0.5
# A body has settled when no node, at its present speed, would move by more than this share of the largest displacement so far.
SETTLED_SHARE, SETTLED_WITHIN_S = 0.05, 0.1
# Nodes are mirror images of each other up to this share of the mesh's extent.
MIRROR_SHARE_OF_EXTENT = 1e-6


def point_motions(result: Recorded, step: int) -> dict[str, PointMotion]:
    """Motion of the named points up to a step, in the order of the model; from the stored samples where no history has it."""
    motions = {}
    for name in result.model.get("probes", result.mesh.named_points):
        times, path, velocity = _history_until(result, name, step)
        distance = np.linalg.norm(path, axis=1)
        farthest = int(np.argmax(np.nan_to_num(distance)))
        speeds = np.linalg.norm(velocity, axis=1)
        right, up = 1e3 * path[-1, [Y, Z]]
        motions[name] = PointMotion(
            forward_mm=unsigned_zero(-1e3 * path[-1, X]),
            up_mm=unsigned_zero(up),
            right_mm=unsigned_zero(right),
            largest_mm=1e3 * float(distance[farthest]),
            largest_at_ms=1e3 * float(times[farthest]),
            time_to_90_ms=_in_ms(rise_time(times, path)),
            peak_speed_mm_s=1e3 * float(speeds.max()),
            speed_mm_s=1e3 * float(speeds[-1]),
        )
    return motions


def body_motion(result: Recorded, step: int) -> BodyMotion:
    """The whole body."""
    mesh, u = result.mesh, result.displacement(step)
    size_m, largest_so_far, reached = _body_history(result, step)
    fastest = float(np.linalg.norm(_velocity(result, step), axis=1).max())
    rest_m3, now_m3 = float(_rest_volumes(mesh).sum()), float(volumes(mesh.points + u, mesh.hexes).sum())
    passed = self_penetration(mesh, u)
    difference = left_right_difference(mesh, u)
    return BodyMotion(
        largest_displacement_mm=1e3 * float(np.linalg.norm(u, axis=1).max()),
        largest_so_far_mm=1e3 * largest_so_far,
        fastest_mm_s=1e3 * fastest,
        settled=has_settled(fastest, largest_so_far),
        time_to_90_ms=_in_ms(_time_to_share(result.times[: step + 1], size_m, reached)),
        volume_change_percent=100.0 * (now_m3 / rest_m3 - 1.0),
        left_right_mm=None if difference is None else 1e3 * difference,
        self_penetration=SelfPenetrationFigures(
            nodes=passed.count,
            deepest_mm=1e3 * passed.deepest_m,
            deepest_at_rest=None if passed.where_m is None else place_of(passed.where_m),
        ),
    )


def has_settled(fastest_m_s: float, largest_m: float) -> bool:
    """Whether no node would move by 5 % of the largest displacement in another 100 ms at the speed of the fastest node.

    Parameters
    ----------
    fastest_m_s : speed of the fastest node now, m/s.
    largest_m : largest displacement of any node so far, m; not only now, because a movement may have returned to rest.
    """
    return SETTLED_WITHIN_S * fastest_m_s <= SETTLED_SHARE * largest_m


def largest_displacement(displacements: np.ndarray) -> float:
    """The largest displacement of any node, m, of displacements (..., 3) m; values that are not finite are ignored."""
    lengths = np.linalg.norm(displacements, axis=-1)
    return float(lengths[np.isfinite(lengths)].max(initial=0.0))


def rise_time(times: np.ndarray, path: np.ndarray) -> float | None:
    """Time from the first of ``times`` (t,) until a displacement (t, 3), m, first reaches 90 % of its final value, s.

    The displacement is projected on its final direction, and interpolated linearly between samples. None where it ends within a
    micrometre of where it began, or where the movement has returned: nearer to rest than half of its largest displacement.
    """
    end = path[-1]
    squared = float(end @ end)
    return _time_to_share(times, np.linalg.norm(path, axis=1), path @ end / squared if squared > 0.0 else np.zeros(len(path)))


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


def _history_until(result: Recorded, name: str, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


def _body_history(result: Recorded, step: int) -> tuple[np.ndarray, float, np.ndarray]:
    """History of the displacement field up to a step.

    Returns
    -------
    Root mean square displacement, weighted by volume, (t,) m; the largest displacement of any node at any sample, m; and the
    field projected on that at the last sample, as a share of it (t,).
    """
    mesh = result.mesh
    shares = np.repeat(_rest_volumes(mesh) / 8.0, 8)
    weights = np.bincount(mesh.hexes.ravel(), shares, mesh.node_count)[:, None] / shares.sum()
    end = weights * result.displacement(step)
    size, reached, largest = np.zeros(step + 1), np.zeros(step + 1), 0.0
    for number in range(step + 1):
        u = result.displacement(number)
        size[number] = np.sqrt(np.sum(weights * u * u))
        reached[number] = np.sum(end * u)
        largest = max(largest, largest_displacement(u))
    return size, largest, reached / (reached[-1] or 1.0)


def _time_to_share(times: np.ndarray, size: np.ndarray, reached: np.ndarray) -> float | None:
    """Time after the first of ``times`` (t,) at which a movement first reaches 90 % of its final displacement, s.

    Parameters
    ----------
    size : (t,) m. Magnitude of the displacement.
    reached : (t,) The displacement projected on the final one, as a share of it; 1 at the end.

    Returns
    -------
    None where nothing has moved, or where the movement has returned towards rest.
    """
    if not size[-1] > SMALLEST_MOTION_M or size[-1] < RETURNED_SHARE * np.nanmax(size):
        return None
    after = int(np.argmax(reached >= RISE_SHARE))
    if after == 0:
        return 0.0
    part = (RISE_SHARE - reached[after - 1]) / (reached[after] - reached[after - 1])
    return float(times[after - 1] + part * (times[after] - times[after - 1]) - times[0])


def _in_ms(seconds: float | None) -> float | None:
    return None if seconds is None else 1e3 * seconds


def place_of(position_m: np.ndarray) -> MaterialPlace:
    """A reference position (3,) m, as documents have it."""
    back, right, up = 1e3 * position_m
    return MaterialPlace(back_mm=unsigned_zero(back), right_mm=unsigned_zero(right), up_mm=unsigned_zero(up))
