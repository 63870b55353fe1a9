"""Contact of the surface of a body with bones, which are rigid: node against signed distance.

A node with tributary area A that lies p deep in a bone is pushed out along the gradient g of the signed distance d,

    f = A k p (1 + p / p0) g - c v_n n - c_t v_t,   p = -(d + d0) > 0,   n = g / |g|,
    c = 2 zeta sqrt(k A m),   c_t = c / 20 + mu N / |v_t|,

with its velocity v relative to the bone, parts along n and across it, and the damping ratio zeta of the bone. The first term
derives from the energy k A (p^2 / 2 + p^3 / (3 p0)): contact is soft at first touch, and 20 kPa penetrate four times as deep as
2 kPa instead of ten times. The dampers take the mean velocity of the step, so they are stable at every step length and what they
lose is counted to the last bit; they never pull. Friction (Coulomb, mu > 0) is smoothed: below ``CREEP_M_S`` a body that sticks
creeps instead.
"""

from __future__ import annotations

import math

from explicitfe.platform.compiled.arrays import BONE_AREA, BONE_DEPTH, BONE_FORCE, ROTATION, SHIFT, SPEED, SPIN
from explicitfe.platform.compiled.jit import leaf

CONTACT_STIFFNESS_PA_M = 2e7  # k
STIFFENING_DEPTH_M = 1e-4  # p0: a pressure of 2 kPa presses a node 0.06 mm into bone, one of 20 kPa 0.27 mm
TANGENTIAL_DAMPER_SHARE = 0.05  # of the normal one
CREEP_M_S = 1e-3


@leaf
def cell(bones, bone, x, y, z):
    """Where in the grid of a bone a point lies that the bone's own frame puts at x, y, z.

    The first entry of the cell, how far into it, and how far the point may go before it could touch. The entry is -1 where the
    point is outside of the grid or further from bone than two cells.
    """
    spacing = bones.spacing[bone]
    gx = (x - bones.origin[bone, 0]) / spacing
    gy = (y - bones.origin[bone, 1]) / spacing
    gz = (z - bones.origin[bone, 2]) / spacing
    nx, ny, nz = bones.shape[bone, 0], bones.shape[bone, 1], bones.shape[bone, 2]
    # not one of these holds for a NaN
    if not (gx >= 0.0 and gy >= 0.0 and gz >= 0.0 and gx < nx - 1 and gy < ny - 1 and gz < nz - 1):
        outside = max(max(-gx, gx - nx + 1), max(max(-gy, gy - ny + 1), max(-gz, gz - nz + 1)))
        return -1, 0.0, 0.0, 0.0, max(outside, 0.0) * spacing
    i, j, k = int(gx), int(gy), int(gz)
    first = bones.start[bone] + (i * ny + j) * nz + k
    # distances change by no more than the way: to any point of the cell, its diagonal
    clear = bones.distance[first] - 2.0 * spacing
    if clear > 0.0:
        return -1, 0.0, 0.0, 0.0, clear
    return first, gx - i, gy - j, gz - k, 0.0


@leaf
def is_far(free, which, point, x, y, z):
    """Whether a point is still so near to where it was looked up last that it cannot touch.

    Grids are large and in no cache, and most points are far from bone.
    """
    away_x, away_y, away_z = x - free[which, point, 0], y - free[which, point, 1], z - free[which, point, 2]
    return away_x * away_x + away_y * away_y + away_z * away_z < free[which, point, 3]


@leaf
def note_far(free, which, point, x, y, z, clear):
    """Remember how far a point may go from here before it has to be looked up again."""
    free[which, point, 0], free[which, point, 1], free[which, point, 2] = x, y, z
    free[which, point, 3] = clear * clear


@leaf
def distance(bones, bone, first, a, b, c):
    """Signed distance [m] and its gradient, trilinear in a cell."""
    ny, nz = bones.shape[bone, 1], bones.shape[bone, 2]
    d, scale = bones.distance, 1.0 / bones.spacing[bone]
    x, y = ny * nz, nz
    d00 = d[first] + c * (d[first + 1] - d[first])
    d01 = d[first + y] + c * (d[first + y + 1] - d[first + y])
    d10 = d[first + x] + c * (d[first + x + 1] - d[first + x])
    d11 = d[first + x + y] + c * (d[first + x + y + 1] - d[first + x + y])
    d0, d1 = d00 + b * (d01 - d00), d10 + b * (d11 - d10)
    along_z0 = (1.0 - b) * (d[first + 1] - d[first]) + b * (d[first + y + 1] - d[first + y])
    along_z1 = (1.0 - b) * (d[first + x + 1] - d[first + x]) + b * (d[first + x + y + 1] - d[first + x + y])
    along_y = (1.0 - a) * (d01 - d00) + a * (d11 - d10)
    return d0 + a * (d1 - d0), scale * (d1 - d0), scale * along_y, scale * ((1.0 - a) * along_z0 + a * along_z1)


