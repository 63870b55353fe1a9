"""Contact between deformable surfaces: of two bodies, or of a body with itself; points of either side against faces of the other.

A point of a face, with area A, that lies p deep below another face is pushed out along the unit vector e from its place to the
closest point there, and the corners of that face are pushed back by their shares w of the closest point,

    f = k A p e / 2 - c v_n e - mu N v_t / |v_t|,   f_a = -w_a f,   c = zeta sqrt(k A m / 2),

with the velocity v relative to the face. Both sides are searched, so each carries half of the pressure. As the direction to a
closest point is normal to the surface, or points to an edge, the first term derives from the energy k A p^2 / 4; forces and
moments of a pair add up to zero. A face is four triangles around its middle, with two by two Gauss points: points at nodes would
lie on edges, where the closest point may belong to another face. Friction is smoothed as in contact with bones (``bone.py``); it
and the damper take the velocity before the step.
"""

from __future__ import annotations

import math

from explicitfe.fem.forces.bone import CREEP_M_S
from explicitfe.fem.forces.closest_point import closest_on_triangle
from explicitfe.platform.compiled.contact_arrays import CELLS, FACES_NEAR, RUBBING, SKIN
from explicitfe.platform.compiled.jit import leaf, part_of_kernels

DAMPING_RATIO = 0.2  # zeta, of two equal surfaces that press on each other
# A damper that takes the velocity before the step shortens the stable step to sqrt(1 + zeta^2) - zeta of that without it
# (Belytschko et al. 2014, section 6.2.3), as if the spring were stiffer by the inverse square of that.
STIFFER = 1.0 / (math.sqrt(1.0 + DAMPING_RATIO**2) - DAMPING_RATIO) ** 2
TIE_SHARE = 1e-9  # of a squared distance: triangles that are as near to a point have an edge or a corner in common
MOST_ALIKE = 0.5  # faces whose normals have a larger cosine are skipped: they are on opposite sides of a wall
LEAST_DEPTH_M = 1e-9  # below which the direction to a closest point is rounding


@leaf
def is_own(surfaces, touching_face, face):
    """Whether a face is among those that the points of another one never touch."""
    low, high = surfaces.own_start[touching_face], surfaces.own_start[touching_face + 1]
    while low < high:
        middle = (low + high) // 2
        if surfaces.own[middle] < face:
            low = middle + 1
        else:
            high = middle
    return low < surfaces.own_start[touching_face + 1] and surfaces.own[low] == face


@leaf
def position_of(surfaces, point):
    """Where a point of a face is now."""
    face = surfaces.point_face[point]
    x = y = z = 0.0
    for corner in range(4):
        at, share = surfaces.face[face, corner], surfaces.share[point, corner]
        x += share * surfaces.place[at, 0]
        y += share * surfaces.place[at, 1]
        z += share * surfaces.place[at, 2]
    return x, y, z


@leaf
def find_middles(surfaces):
    """Write the middles of the faces."""
    place, face, middle = surfaces.place, surfaces.face, surfaces.middle
    for k in range(len(face)):
        a, b, c, d = face[k, 0], face[k, 1], face[k, 2], face[k, 3]
        for i in range(3):
            middle[k, i] = 0.25 * (place[a, i] + place[b, i] + place[c, i] + place[d, i])


