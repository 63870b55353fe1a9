"""Which points of deformable surfaces touch which faces; the forces are in ``surfaces.py``.

There are three stages: the faces near each face, by cells of a grid; of these the triangles near each point; and, in every step,
the closest of those triangles. The first two hold until a node has moved by a part of the skin. A face is four triangles around
its middle, and has two by two Gauss points on each of four pieces.

A point begins to touch a face that it lies no deeper below than it can have moved in the last step. From then on it is held:
the faces around the one that it touches are searched, at any depth, until it lies outside of them.
"""

from __future__ import annotations

import math

from explicitfe.fem.forces.bone import penalty
from explicitfe.fem.forces.closest_point import closest_on_triangle
from explicitfe.platform.compiled.contact_arrays import ALIKE, CELLS, FACES_NEAR, REACH, SKIN, TRIANGLES_NEAR, ZETA
from explicitfe.platform.compiled.jit import leaf, part_of_kernels

TIE_SHARE = 1e-9  # of a squared distance: triangles that are as near to a point have an edge or a corner in common
SLACK_SHARE = 0.1  # Fraction of the skin: nearby triangles are searched for again when a node has moved by half of it.
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
                            < surfaces.numbers[ALIKE]
                            and near < FACES_NEAR
                            and not is_own(surfaces, k, other)
                        ):
                            surfaces.near[k, near] = other
                            near += 1
                        other = chain[other]
        surfaces.near_count[k] = near
        if near > 0 or holds(surfaces, k):
            surfaces.active[active] = k
            active += 1
    surfaces.active_count[0] = active


@leaf
def holds(surfaces, face):
    """Whether a point of a face is held."""
    of_face = len(surfaces.point_face) // len(surfaces.face)
    held = -1
    for point in range(face * of_face, (face + 1) * of_face):
        held = max(held, surfaces.held[point])
    return held >= 0


@leaf
def find_close(surfaces, touching_face, margin):
    """Of the faces near a face, note those that it may touch after a move by the margin; give their number.

    Its box then reaches into theirs, and it does not lie outside of them.
    """
    place, face, middle = surfaces.place, surfaces.face, surfaces.middle
    p, q, r, s = face[touching_face, 0], face[touching_face, 1], face[touching_face, 2], face[touching_face, 3]
    close = 0
    for number in range(surfaces.near_count[touching_face]):
        other = surfaces.near[touching_face, number]
        apart = False
        for i in range(3):
            above = min(min(place[p, i], place[q, i]), min(place[r, i], place[s, i])) - margin
            below = max(max(place[p, i], place[q, i]), max(place[r, i], place[s, i])) + margin
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
        if lowest <= warp + margin * math.sqrt(nx * nx + ny * ny + nz * nz):
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
def square_to(surfaces, px, py, pz, triangle):
    """Squared distance of a point from a triangle, 4 times its face plus the corner that it begins at."""
    place, face, corner = surfaces.place, triangle // 4, triangle % 4
    first, second = surfaces.face[face, corner], surfaces.face[face, (corner + 1) % 4]
    ax, ay, az = place[first, 0], place[first, 1], place[first, 2]
    bx, by, bz = place[second, 0], place[second, 1], place[second, 2]
    mx, my, mz = surfaces.middle[face, 0], surfaces.middle[face, 1], surfaces.middle[face, 2]
    s, t = closest_on_triangle(px, py, pz, ax, ay, az, bx, by, bz, mx, my, mz)
    r = 1.0 - s - t
    dx, dy, dz = px - (r * ax + s * bx + t * mx), py - (r * ay + s * by + t * my), pz - (r * az + s * bz + t * mz)
    return dx * dx + dy * dy + dz * dz


@leaf
def look(surfaces, point, close, slack):
    """Note which triangles of the faces that are close a point may touch until a node has moved by half the slack.

    Distances change by at most the slack meanwhile. So a point further outside than that touches nothing, and the closest
    triangle will be one that is no further than twice the slack behind the closest one now. Of a point that is held the faces
    around the one that it touches count, at any depth. Give whether it waits.
    """
    px, py, pz = position_of(surfaces, point)
    best = math.inf
    tried = first = 0
    held = surfaces.held[point]
    if held >= 0:
        first = surfaces.own_start[held]
        close = min(surfaces.own_start[held + 1] - first, FACES_NEAR)
    for number in range(close):
        face = surfaces.own[first + number] if held >= 0 else surfaces.close[number]
        if held < 0 and (
            px < surfaces.low[face, 0] - slack or px > surfaces.high[face, 0] + slack
            or py < surfaces.low[face, 1] - slack or py > surfaces.high[face, 1] + slack
            or pz < surfaces.low[face, 2] - slack or pz > surfaces.high[face, 2] + slack
        ):  # fmt: skip
            continue
        for corner in range(4):
            distance = math.sqrt(square_to(surfaces, px, py, pz, 4 * face + corner))
            if held >= 0 or distance <= surfaces.deepest[face] + slack:
                surfaces.trial[tried] = 4 * face + corner
                surfaces.distance[tried] = distance
                best = min(best, distance)
                tried += 1
    count = 0
    for number in range(tried):
        if surfaces.distance[number] <= best + 2.0 * slack:
            if count == TRIANGLES_NEAR:  # of a mesh with needles: the furthest gives way
                last = 0
                for k in range(1, TRIANGLES_NEAR):
                    if square_to(surfaces, px, py, pz, surfaces.option[point, k]) > square_to(
                        surfaces, px, py, pz, surfaces.option[point, last]
                    ):
                        last = k
                if surfaces.distance[number] ** 2 >= square_to(surfaces, px, py, pz, surfaces.option[point, last]):
                    continue
                for k in range(last, TRIANGLES_NEAR - 1):
                    surfaces.option[point, k] = surfaces.option[point, k + 1]
                count -= 1
            surfaces.option[point, count] = surfaces.trial[number]
            count += 1
    surfaces.options[point] = count
    if count == 0 or (best > slack and not touch(surfaces, point, slack) < 0.0):
        return False
    surfaces.waiting[surfaces.waiting_count[0]] = point
    surfaces.waiting_count[0] += 1
    return True


