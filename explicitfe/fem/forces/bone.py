"""Contact of the surface of a body with bones, which are rigid: points of faces against signed distance.

A point of a face with area A that lies p deep in a bone is pushed out along the gradient g of the signed distance d,

    f = A k p (1 + p / p0) g - c (v g) g - t,   p = -(d + d0) > 0,   c = 2 zeta sqrt(k A m),

with its velocity v relative to the bone, its part v_t along the surface, and the damping ratio zeta of the bone. The first term
derives from the energy k A (p^2 / 2 + p^3 / (3 p0)): contact is soft at first touch, and 20 kPa penetrate four times as deep as
2 kPa instead of ten times. A face has 4 by 4 points, with its corners: an edge of a bone cannot lie between the nodes unseen.
Faces are computed in blocks, each in a lane.

The damper takes the velocity before the step, and is as much weaker as it would overtake an even pressure: it is stable at every
step length and never pulls. With friction (Coulomb, mu > 0) t is k A e + c v_t with what a tangential spring is bent by, e, which
follows the slip; t and k A e are limited to mu N (Simo & Hughes 1998, section 1.2, in one dimension more). What the dampers and
friction take is counted as lost to the last bit, with what the tangential springs hold.
"""

from __future__ import annotations

import math

from explicitfe.fem.forces.distance_grid import SHORTER, place_in_grid, smooth_distance, trilinear
from explicitfe.fem.forces.face_lanes import (
    at_point,
    corners_of,
    dot,
    dots,
    each_minus,
    each_plus,
    minus,
    no_vectors,
    plus,
    scatter_corners,
    spread,
    store_many,
    times,
)
from explicitfe.platform.compiled.arrays import BONE_AREA, BONE_DEPTH, BONE_FORCE, ROTATION, SHIFT, SPEED, SPIN
from explicitfe.platform.compiled.contact_arrays import CONTACT_POINTS
from explicitfe.platform.compiled.jit import leaf, part_of_kernels
from explicitfe.platform.compiled.simd import WIDTH, load, load_many, min_lanes, splat, square_root, store, sum_lanes
from explicitfe.platform.compiled.simd_lookup import any_positive, is_positive, larger, within

CONTACT_STIFFNESS_PA_M = 2e7  # k
STIFFENING_DEPTH_M = 1e-4  # p0: a pressure of 2 kPa presses a point 0.06 mm into bone, one of 20 kPa 0.27 mm
# What lies outside of a grid by a hundred thousandth of a micrometre is out of reach.
_OUT_OF_REACH = 1e9
_TINY = 1e-300


@leaf
def _rotated(R, a, along, across):
    """A vector times a matrix whose entries stand ``along`` apart from component to component, and ``across`` in a sum."""
    k, m = ROTATION, ROTATION + along
    n = m + along
    return (
        R[k] * a[0] + R[k + across] * a[1] + R[k + 2 * across] * a[2],
        R[m] * a[0] + R[m + across] * a[1] + R[m + 2 * across] * a[2],
        R[n] * a[0] + R[n + across] * a[1] + R[n + 2 * across] * a[2],
    )


@leaf
def into_bone(bones, placement, instant, bone, a):
    """A vector of space in the frame of a bone: R^T a."""
    return _rotated(placement[instant, bone], a, 1, 3) if bones.moves[bone] else a


@leaf
def out_of_bone(bones, placement, instant, bone, a):
    """A vector of the frame of a bone in space: R a."""
    return _rotated(placement[instant, bone], a, 3, 1) if bones.moves[bone] else a


@leaf
def each_into_bone(bones, placement, instant, bone, corners):
    a, b, c, d = corners
    return (
        into_bone(bones, placement, instant, bone, a),
        into_bone(bones, placement, instant, bone, b),
        into_bone(bones, placement, instant, bone, c),
        into_bone(bones, placement, instant, bone, d),
    )


@leaf
def each_out_of_bone(bones, placement, instant, bone, corners):
    a, b, c, d = corners
    return (
        out_of_bone(bones, placement, instant, bone, a),
        out_of_bone(bones, placement, instant, bone, b),
        out_of_bone(bones, placement, instant, bone, c),
        out_of_bone(bones, placement, instant, bone, d),
    )


