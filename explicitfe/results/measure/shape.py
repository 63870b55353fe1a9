"""Shape of a tongue relative to rest: grooves and the highest point."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.results.measure.document import Groove, HighestPoint
from explicitfe.results.measure.motion import unsigned_zero
from explicitfe.results.measure.sections import STATION_SHARES, X, Z, groove_depth, midsagittal, section, station


def grooves(mesh: HexMesh, displacement: np.ndarray) -> dict[str, Groove]:
    """The grooves of the coronal sections at front, dorsum and back, which are cut at rest and follow the tissue."""
    now, tip = mesh.points + displacement, tip_at_rest(mesh)
    answer = {}
    for name in STATION_SHARES:
        place = station(mesh, name)
        cut = section(mesh, X, place)
        if not cut.loops:
            continue
        loop = max(cut.loops, key=len)
        reference = cut.at(mesh.points)[loop]
        at_rest = groove_depth(reference, reference)
        answer[name] = Groove(
            depth_mm=1e3 * max(0.0, groove_depth(reference, cut.at(now)[loop]) - at_rest),
            at_rest_mm=1e3 * at_rest,
            behind_tip_mm=unsigned_zero(1e3 * (place - tip[X])),
        )
    return answer


def highest_point(mesh: HexMesh, displacement: np.ndarray) -> HighestPoint | None:
    """The highest point of the midsagittal outline; None where the plane does not cut the body."""
    cut = midsagittal(mesh)
    if not cut.loops:
        return None
    loop = max(cut.loops, key=len)
    before = summit(cut.at(mesh.points)[loop][:, [X, Z]])
    after = summit(cut.at(mesh.points + displacement)[loop][:, [X, Z]])
    tip = tip_at_rest(mesh)
    return HighestPoint(
        forward_mm=unsigned_zero(1e3 * (before[0] - after[0])),
        up_mm=unsigned_zero(1e3 * (after[1] - before[1])),
        behind_tip_mm=unsigned_zero(1e3 * (after[0] - tip[X])),
        above_tip_mm=unsigned_zero(1e3 * (after[1] - tip[Z])),
    )


def tip_at_rest(mesh: HexMesh) -> np.ndarray:
    """The point named "tip" at rest, (3,) m; in a mesh without one the foremost node."""
    if "tip" in mesh.named_points:
        return mesh.named_points["tip"].position[0]
    return mesh.points[np.argmin(mesh.points[:, X])]


def summit(outline: np.ndarray) -> np.ndarray:
    """The highest point (2,) of a closed outline (k, 2) of x and z.

    It is the top of the parabola through the highest corner and the two beside it, so that it does not jump from corner to
    corner; the corner itself where they do not rise and fall along x, or the top would lie further above it than they lie below,
    as at an edge.
    """
    top = int(np.argmax(outline[:, 1]))
    before, at, after = outline[[top - 1, top, (top + 1) % len(outline)]]
    if (at[0] - before[0]) * (after[0] - at[0]) <= 0.0:
        return at
    (u, p), (v, q) = before - at, after - at
    # p = a u^2 + b u and q = a v^2 + b v
    bend = (p / u - q / v) / (u - v)
    slope = p / u - bend * u
    if not bend < 0.0 or (rise := -slope * slope / (4.0 * bend)) > max(-p, -q):
        return at
    return at + np.array([-slope / (2.0 * bend), rise])