@leaf
def touch(surfaces, point, slack):
    """How high a point of a face lies above the closest of its triangles [m], negative below it; infinite where none is close.

    What it touches is written to the next row of those that touch. A face is ``slack`` deeper than it is.
    """
    place = surfaces.place
    px, py, pz = position_of(surfaces, point)
    best = math.inf
    side = math.inf
    best_face = edge = -1
    at_first = at_second = False
    w0 = w1 = w2 = w3 = 0.0
    ox = oy = oz = 0.0
    tx = ty = tz = 0.0
    for number in range(surfaces.options[point]):
        face, corner = surfaces.option[point, number] // 4, surfaces.option[point, number] % 4
        mx, my, mz = surfaces.middle[face, 0], surfaces.middle[face, 1], surfaces.middle[face, 2]
        limit = math.inf if surfaces.held[point] >= 0 else (surfaces.deepest[face] + slack) ** 2
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
        return side
    if edge >= 0:  # the faces across the edge, or around the corner
        for turn in range(-1, 2):
            if turn == 0 or (turn < 0 and at_first) or (turn > 0 and at_second):
                side = max(side, height_above_next(surfaces, best_face, (edge + turn) % 4, ox, oy, oz))
    depth = math.sqrt(best)
    if depth > LEAST_DEPTH_M:
        tx, ty, tz = -ox / depth, -oy / depth, -oz / depth
    at = surfaces.touches[0]
    surfaces.touching[at] = point
    surfaces.touched[at] = best_face
    surfaces.weight[at, 0], surfaces.weight[at, 1], surfaces.weight[at, 2], surfaces.weight[at, 3] = w0, w1, w2, w3
    surfaces.out[at, 0], surfaces.out[at, 1], surfaces.out[at, 2], surfaces.out[at, 3] = tx, ty, tz, depth
    own = surfaces.point_face[point]
    spring = min(surfaces.stiffness[own], surfaces.stiffness[best_face]) * surfaces.part[point]
    surfaces.stiff[at, 0], surfaces.stiff[at, 1] = spring, min(surfaces.growth[own], surfaces.growth[best_face])
    surfaces.stiff[at, 2] = surfaces.numbers[ZETA] * math.sqrt(spring * surfaces.mass[point])
    return side


@leaf
def look_around(surfaces, slack):
    """Note for all points which triangles they may touch until a node has moved by half the slack."""
    place = surfaces.place
    for at in range(len(place)):
        for i in range(3):
            surfaces.looked[at, i] = place[at, i]
    surfaces.waiting_count[0] = 0
    of_face = len(surfaces.point_face) // max(len(surfaces.face), 1)
    for number in range(surfaces.active_count[0]):
        touching_face = surfaces.active[number]
        close = find_close(surfaces, touching_face, slack)
        for point in range(touching_face * of_face, (touching_face + 1) * of_face):
            if surfaces.held[point] >= 0 and not look(surfaces, point, close, slack):
                surfaces.held[point] = -1
            if surfaces.held[point] < 0 and close > 0:
                look(surfaces, point, close, slack)


@part_of_kernels
def find_touching(surfaces, u):
    """Find which points touch which faces at displacement u; give the elastic energy of the contact [J]."""
    place, numbers = surfaces.place, surfaces.numbers
    surfaces.touches[0] = 0
    search_due = look_due = False
    slack = SLACK_SHARE * numbers[SKIN]
    limit, look_limit = 0.25 * numbers[SKIN] * numbers[SKIN], 0.25 * slack * slack
    for at in range(len(place)):
        row = surfaces.node[at]
        away = since_look = 0.0
        for k in range(3):
            place[at, k] = surfaces.position[at, k] + u[row, k]
            step = place[at, k] - surfaces.seen[at, k]
            away += step * step
            step = place[at, k] - surfaces.looked[at, k]
            since_look += step * step
        if not away <= limit:  # also before the first search
            search_due = True
        if not since_look <= look_limit:
            look_due = True
    find_middles(surfaces)
    if search_due:
        search(surfaces)
    if search_due or look_due:
        look_around(surfaces, slack)
    energy = 0.0
    for number in range(surfaces.waiting_count[0]):
        point = surfaces.waiting[number]
        inside = touch(surfaces, point, 0.0) < 0.0
        at = surfaces.touches[0]
        depth = surfaces.out[at, 3]
        if inside and (surfaces.held[point] >= 0 or depth <= numbers[REACH]):
            energy += penalty(surfaces.stiff[at, 0], depth, surfaces.stiff[at, 1])[2]
            surfaces.held[point] = surfaces.touched[at]
            surfaces.touches[0] = at + 1
        else:
            surfaces.held[point] = -1
    return energy


def find_touching_at_rest(surfaces, u):
    """``find_touching`` as an entry of its own."""
    return find_touching(surfaces, u)