@leaf
def speed_of_bone(placement, instant, bone, x):
    """Velocity of a bone at a place in space [m/s]."""
    R = placement[instant, bone]
    return (
        R[SPEED] + R[SPIN + 1] * x[2] - R[SPIN + 2] * x[1],
        R[SPEED + 1] + R[SPIN + 2] * x[0] - R[SPIN] * x[2],
        R[SPEED + 2] + R[SPIN] * x[1] - R[SPIN + 1] * x[0],
    )


@leaf
def penalty(spring, p, stiffening_depth):
    """Force [N], stiffness [N/m] and energy [J] of a contact point at depth p; force / p doubles over the stiffening depth."""
    share = p * (1.0 / stiffening_depth)
    return spring * p * (1.0 + share), spring * (1.0 + 2.0 * share), spring * p * p * (0.5 + share * (1.0 / 3.0))


@leaf
def scale_to_limit(size, limit):
    """Factor, at most 1, that scales a vector of this size down to a limit."""
    return 1.0 - within(1.0 - limit / (size + _TINY), 0.0, 1.0)


@leaf
def depth_at(bones, bone, block, point, places):
    """How deep a point of faces lies in a bone beyond its depth at rest, the gradient g of the distance there, and how far it may
    go before it could touch [m]. Depths below zero are not exact.

    ``places`` are those of the corners of the faces in the frame of the bone.
    """
    (x, y, z), outside = place_in_grid(bones, bone, at_point(bones, point, places))
    if bones.smooth[bone]:
        d, g, _ = smooth_distance(bones, bone, x, y, z)
    else:
        d, g = trilinear(bones, bone, x, y, z)
    d = d + load(bones.rest_depth, ((bone * len(bones.rows) + block) * CONTACT_POINTS + point) * WIDTH)
    # along each axis a distance changes by at most the displacement, and so does what is interpolated
    return -d - _OUT_OF_REACH * outside, g, larger(SHORTER * d, outside)


@leaf
def places_of(bones, bone, placement, instant, x):
    """Where the corners of a block of faces are in the frame of a bone [m], from where they are in space."""
    if bones.moves[bone]:
        R = placement[instant, bone]
        s = R[SHIFT], R[SHIFT + 1], R[SHIFT + 2]
        return each_into_bone(bones, placement, instant, bone, (minus(x[0], s), minus(x[1], s), minus(x[2], s), minus(x[3], s)))
    return x


@leaf
def speeds_of(bones, bone, placement, instant, x):
    """The velocity of a bone at the corners of a block of faces, in space [m/s]."""
    if bones.moves[bone]:
        return (
            speed_of_bone(placement, instant, bone, x[0]),
            speed_of_bone(placement, instant, bone, x[1]),
            speed_of_bone(placement, instant, bone, x[2]),
            speed_of_bone(placement, instant, bone, x[3]),
        )
    return no_vectors()


@leaf
def rub_at(bones, at, n, slip, damper, dt, limit):
    """How far the tangential springs of a point are bent after a slip [m], and its friction over its stiffness [m].

    ``slip`` is the velocity along the surface in the step before, and ``limit`` Coulomb's, over the stiffness.
    """
    bent = load_many(bones.bent, at, 3)
    bent = plus(minus(bent, times(dot(bent, n), n)), times(dt, slip))
    bent = times(scale_to_limit(square_root(dot(bent, bent)), limit), bent)
    rub = minus(times(-damper, slip), bent)
    return bent, times(scale_to_limit(square_root(dot(rub, rub)), limit), rub)


@leaf
def fastest_bone(bones, placement, instant):
    """Bound of the speed of any bone within its grid [m/s]."""
    fastest = 0.0
    for bone in range(len(bones.start)):
        if bones.moves[bone]:
            R = placement[instant, bone]
            spin = math.sqrt(R[SPIN] ** 2 + R[SPIN + 1] ** 2 + R[SPIN + 2] ** 2)
            reach = bones.reach[bone] + math.sqrt(R[SHIFT] ** 2 + R[SHIFT + 1] ** 2 + R[SHIFT + 2] ** 2)
            fastest = max(fastest, math.sqrt(R[SPEED] ** 2 + R[SPEED + 1] ** 2 + R[SPEED + 2] ** 2) + spin * reach)
    return fastest


