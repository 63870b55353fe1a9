"""How the forces of bones change: the derivative of forces/bone.py, point by point, for bones without friction.

The distance has to be smooth: where it is trilinear, the force jumps from cell to cell of its grid, and a run has no derivative.
Where a point touches first, and where the damper begins to be limited, the force bends: the derivative is then that of the side
on which the state lies.
"""

from __future__ import annotations

import math

from explicitfe.fem.forces.bone import (
    STIFFENING_DEPTH_M,
    TANGENTIAL_DAMPER_SHARE,
    cell,
    depth_in,
    is_far,
    penalty,
    smooth_distance,
)
from explicitfe.fem.forces.dead import add_dead_loads
from explicitfe.fem.forces.follower import add_follower_fibres
from explicitfe.fem.forces.ties import add_ties
from explicitfe.fem.tangent.arrays import COMPONENTS
from explicitfe.platform.compiled.arrays import ROTATION, SHIFT, SPEED, SPIN
from explicitfe.platform.compiled.jit import leaf, part_of_kernels
from explicitfe.platform.compiled.simd import WIDTH, load, splat, store


@leaf
def in_bone(placement, instant, bone, x, y, z):
    """A vector of space in the frame of a bone: R^T x."""
    R = ROTATION
    return (
        placement[instant, bone, R] * x + placement[instant, bone, R + 3] * y + placement[instant, bone, R + 6] * z,
        placement[instant, bone, R + 1] * x + placement[instant, bone, R + 4] * y + placement[instant, bone, R + 7] * z,
        placement[instant, bone, R + 2] * x + placement[instant, bone, R + 5] * y + placement[instant, bone, R + 8] * z,
    )


@leaf
def in_space(placement, instant, bone, x, y, z):
    """A vector of the frame of a bone in space: R x."""
    R = ROTATION
    return (
        placement[instant, bone, R] * x + placement[instant, bone, R + 1] * y + placement[instant, bone, R + 2] * z,
        placement[instant, bone, R + 3] * x + placement[instant, bone, R + 4] * y + placement[instant, bone, R + 5] * z,
        placement[instant, bone, R + 6] * x + placement[instant, bone, R + 7] * y + placement[instant, bone, R + 8] * z,
    )


@leaf
def bend(bones, bone, x, y, z):
    """Second derivatives xx, yy, zz, xy, xz, yz [1/m] of the distance at a point in the frame of a bone."""
    first, a, b, c, _ = cell(bones, bone, x, y, z)
    return smooth_distance(bones, bone, first, a, b, c)[2]


@leaf
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@leaf
def _along(a, n):
    """A scalar or vector times three numbers."""
    return a * n[0], a * n[1], a * n[2]