@leaf
def _share(t, k):
    """Weight of neighbour k = -1, 0, 1 in a quadratic B-spline at t, from -1/2 to 1/2, and its first two derivatives."""
    if k == 0:
        return 0.75 - t * t, -2.0 * t, -2.0
    near = 0.5 + k * t
    return 0.5 * near * near, k * near, 1.0


@leaf
def smooth_distance(bones, bone, first, a, b, c):
    """Signed distance [m], its gradient, and its second derivatives xx, yy, zz, xy, xz, yz [1/m]: a quadratic B-spline.

    Its coefficients are the distances at the nodes of the grid: exact for a plane, while a surface of curvature C is rounded off
    by C h^2 / 8 for a spacing h. Value and gradient are continuous from cell to cell.
    """
    nx, ny, nz = bones.shape[bone, 0], bones.shape[bone, 1], bones.shape[bone, 2]
    at = first - bones.start[bone]
    i, j, k = at // (ny * nz), at // nz % ny, at % nz
    # the nearest node, none of the outermost
    nearest = (
        min(max(i + (a >= 0.5), 1), nx - 2),
        min(max(j + (b >= 0.5), 1), ny - 2),
        min(max(k + (c >= 0.5), 1), nz - 2),
    )
    x, y, z = a + (i - nearest[0]), b + (j - nearest[1]), c + (k - nearest[2])
    d = gx = gy = gz = xx = yy = zz = xy = xz = yz = 0.0
    for p in range(-1, 2):
        x0, x1, x2 = _share(x, p)
        s00 = s01 = s02 = s10 = s11 = s20 = 0.0  # sums in a plane: derivatives along y and z
        for q in range(-1, 2):
            y0, y1, y2 = _share(y, q)
            t0 = t1 = t2 = 0.0  # along a line
            for r in range(-1, 2):
                z0, z1, z2 = _share(z, r)
                value = bones.distance[bones.start[bone] + ((nearest[0] + p) * ny + nearest[1] + q) * nz + nearest[2] + r]
                t0, t1, t2 = t0 + z0 * value, t1 + z1 * value, t2 + z2 * value
            s00, s01, s02 = s00 + y0 * t0, s01 + y0 * t1, s02 + y0 * t2
            s10, s11, s20 = s10 + y1 * t0, s11 + y1 * t1, s20 + y2 * t0
        d, gx, gy, gz = d + x0 * s00, gx + x1 * s00, gy + x0 * s10, gz + x0 * s01
        xx, yy, zz = xx + x2 * s00, yy + x0 * s20, zz + x0 * s02
        xy, xz, yz = xy + x1 * s10, xz + x1 * s01, yz + x0 * s11
    w = 1.0 / bones.spacing[bone]
    return d, (w * gx, w * gy, w * gz), (w * w * xx, w * w * yy, w * w * zz, w * w * xy, w * w * xz, w * w * yz)


