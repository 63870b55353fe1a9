"""How the forces of bones change: the derivative of forces/bone.py, point by point, for bones without friction.

The distance has to be smooth: where it is trilinear, the force jumps from cell to cell of its grid, and a run has no derivative.
Where a point touches first, and where the damper begins to be limited, the force bends: the derivative is then that of the side
on which the state lies.
"""

from __future__ import annotations

from explicitfe.fem.forces.bone import STIFFENING_DEPTH_M, into_bone, out_of_bone, penalty, speed_of_bone
from explicitfe.fem.forces.distance_grid import place_in_grid, smooth_distance
from explicitfe.fem.forces.face_lanes import at_point, dot, minus, plus, times
from explicitfe.fem.tangent.arrays import COMPONENTS
from explicitfe.platform.compiled.arrays import SHIFT, SPIN
from explicitfe.platform.compiled.contact_arrays import CONTACT_POINTS
from explicitfe.platform.compiled.jit import leaf, part_of_kernels
from explicitfe.platform.compiled.simd import ROW, WIDTH, load_many, splat, store
from explicitfe.platform.compiled.simd_lookup import any_positive, is_positive


@leaf
def _corner(values, node):
    """The same vector in all lanes, which are directions."""
    return splat(values[node, 0]), splat(values[node, 1]), splat(values[node, 2])


@leaf
def _row(bones, block, lane, corner):
    return int(bones.rows[block, corner, lane]) // ROW


@leaf
def _corners(bones, block, lane, values):
    return (
        _corner(values, _row(bones, block, lane, 0)),
        _corner(values, _row(bones, block, lane, 1)),
        _corner(values, _row(bones, block, lane, 2)),
        _corner(values, _row(bones, block, lane, 3)),
    )


@leaf
def _change(values, group, node):
    return load_many(values, ((group * values.shape[1] + node) * COMPONENTS) * WIDTH, COMPONENTS)


@leaf
def _changes(bones, block, lane, values, group):
    return (
        _change(values, group, _row(bones, block, lane, 0)),
        _change(values, group, _row(bones, block, lane, 1)),
        _change(values, group, _row(bones, block, lane, 2)),
        _change(values, group, _row(bones, block, lane, 3)),
    )


@leaf
def _add_point(bones, bone, block, lane, point, state, placement, instant, gains, tangents):
    """Add the tangent of the contact force of one bone on one point."""
    gain, gain_change = gains
    R = placement[instant, bone]
    moves = bones.moves[bone] != 0
    x = at_point(bones, point, _corners(bones, block, lane, bones.position))
    x = plus(x, at_point(bones, point, _corners(bones, block, lane, state.u)))
    v = at_point(bones, point, _corners(bones, block, lane, state.v))
    place = x
    if moves:
        place = minus(x, (R[SHIFT], R[SHIFT + 1], R[SHIFT + 2]))
        v = minus(v, speed_of_bone(placement, instant, bone, x))
    place, slip = into_bone(bones, placement, instant, bone, place), into_bone(bones, placement, instant, bone, v)
    (cx, cy, cz), outside = place_in_grid(bones, bone, place)
    d, g, (xx, yy, zz, xy, xz, yz) = smooth_distance(bones, bone, cx, cy, cz)
    p = -d - bones.rest_depth[bone, block, point, lane]
    if not any_positive(p) or any_positive(outside):
        return

    # the force, as in forces/bone.py
    spring = bones.spring[block, point, lane]
    push, stiffness, _ = penalty(splat(1.0), p, STIFFENING_DEPTH_M)
    damper, mobility = bones.damping[bone] * bones.damper[block, lane], gain * bones.mobility[block, lane]
    weaker = damper / (1.0 + mobility * damper)
    speed = dot(slip, g)
    press = push - weaker * speed
    pressing = is_positive(press)

    for group in range(len(tangents.u)):
        du = at_point(bones, point, _changes(bones, block, lane, tangents.u, group))
        dv = at_point(bones, point, _changes(bones, block, lane, tangents.v, group))
        if moves:
            spin = R[SPIN], R[SPIN + 1], R[SPIN + 2]
            dw = spin[1] * du[2] - spin[2] * du[1], spin[2] * du[0] - spin[0] * du[2], spin[0] * du[1] - spin[1] * du[0]
            dv = minus(dv, dw)
        dx, dslip = into_bone(bones, placement, instant, bone, du), into_bone(bones, placement, instant, bone, dv)
        dg = (
            xx * dx[0] + xy * dx[1] + xz * dx[2],
            xy * dx[0] + yy * dx[1] + yz * dx[2],
            xz * dx[0] + yz * dx[1] + zz * dx[2],
        )
        dweaker = splat(0.0)
        if len(tangents.alpha) > 0:
            dalpha = load_many(tangents.alpha, group * WIDTH, 1)[0]
            dweaker = (-weaker * weaker * mobility * gain_change) * dalpha
        dpress = -stiffness * dot(g, dx) - weaker * (dot(dslip, g) + dot(slip, dg)) - speed * dweaker
        df = times(pressing, plus(times(dpress, g), times(press, dg)))
        df = out_of_bone(bones, placement, instant, bone, times(spring, df))
        for corner in range(4):
            at = ((group * tangents.u.shape[1] + _row(bones, block, lane, corner)) * COMPONENTS) * WIDTH
            now = load_many(tangents.force, at, COMPONENTS)
            for k in range(COMPONENTS):
                store(tangents.force, at + k * WIDTH, now[k] + bones.share[corner, point] * df[k])


@part_of_kernels
def add_bone_changes(state, actions, instant, gain, gain_change, tangents):
    """Add the changes of the forces of bones to ``tangents.force``; ``gain_change`` is the derivative of log(gain) by alpha."""
    bones, gains = actions.bones, (gain, gain_change)
    for bone in range(len(bones.start)):
        for block in range(len(bones.rows)):
            if bones.until[bone, block] > bones.travel[0, 0]:
                continue
            for lane in range(WIDTH):
                for point in range(CONTACT_POINTS):
                    _add_point(bones, bone, block, lane, point, state, actions.bone_placement, instant, gains, tangents)