@leaf
def search(surfaces):
    """Find the faces near each face, so that none is missed until a node has moved by half the skin."""
    place, face, low, high = surfaces.place, surfaces.face, surfaces.low, surfaces.high
    middle, normal, head, chain = surfaces.middle, surfaces.normal, surfaces.head, surfaces.chain
    for at in range(len(place)):
        for i in range(3):
            surfaces.seen[at, i] = place[at, i]
    deepest = surfaces.deepest
    widest = extent = 0.0
    start_x = start_y = start_z = math.inf
    for k in range(len(face)):
        a, b, c, d = face[k, 0], face[k, 1], face[k, 2], face[k, 3]
        margin = deepest[k] + 0.5 * surfaces.numbers[SKIN]
        for i in range(3):
            low[k, i] = min(min(place[a, i], place[b, i]), min(place[c, i], place[d, i])) - margin
            high[k, i] = max(max(place[a, i], place[b, i]), max(place[c, i], place[d, i])) + margin
            widest = max(widest, high[k, i] - low[k, i])
        ux, uy, uz = place[c, 0] - place[a, 0], place[c, 1] - place[a, 1], place[c, 2] - place[a, 2]
        vx, vy, vz = place[d, 0] - place[b, 0], place[d, 1] - place[b, 1], place[d, 2] - place[b, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        unit = 1.0 / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
        normal[k, 0], normal[k, 1], normal[k, 2] = nx * unit, ny * unit, nz * unit
        start_x, start_y, start_z = min(start_x, middle[k, 0]), min(start_y, middle[k, 1]), min(start_z, middle[k, 2])
    for k in range(len(face)):
        far = max(middle[k, 0] - start_x, max(middle[k, 1] - start_y, middle[k, 2] - start_z))
        extent = max(extent, far)
    # Middles of boxes that overlap lie in cells side by side.
    scale = 1.0 / max(widest, extent / (CELLS - 1))
    for cell in range(len(head)):
        head[cell] = -1
    for back in range(len(face)):
        k = len(face) - 1 - back  # chains rise
        ix, iy = int((middle[k, 0] - start_x) * scale), int((middle[k, 1] - start_y) * scale)
        cell = (ix * CELLS + iy) * CELLS + int((middle[k, 2] - start_z) * scale)
        chain[k] = head[cell]
        head[cell] = k
    active = 0
    for k in range(len(face)):
        near = 0
        ix, iy = int((middle[k, 0] - start_x) * scale), int((middle[k, 1] - start_y) * scale)
        iz = int((middle[k, 2] - start_z) * scale)
        for jx in range(max(0, ix - 1), min(CELLS, ix + 2)):
            for jy in range(max(0, iy - 1), min(CELLS, iy + 2)):
                for jz in range(max(0, iz - 1), min(CELLS, iz + 2)):
                    other = head[(jx * CELLS + jy) * CELLS + jz]
                    while other >= 0:
                        if (
                            low[k, 0] + deepest[k] <= high[other, 0]
                            and low[other, 0] <= high[k, 0] - deepest[k]
                            and low[k, 1] + deepest[k] <= high[other, 1]
                            and low[other, 1] <= high[k, 1] - deepest[k]
                            and low[k, 2] + deepest[k] <= high[other, 2]
                            and low[other, 2] <= high[k, 2] - deepest[k]
                            and normal[k, 0] * normal[other, 0]
                            + normal[k, 1] * normal[other, 1]
                            + normal[k, 2] * normal[other, 2]
                            < MOST_ALIKE
                            and near < FACES_NEAR
                            and not is_own(surfaces, k, other)
                        ):
                            surfaces.near[k, near] = other
                            near += 1
                        other = chain[other]
        surfaces.near_count[k] = near
        if near > 0:
            surfaces.active[active] = k
            active += 1
    surfaces.active_count[0] = active


@leaf
def find_close(surfaces, touching_face):
    """Of the faces near a face, note those that reach into its box and that it does not lie outside of; give their number."""
    place, face, middle = surfaces.place, surfaces.face, surfaces.middle
    p, q, r, s = face[touching_face, 0], face[touching_face, 1], face[touching_face, 2], face[touching_face, 3]
    close = 0
    for number in range(surfaces.near_count[touching_face]):
        other = surfaces.near[touching_face, number]
        apart = False
        for i in range(3):
            above = min(min(place[p, i], place[q, i]), min(place[r, i], place[s, i]))
            below = max(max(place[p, i], place[q, i]), max(place[r, i], place[s, i]))
            apart = apart or above > surfaces.high[other, i] or below < surfaces.low[other, i]
        if apart:
            continue
        a, b, c, d = face[other, 0], face[other, 1], face[other, 2], face[other, 3]
        ux, uy, uz = place[c, 0] - place[a, 0], place[c, 1] - place[a, 1], place[c, 2] - place[a, 2]
        vx, vy, vz = place[d, 0] - place[b, 0], place[d, 1] - place[b, 1], place[d, 2] - place[b, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        x, y, z = middle[other, 0], middle[other, 1], middle[other, 2]
        warp, lowest = 0.0, math.inf
        for corner in range(4):
            at = face[other, corner]
            height = (place[at, 0] - x) * nx + (place[at, 1] - y) * ny + (place[at, 2] - z) * nz
            warp = max(warp, abs(height))
            at = face[touching_face, corner]
            lowest = min(lowest, (place[at, 0] - x) * nx + (place[at, 1] - y) * ny + (place[at, 2] - z) * nz)
        if lowest <= warp:
            surfaces.close[close] = other
            close += 1
    return close


@leaf
def height_above_next(surfaces, face, edge, dx, dy, dz):
    """How far a vector from an edge of a face rises above the face across it; minus infinity where there is none."""
    other = surfaces.across[face, edge, 0]
    if other < 0:
        return -math.inf
    corner = surfaces.across[face, edge, 1]
    place = surfaces.place
    a, b = surfaces.face[other, corner], surfaces.face[other, (corner + 1) % 4]
    ux, uy, uz = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1], place[b, 2] - place[a, 2]
    x, y, z = surfaces.middle[other, 0], surfaces.middle[other, 1], surfaces.middle[other, 2]
    vx, vy, vz = x - place[a, 0], y - place[a, 1], z - place[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return (nx * dx + ny * dy + nz * dz) / math.sqrt(nx * nx + ny * ny + nz * nz)


@leaf
def touch(surfaces, point, close):
    """Note whether and how a point of a face touches one of the faces that are close; give the elastic energy [J]."""
    place = surfaces.place
    px, py, pz = position_of(surfaces, point)
    best = math.inf
    side = 0.0
    best_face = edge = -1
    at_first = at_second = False
    w0 = w1 = w2 = w3 = 0.0
    ox = oy = oz = 0.0
    tx = ty = tz = 0.0
    for number in range(close):
        face = surfaces.close[number]
        if (
            px < surfaces.low[face, 0] or px > surfaces.high[face, 0]
            or py < surfaces.low[face, 1] or py > surfaces.high[face, 1]
            or pz < surfaces.low[face, 2] or pz > surfaces.high[face, 2]
        ):  # fmt: skip
            continue
        mx, my, mz = surfaces.middle[face, 0], surfaces.middle[face, 1], surfaces.middle[face, 2]
        limit = surfaces.deepest[face] ** 2
        for corner in range(4):
            first, second = surfaces.face[face, corner], surfaces.face[face, (corner + 1) % 4]
            ax, ay, az = place[first, 0], place[first, 1], place[first, 2]
            bx, by, bz = place[second, 0], place[second, 1], place[second, 2]
            s, t = closest_on_triangle(px, py, pz, ax, ay, az, bx, by, bz, mx, my, mz)
            r = 1.0 - s - t
            dx = px - (r * ax + s * bx + t * mx)
            dy = py - (r * ay + s * by + t * my)
            dz = pz - (r * az + s * bz + t * mz)
            square = dx * dx + dy * dy + dz * dz
            if square > limit or square > best * (1.0 + TIE_SHARE):
                continue
            ux, uy, uz = bx - ax, by - ay, bz - az
            vx, vy, vz = mx - ax, my - ay, mz - az
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            nx, ny, nz = nx / size, ny / size, nz / size
            above = nx * dx + ny * dy + nz * dz
            if square >= best * (1.0 - TIE_SHARE):
                side = max(side, above)  # inside is what lies below all triangles that share the closest point
            else:
                side = above
                best = square
                best_face = face
                edge = corner if t == 0.0 else -1
                at_first, at_second = s == 0.0, r == 0.0
                share = 0.25 * t
                w0 = share + (r if corner == 0 else 0.0) + (s if corner == 3 else 0.0)
                w1 = share + (r if corner == 1 else 0.0) + (s if corner == 0 else 0.0)
                w2 = share + (r if corner == 2 else 0.0) + (s if corner == 1 else 0.0)
                w3 = share + (r if corner == 3 else 0.0) + (s if corner == 2 else 0.0)
                ox, oy, oz = dx, dy, dz
                tx, ty, tz = nx, ny, nz
    if best_face < 0:
        return 0.0
    if edge >= 0:  # the faces across the edge, or around the corner
        for turn in range(-1, 2):
            if turn == 0 or (turn < 0 and at_first) or (turn > 0 and at_second):
                side = max(side, height_above_next(surfaces, best_face, (edge + turn) % 4, ox, oy, oz))
    if not side < 0.0:
        return 0.0
    depth = math.sqrt(best)
    if depth > LEAST_DEPTH_M:
        tx, ty, tz = -ox / depth, -oy / depth, -oz / depth
    stiff = surfaces.spring[point]
    at = surfaces.touches[0]
    surfaces.touching[at] = point
    surfaces.touched[at] = best_face
    surfaces.weight[at, 0], surfaces.weight[at, 1], surfaces.weight[at, 2], surfaces.weight[at, 3] = w0, w1, w2, w3
    surfaces.out[at, 0], surfaces.out[at, 1], surfaces.out[at, 2], surfaces.out[at, 3] = tx, ty, tz, depth
    surfaces.stiff[at, 0], surfaces.stiff[at, 1] = stiff, surfaces.damper[point]
    surfaces.touches[0] = at + 1
    return 0.5 * stiff * depth * depth


@part_of_kernels
def find_touching(surfaces, u):
    """Find which points touch which faces at displacement u; give the elastic energy of the contact [J]."""
    place, numbers = surfaces.place, surfaces.numbers
    surfaces.touches[0] = 0
    due = False
    limit = 0.25 * numbers[SKIN] * numbers[SKIN]
    for at in range(len(place)):
        row = surfaces.node[at]
        away = 0.0
        for k in range(3):
            place[at, k] = surfaces.position[at, k] + u[row, k]
            step = place[at, k] - surfaces.seen[at, k]
            away += step * step
        if not away <= limit:  # also before the first search
            due = True
    find_middles(surfaces)
    if due:
        search(surfaces)
    energy = 0.0
    of_face = len(surfaces.point_face) // max(len(surfaces.face), 1)
    for number in range(surfaces.active_count[0]):
        touching_face = surfaces.active[number]
        close = find_close(surfaces, touching_face)
        if close > 0:
            for point in range(touching_face * of_face, (touching_face + 1) * of_face):
                energy += touch(surfaces, point, close)
    return energy


@leaf
def relative(surfaces, at, values):
    """What node rows say of a point that touches, less what they say of the point of the face below it."""
    point = surfaces.touching[at]
    x = y = z = 0.0
    for corner in range(4):
        one = surfaces.node[surfaces.face[surfaces.point_face[point], corner]]
        other = surfaces.node[surfaces.face[surfaces.touched[at], corner]]
        share, w = surfaces.share[point, corner], surfaces.weight[at, corner]
        x += share * values[one, 0] - w * values[other, 0]
        y += share * values[one, 1] - w * values[other, 1]
        z += share * values[one, 2] - w * values[other, 2]
    return x, y, z


@leaf
def add_pair(surfaces, at, force, x, y, z):
    """Add a force on a point that touches to the corners of its face, and its reaction to those of the other."""
    point = surfaces.touching[at]
    for corner in range(4):
        one = surfaces.node[surfaces.face[surfaces.point_face[point], corner]]
        share = surfaces.share[point, corner]
        force[one, 0] += share * x
        force[one, 1] += share * y
        force[one, 2] += share * z
    for corner in range(4):
        other = surfaces.node[surfaces.face[surfaces.touched[at], corner]]
        w = surfaces.weight[at, corner]
        force[other, 0] -= w * x
        force[other, 1] -= w * y
        force[other, 2] -= w * z


@leaf
def mobility_of(surfaces, at, nodes):
    """Relative acceleration of a point that touches and the face below it over a force between them [1/kg]."""
    point = surfaces.touching[at]
    mobility = 0.0
    for corner in range(4):
        one = surfaces.node[surfaces.face[surfaces.point_face[point], corner]]
        other = surfaces.node[surfaces.face[surfaces.touched[at], corner]]
        mobility += surfaces.share[point, corner] ** 2 * nodes.inverse_mass[one, 0]
        mobility += surfaces.weight[at, corner] ** 2 * nodes.inverse_mass[other, 0]
    return mobility


@part_of_kernels
def add_surfaces(force, u, v, surfaces, nodes, gain):
    """Add the contact forces at displacement u to the node rows; give the elastic energy of the contact [J].

    Parameters
    ----------
    v : velocity of the half step before.
    gain : s. What a force over a mass adds to a velocity in this step.
    """
    energy = find_touching(surfaces, u)
    friction = surfaces.numbers[RUBBING]
    for at in range(surfaces.touches[0]):
        ex, ey, ez, depth = surfaces.out[at, 0], surfaces.out[at, 1], surfaces.out[at, 2], surfaces.out[at, 3]
        push = surfaces.stiff[at, 0] * depth
        x, y, z = relative(surfaces, at, v)
        mobility = gain * mobility_of(surfaces, at, nodes)
        damper = surfaces.stiff[at, 1]
        normal = x * ex + y * ey + z * ez
        brake = max(-damper * normal / (1.0 + 0.5 * mobility * damper), -push)  # it never pulls
        x, y, z = x - normal * ex, y - normal * ey, z - normal * ez
        along = 0.0
        if friction > 0.0 and mobility > 0.0:  # the share of the speed that is left, as in contact with bones
            speed = math.sqrt(x * x + y * y + z * z)
            stopping = 0.5 * mobility * friction * (push + brake)
            half = CREEP_M_S + stopping - speed
            left = 2.0 * CREEP_M_S / (half + math.sqrt(half * half + 4.0 * CREEP_M_S * speed))
            along = -(1.0 - left) / (0.5 * mobility)
        bx, by, bz = brake * ex + along * x, brake * ey + along * y, brake * ez + along * z
        surfaces.brake[at, 0], surfaces.brake[at, 1], surfaces.brake[at, 2] = bx, by, bz
        surfaces.brake[at, 3] = bx * (x + normal * ex) + by * (y + normal * ey) + bz * (z + normal * ez)
        add_pair(surfaces, at, force, push * ex + bx, push * ey + by, push * ez + bz)
    return energy


@part_of_kernels
def surfaces_loss(surfaces, v, behind, ahead):
    """What dampers and friction lose in a step [J], with its new velocities; ``behind`` and ``ahead`` are half steps [s]."""
    loss = 0.0
    for at in range(surfaces.touches[0]):
        x, y, z = relative(surfaces, at, v)
        brake = surfaces.brake
        loss -= behind * brake[at, 3] + ahead * (brake[at, 0] * x + brake[at, 1] * y + brake[at, 2] * z)
    return loss


@part_of_kernels
def add_surfaces_stiffness(force, u, here, surfaces):
    """Add the change of the contact forces from displacement ``here`` to u, linearised at the former, for the stable step."""
    find_touching(surfaces, here)
    for at in range(surfaces.touches[0]):
        x, y, z = relative(surfaces, at, u)
        hx, hy, hz = relative(surfaces, at, here)
        ex, ey, ez = surfaces.out[at, 0], surfaces.out[at, 1], surfaces.out[at, 2]
        push = -STIFFER * surfaces.stiff[at, 0] * ((x - hx) * ex + (y - hy) * ey + (z - hz) * ez)
        add_pair(surfaces, at, force, push * ex, push * ey, push * ez)


@leaf
def add_surface_pressure(surfaces, pressure):
    """Write the pressure at each node into a row of the user's numbering [Pa]; the contact is that of the last search."""
    for at in range(len(pressure)):
        pressure[at] = 0.0
    if len(pressure) == 0:
        return
    for at in range(surfaces.touches[0]):
        point = surfaces.touching[at]
        push = surfaces.stiff[at, 0] * surfaces.out[at, 3]
        for corner in range(4):
            one, other = surfaces.face[surfaces.point_face[point], corner], surfaces.face[surfaces.touched[at], corner]
            pressure[surfaces.user[one]] += push * surfaces.share[point, corner] / surfaces.area[one]
            pressure[surfaces.user[other]] += push * surfaces.weight[at, corner] / surfaces.area[other]


def find_touching_at_rest(surfaces, u):
    """``find_touching`` as an entry of its own."""
    return find_touching(surfaces, u)