@leaf
def _plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@leaf
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@leaf
def _add_point(state, nodes, actions, instant, recurrence, tangents, point, bone, touch, before):
    """Add the tangent of the contact force of one bone on one point; give the sum of the forces of the bones so far, (3,) N.

    ``recurrence`` is keep, gain and their changes, and ``touch`` where the point is, how deep in the bone, and the gradient.
    """
    keep, gain, keep_change, gain_change = recurrence
    at, p, g = touch
    _, v, force = state
    bones, placement = actions.bones, actions.bone_placement
    node = bones.node[point]
    moves = bones.moves[bone] != 0
    x, y, z = at
    local = at
    w, spin = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if moves:
        s = SHIFT
        local = in_bone(
            placement, instant, bone,
            x - placement[instant, bone, s], y - placement[instant, bone, s + 1], z - placement[instant, bone, s + 2],
        )  # fmt: skip
        R = placement[instant, bone]
        spin = (R[SPIN], R[SPIN + 1], R[SPIN + 2])
        w = (
            R[SPEED] + spin[1] * z - spin[2] * y,
            R[SPEED + 1] + spin[2] * x - spin[0] * z,
            R[SPEED + 2] + spin[0] * y - spin[1] * x,
        )
    xx, yy, zz, xy, xz, yz = bend(bones, bone, local[0], local[1], local[2])

    # the force, as in forces/bone.py
    spring, damper = bones.spring[point], bones.damper[bone, point]
    push, stiffness, _ = penalty(spring, p, STIFFENING_DEPTH_M)
    size = math.sqrt(_dot(g, g))
    n = _along(1.0 / size, g)
    elastic = _along(push, g)
    mobility = (gain * nodes.inverse_mass[node, 0], gain * nodes.inverse_mass[node, 1], gain * nodes.inverse_mass[node, 2])
    external = tangents.external
    total = (
        force[node, 0] + external[node, 0] + before[0] + elastic[0],
        force[node, 1] + external[node, 1] + before[1] + elastic[1],
        force[node, 2] + external[node, 2] + before[2] + elastic[2],
    )
    m = (
        0.5 * ((1.0 + keep) * v[node, 0] + mobility[0] * total[0]) - w[0],
        0.5 * ((1.0 + keep) * v[node, 1] + mobility[1] * total[1]) - w[1],
        0.5 * ((1.0 + keep) * v[node, 2] + mobility[2] * total[2]) - w[2],
    )
    largest = max(mobility[0], max(mobility[1], mobility[2]))
    normal = _dot(m, n)
    held = 1.0 / (1.0 + 0.5 * largest * damper)
    brake, limit = -damper * normal * held, -push * size
    limited = limit > brake
    if limited:
        brake = limit
    t = _minus(m, _along(normal, n))
    sliding = TANGENTIAL_DAMPER_SHARE * damper
    left = 1.0 / (1.0 + 0.5 * largest * sliding)
    drag = -(1.0 - left) / (0.5 * largest)

    for group in range(len(tangents.u)):
        row = ((group * tangents.u.shape[1] + node) * COMPONENTS) * WIDTH
        du = (load(tangents.u, row), load(tangents.u, row + WIDTH), load(tangents.u, row + 2 * WIDTH))
        dv = (load(tangents.v, row), load(tangents.v, row + WIDTH), load(tangents.v, row + 2 * WIDTH))
        df = (load(tangents.force, row), load(tangents.force, row + WIDTH), load(tangents.force, row + 2 * WIDTH))
        local_change = du
        if moves:
            local_change = in_bone(placement, instant, bone, du[0], du[1], du[2])
        dg = (
            xx * local_change[0] + xy * local_change[1] + xz * local_change[2],
            xy * local_change[0] + yy * local_change[1] + yz * local_change[2],
            xz * local_change[0] + yz * local_change[1] + zz * local_change[2],
        )
        if moves:
            dg = in_space(placement, instant, bone, dg[0], dg[1], dg[2])
        dpush = (-stiffness) * _dot(g, du)
        along = _dot(n, dg)
        dn = _along(1.0 / size, _minus(dg, (along * n[0], along * n[1], along * n[2])))
        de = (push * dg[0] + g[0] * dpush, push * dg[1] + g[1] * dpush, push * dg[2] + g[2] * dpush)
        df = _plus(df, de)
        dkeep, dgain = splat(0.0), splat(0.0)
        if len(tangents.alpha) > 0:
            dalpha = load(tangents.alpha, group * WIDTH)
            dkeep, dgain = keep_change * dalpha, gain_change * dalpha
        dw = (spin[1] * du[2] - spin[2] * du[1], spin[2] * du[0] - spin[0] * du[2], spin[0] * du[1] - spin[1] * du[0])
        dm = (
            0.5 * ((1.0 + keep) * dv[0] + dkeep * v[node, 0] + mobility[0] * (df[0] + total[0] * dgain)) - dw[0],
            0.5 * ((1.0 + keep) * dv[1] + dkeep * v[node, 1] + mobility[1] * (df[1] + total[1] * dgain)) - dw[1],
            0.5 * ((1.0 + keep) * dv[2] + dkeep * v[node, 2] + mobility[2] * (df[2] + total[2] * dgain)) - dw[2],
        )
        dnormal = _dot(dm, n) + _dot(m, dn)
        dmobility = largest * dgain
        dbrake = -damper * held * (dnormal + (0.5 * damper * held * -normal) * dmobility)
        if limited:
            dbrake = -size * dpush - push * along
        ddrag = (0.5 * sliding * left * -drag) * dmobility
        dt = _minus(_minus(dm, (n[0] * dnormal, n[1] * dnormal, n[2] * dnormal)), _along(normal, dn))
        for k in range(3):
            change = brake * dn[k] + n[k] * dbrake + drag * dt[k] + t[k] * ddrag
            store(tangents.force, row + k * WIDTH, df[k] + change)
    return _plus(_plus(before, elastic), _plus(_along(brake, n), _along(drag, t)))


@part_of_kernels
def add_bone_changes(state, nodes, actions, instant, keep, gain, keep_change, gain_change, tangents):
    """Add the changes of the forces of bones to ``tangents.force``, which has those of all other forces.

    ``keep_change`` and ``gain_change`` are the derivatives of keep and of log(gain) by the damping alpha.
    """
    bones, placement = actions.bones, actions.bone_placement
    u, _, _ = state
    external = tangents.external
    asked = False
    for point in range(len(bones.node)):
        node = bones.node[point]
        moving = False
        for bone in range(len(bones.start)):
            moving = moving or bones.moves[bone] != 0
        away = is_far(bones.free, 0, point, u[node, 0], u[node, 1], u[node, 2])
        if away and not moving:
            continue
        x = bones.position[point, 0] + u[node, 0]
        y = bones.position[point, 1] + u[node, 1]
        z = bones.position[point, 2] + u[node, 2]
        fx = fy = fz = 0.0  # of the bones before this one
        for bone in range(len(bones.start)):
            if away and not bones.moves[bone]:
                continue
            p, gx, gy, gz, _ = depth_in(bones, bone, point, x, y, z, placement, instant)
            if not p > 0.0:
                continue
            if not asked:
                asked = True
                external[:] = 0.0
                add_dead_loads(external, actions.dead, actions.activation, instant)
                add_follower_fibres(external, u, actions.fibres, actions.activation, instant)
                add_ties(external, u, actions.ties, actions.tie_placement, instant)
            recurrence = (keep, gain, keep_change, gain_change)
            touch = ((x, y, z), p, (gx, gy, gz))
            fx, fy, fz = _add_point(state, nodes, actions, instant, recurrence, tangents, point, bone, touch, (fx, fy, fz))