@part_of_kernels
def add_contact_stiffness(force, u, here, bones, placement, instant):
    """Add the change of the contact force from displacement ``here`` to u, linearised at the former, to the node rows.

    For the highest frequency: the stiffness g x g of the points that touch. The force itself bends at first touch and where g
    jumps from cell to cell, and a difference over a nanometre would take such a bend for a huge stiffness. The stiffness of the
    contact is noted in ``bones.checked``.
    """
    bones.checked[:] = 0.0
    for bone in range(len(bones.start)):
        for block in range(len(bones.rows)):
            if bones.until[bone, block] > bones.travel[0, 0]:
                continue
            x = each_plus(corners_of(bones.position, bones.rows, block), corners_of(here, bones.rows, block))
            places = places_of(bones, bone, placement, instant, x)
            moved = each_minus(corners_of(u, bones.rows, block), corners_of(here, bones.rows, block))
            moved = each_into_bone(bones, placement, instant, bone, moved)
            sums, steepest = no_vectors(), splat(0.0)
            for point in range(CONTACT_POINTS):
                if bones.until_point[bone * len(bones.rows) + block, point] > bones.travel[0, 0]:
                    continue
                p, g, _ = depth_at(bones, bone, block, point, places)
                if not any_positive(p):
                    continue
                _, slope, _ = penalty(is_positive(p), p, STIFFENING_DEPTH_M)
                steepest = larger(slope, steepest)
                stiffness = slope * load(bones.spring, (block * CONTACT_POINTS + point) * WIDTH)
                sums = spread(bones, point, sums, times(-stiffness * dot(g, at_point(bones, point, moved)), g))
            store(bones.checked, (bone * len(bones.rows) + block) * WIDTH, steepest)
            scatter_corners(force, bones.rows, block, each_out_of_bone(bones, placement, instant, bone, sums))