@leaf
def depth_in(bones, bone, point, x, y, z, placement, instant):
    """How deep a contact point at x, y, z has gone into a bone beyond its depth at rest, the gradient g of the distance, and how
    far the point may go before it could touch: of a bone that moves, in its own frame, where that is remembered here."""
    moves = bones.moves[bone]
    if moves:
        R, s = ROTATION, SHIFT
        x = x - placement[instant, bone, s]
        y = y - placement[instant, bone, s + 1]
        z = z - placement[instant, bone, s + 2]
        x, y, z = (
            placement[instant, bone, R] * x + placement[instant, bone, R + 3] * y + placement[instant, bone, R + 6] * z,
            placement[instant, bone, R + 1] * x + placement[instant, bone, R + 4] * y + placement[instant, bone, R + 7] * z,
            placement[instant, bone, R + 2] * x + placement[instant, bone, R + 5] * y + placement[instant, bone, R + 8] * z,
        )
        if is_far(bones.free, 1 + bone, point, x, y, z):
            return 0.0, 0.0, 0.0, 0.0, 0.0
    first, a, b, c, clear = cell(bones, bone, x, y, z)
    if first < 0:
        if moves:
            note_far(bones.free, 1 + bone, point, x, y, z, clear)
        return 0.0, 0.0, 0.0, 0.0, clear
    if bones.smooth[bone]:
        d, (gx, gy, gz), _ = smooth_distance(bones, bone, first, a, b, c)
    else:
        d, gx, gy, gz = distance(bones, bone, first, a, b, c)
    p = -(d + bones.rest_depth[bone, point])
    if not p > 0.0:
        # between nodes of the grid the slope of what is interpolated can be above 1, but not above 2
        clear = -0.5 * p
        if moves:
            note_far(bones.free, 1 + bone, point, x, y, z, clear)
        return p, gx, gy, gz, clear
    if moves:
        R = ROTATION
        gx, gy, gz = (
            placement[instant, bone, R] * gx + placement[instant, bone, R + 1] * gy + placement[instant, bone, R + 2] * gz,
            placement[instant, bone, R + 3] * gx + placement[instant, bone, R + 4] * gy + placement[instant, bone, R + 5] * gz,
            placement[instant, bone, R + 6] * gx + placement[instant, bone, R + 7] * gy + placement[instant, bone, R + 8] * gz,
        )
    return p, gx, gy, gz, 0.0


@leaf
def penalty(spring, p, stiffening_depth):
    """Force [N], stiffness [N/m] and energy [J] of a contact point at depth p; force / p doubles over the stiffening depth."""
    share = p / stiffening_depth
    return spring * p * (1.0 + share), spring * (1.0 + 2.0 * share), spring * p * p * (0.5 + share / 3.0)


@leaf
def add_contact_stiffness(force, u, here, bones, placement, instant):
    """Add the change of the contact force from displacement ``here`` to u, linearised at the former, to the node rows.

    For the highest frequency: the stiffness g x g of the points that touch. The force itself bends at first touch and where g
    jumps from cell to cell, and a difference over a nanometre would take such a bend for a huge stiffness.
    """
    moving = 0
    for bone in range(len(bones.start)):
        moving += bones.moves[bone]
    for point in range(len(bones.node)):
        node = bones.node[point]
        if moving == 0 and is_far(bones.free, 0, point, here[node, 0], here[node, 1], here[node, 2]):
            continue
        x = bones.position[point, 0] + here[node, 0]
        y = bones.position[point, 1] + here[node, 1]
        z = bones.position[point, 2] + here[node, 2]
        for bone in range(len(bones.start)):
            p, gx, gy, gz, _ = depth_in(bones, bone, point, x, y, z, placement, instant)
            if p > 0.0:
                out = gx * (u[node, 0] - here[node, 0]) + gy * (u[node, 1] - here[node, 1]) + gz * (u[node, 2] - here[node, 2])
                _, stiffness, _ = penalty(bones.spring[point], p, STIFFENING_DEPTH_M)
                push = -stiffness * out
                force[node, 0] += push * gx
                force[node, 1] += push * gy
                force[node, 2] += push * gz