@part_of_kernels
def rest_on_bones(force, rows, u, v, bones, placement, instant, range_of, recurrence, record):
    """Add the contact force on blocks of faces to node rows.

    Parameters
    ----------
    force, rows : where the force goes, and where the rows of the corners begin there.
    u, v : displacement, and velocity of the half step before.
    bones, placement : of Actions, which is too large to be passed on at every step.
    range_of : the first block, the one after the last, and how far nodes and bones may have gone since the course began [m].
    recurrence : Recurrence.
    record : BoneRecord. Receives what each bone does; empty where nobody asks.

    Returns
    -------
    loss, work : J. What dampers and friction lose in the half step before, and the work of the bones that move.
    stored : J. Elastic energy of the contact now.
    count : of pairs of a bone and a block that touch, for ``bones_loss``.
    stiffening : the largest increase of the contact stiffness of a face since the last stability check, over that at first touch.
    """
    near, far, travel = range_of
    both, dt = recurrence.ahead + recurrence.behind, 2.0 * recurrence.behind
    sums, pressure = record
    loss = work = 0.0
    stored = stiffening = splat(0.0)
    asked = len(sums) > 0
    blocks, first, count = len(bones.rows), near * len(bones.start), 0
    for bone in range(len(bones.start)):
        friction = bones.friction[bone]
        for block in range(near, far):
            # grids are large and in no cache, and most faces are far from bone
            if bones.until[bone, block] > travel:
                continue
            pair = bone * blocks + block
            x = each_plus(corners_of(bones.position, bones.rows, block), corners_of(u, bones.rows, block))
            w = speeds_of(bones, bone, placement, instant, x)
            slips = each_into_bone(bones, placement, instant, bone, each_minus(corners_of(v, bones.rows, block), w))
            places = places_of(bones, bone, placement, instant, x)
            damper = bones.damping[bone] * load(bones.damper, block * WIDTH)
            damper = damper / (1.0 + recurrence.gain * load(bones.mobility, block * WIDTH) * damper)
            elastic, drag, normal = no_vectors(), no_vectors(), (splat(0.0), splat(0.0), splat(0.0), splat(0.0))
            soonest = math.inf
            deepest = area = steepest = splat(0.0)
            touching = False
            for point in range(CONTACT_POINTS):
                if bones.until_point[pair, point] > travel:
                    soonest = min(soonest, bones.until_point[pair, point])
                    continue
                p, g, clear = depth_at(bones, bone, block, point, places)
                touches = any_positive(p)
                until = -1.0
                if not touches:
                    free = min_lanes(clear)
                    until = travel + free if free > 0.0 else -1.0
                bones.until_point[pair, point] = until
                soonest = min(soonest, until)
                if not touches and friction == 0.0:
                    continue
                touching = touching or touches
                is_in = is_positive(p)
                spring = is_in * load(bones.spring, (block * CONTACT_POINTS + point) * WIDTH)
                push, slope, energy = penalty(is_in, p, STIFFENING_DEPTH_M)
                steepest = larger(slope, steepest)
                stored = stored + spring * energy
                slip = at_point(bones, point, slips)
                brake = larger(-is_in * damper * dot(slip, g), -push)
                pull = times(brake, g)
                if friction > 0.0:
                    size = square_root(dot(g, g) + _TINY)
                    n, at = times(1.0 / size, g), (pair * CONTACT_POINTS + point) * (3 * WIDTH)
                    along = minus(slip, times(dot(slip, n), n))
                    bent, rub = rub_at(bones, at, n, along, damper, dt, friction * (push + brake) * size)
                    if not asked:
                        store_many(bones.bent, at, bent)
                    pull = plus(pull, rub)
                elastic = spread(bones, point, elastic, times(spring * push, g))
                drag = spread(bones, point, drag, times(spring, pull))
                if asked:
                    press, s = spring * (push + brake) * square_root(dot(g, g)), bones.share
                    normal = (
                        normal[0] + s[0, point] * press,
                        normal[1] + s[1, point] * press,
                        normal[2] + s[2, point] * press,
                        normal[3] + s[3, point] * press,
                    )
                    area, deepest = area + spring, larger(p, deepest)
            bones.until[bone, block] = soonest
            if not touching:
                continue
            stiffening = larger(steepest - load(bones.checked, pair * WIDTH), stiffening)
            elastic = each_out_of_bone(bones, placement, instant, bone, elastic)
            drag = each_out_of_bone(bones, placement, instant, bone, drag)
            all_of_it = each_plus(elastic, drag)
            scatter_corners(force, rows, block, all_of_it)
            loss += both * dots(drag, w) - recurrence.behind * dots(drag, corners_of(v, bones.rows, block))
            work += both * dots(all_of_it, w)
            for corner in range(4):
                store_many(bones.drag, (pair * 4 + corner) * (3 * WIDTH), drag[corner])
            bones.touching[first + count] = pair
            count += 1
            if asked:
                for corner in range(4):
                    for k in range(3):
                        sums[bone, BONE_FORCE + k] += sum_lanes(all_of_it[corner][k])
                    store(bones.lanes, 0, normal[corner])
                    for lane in range(WIDTH):
                        node = bones.node[block, corner, lane]
                        pressure[bone, node] += bones.lanes[lane] / bones.area[node]
                sums[bone, BONE_AREA] += sum_lanes(area) / CONTACT_STIFFNESS_PA_M
                sums[bone, BONE_DEPTH] = max(sums[bone, BONE_DEPTH], -min_lanes(-deepest))
    return loss, work, sum_lanes(stored), count, -min_lanes(-stiffening)


@part_of_kernels
def bones_loss(bones, near, count, v, ahead):
    """What dampers and friction of the blocks from ``near`` on lose in the half step ahead [J], with its velocities."""
    first, loss = near * len(bones.start), splat(0.0)
    for number in range(first, first + count):
        pair = bones.touching[number]
        corners = corners_of(v, bones.rows, pair % len(bones.rows))
        for corner in range(4):
            loss = loss + dot(load_many(bones.drag, (pair * 4 + corner) * (3 * WIDTH), 3), corners[corner])
    return -ahead * sum_lanes(loss)