@leaf
def rest_on_bones(force, row, state, external, nodes, bones, placement, instant, near, far, recurrence, record):
    """Add the contact force on the points from ``near`` to ``far`` to the node rows ``force``, whose first is ``row``.

    Parameters
    ----------
    force : all other forces but the external ones on entry [N].
    state : State; its velocity is that of the half step before.
    external, nodes, bones, placement : of Shared and Actions, which are too large to be passed on at every step.
    recurrence : Recurrence.
    record : BoneRecord. Receives what each bone does.

    Returns
    -------
    loss, work : J. What the dampers and friction lose, and the work of the bones that move.
    stored : J. Elastic energy of the contact now.
    """
    u, v, _ = state
    keep, gain, ahead, behind = recurrence
    sums, pressure = record
    loss = work = stored = 0.0
    asked = len(sums) > 0
    moving = 0
    for bone in range(len(bones.start)):
        moving += bones.moves[bone]
    for point in range(near, far):
        node = bones.node[point]
        # of all bones that are fixed at once, by displacement
        away = is_far(bones.free, 0, point, u[node, 0], u[node, 1], u[node, 2])
        if away and moving == 0:
            continue
        x = bones.position[point, 0] + u[node, 0]
        y = bones.position[point, 1] + u[node, 1]
        z = bones.position[point, 2] + u[node, 2]
        least = math.inf
        touched = False
        dx = dy = dz = 0.0  # dampers and friction of all bones
        driven = 0.0  # their power against the bones' own speed
        for bone in range(len(bones.start)):
            if away and not bones.moves[bone]:
                continue
            p, gx, gy, gz, clear = depth_in(bones, bone, point, x, y, z, placement, instant)
            if not bones.moves[bone]:
                least = min(least, clear)
            if not p > 0.0:
                continue
            touched = True
            wx = wy = wz = 0.0
            if bones.moves[bone]:
                R = placement[instant, bone]
                wx = R[SPEED] + R[SPIN + 1] * z - R[SPIN + 2] * y
                wy = R[SPEED + 1] + R[SPIN + 2] * x - R[SPIN] * z
                wz = R[SPEED + 2] + R[SPIN] * y - R[SPIN + 1] * x
            push, _, energy = penalty(bones.spring[point], p, STIFFENING_DEPTH_M)
            stored += energy
            size = math.sqrt(gx * gx + gy * gy + gz * gz)
            ex, ey, ez = push * gx, push * gy, push * gz
            at = node - row
            force[at, 0] += ex
            force[at, 1] += ey
            force[at, 2] += ez
            mobility_x, mobility_y, mobility_z = (
                gain * nodes.inverse_mass[node, 0],
                gain * nodes.inverse_mass[node, 1],
                gain * nodes.inverse_mass[node, 2],
            )
            # mean velocity of the step without dampers, relative to the bone
            mx = 0.5 * ((1.0 + keep) * v[node, 0] + mobility_x * (force[at, 0] + external[node, 0])) - wx
            my = 0.5 * ((1.0 + keep) * v[node, 1] + mobility_y * (force[at, 1] + external[node, 1])) - wy
            mz = 0.5 * ((1.0 + keep) * v[node, 2] + mobility_z * (force[at, 2] + external[node, 2])) - wz
            mobility = max(mobility_x, max(mobility_y, mobility_z))
            nx, ny, nz = gx / size, gy / size, gz / size
            normal = mx * nx + my * ny + mz * nz
            damper = bones.damper[bone, point]
            brake = max(-damper * normal / (1.0 + 0.5 * mobility * damper), -push * size)
            tx, ty, tz = mx - normal * nx, my - normal * ny, mz - normal * nz
            drag = TANGENTIAL_DAMPER_SHARE * damper
            held_back = 1.0 + 0.5 * mobility * drag
            left = 1.0 / held_back  # of the speed along the bone
            if bones.friction[bone] > 0.0:
                # the speed s that is left of v solves s = v - (drag s + mu N s / (s + creep)) mobility / 2
                speed = math.sqrt(tx * tx + ty * ty + tz * tz)
                stopping = 0.5 * mobility * bones.friction[bone] * (push * size + brake)
                half = held_back * CREEP_M_S + stopping - speed
                left = 2.0 * CREEP_M_S / (half + math.sqrt(half * half + 4.0 * held_back * CREEP_M_S * speed))
            drag = -(1.0 - left) / (0.5 * mobility)
            bx, by, bz = brake * nx + drag * tx, brake * ny + drag * ty, brake * nz + drag * tz
            force[at, 0] += bx
            force[at, 1] += by
            force[at, 2] += bz
            dx, dy, dz = dx + bx, dy + by, dz + bz
            driven += bx * wx + by * wy + bz * wz
            if bones.moves[bone]:
                work += (ahead + behind) * ((ex + bx) * wx + (ey + by) * wy + (ez + bz) * wz)
            if asked:
                sums[bone, BONE_FORCE] += ex + bx
                sums[bone, BONE_FORCE + 1] += ey + by
                sums[bone, BONE_FORCE + 2] += ez + bz
                area = bones.spring[point] / CONTACT_STIFFNESS_PA_M
                sums[bone, BONE_AREA] += area
                sums[bone, BONE_DEPTH] = max(sums[bone, BONE_DEPTH], p)
                pressure[bone, point] = (push * size + brake) / area
        if not away and 0.0 < least < math.inf:
            note_far(bones.free, 0, point, u[node, 0], u[node, 1], u[node, 2], least)
        if touched:
            at = node - row
            for k, d in ((0, dx), (1, dy), (2, dz)):
                new = keep * v[node, k] + gain * nodes.inverse_mass[node, k] * (force[at, k] + external[node, k])
                loss -= d * (behind * v[node, k] + ahead * new)
            loss += (ahead + behind) * driven
    return loss, work, stored
