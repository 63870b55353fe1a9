"""Contact between deformable surfaces: of two bodies, or of a body with itself; points of either side against faces of the other.

A point of a face, with area A, that lies p deep below another face is pushed out along the unit vector e from its place to the
closest point there, and the corners of that face are pushed back by their shares w of the closest point,

    f = k A p (1 + p / p0) e / 2 - c v_n e - mu N v_t / |v_t|,   f_a = -w_a f,   c = zeta sqrt(k A m / 2),

with the velocity v relative to the face, and k and p0 the smaller ones of both faces. Both sides are searched, so each carries
half of the pressure. A point that touches a face does so until it has left that, however deep it is. As the direction to a
closest point is normal to the surface, or points to an edge, the first term derives from the energy k A (p^2 / 4 + p^3 / (6
p0)). Friction acts where the point is, so that the face also gets its moment about the closest point: forces and moments of a
pair add up to zero. A face is four triangles around its middle, with two by two Gauss points: points at nodes would lie on edges,
where the closest point may belong to another face. Friction is smoothed as in contact with bones (``bone.py``); it and the damper
take the velocity before the step.
"""

from __future__ import annotations

import math

from explicitfe.fem.forces.bone import penalty
from explicitfe.fem.forces.surface_search import find_touching
from explicitfe.platform.compiled.contact_arrays import REACH, RUBBING, SPEED, STIFFER
from explicitfe.platform.compiled.jit import leaf, part_of_kernels

# Two nodes approach each other by up to twice the distance that one moves in the last step. That step may have been twice as
# long as this one.
ENTRY_STEPS = 4.0
CREEP_M_S = 1e-3


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
def moment_of(surfaces, at, values):
    """Moment about the middle of the face below a point that touches, of the vectors that node rows have at its corners."""
    mx = my = mz = 0.0
    for corner in range(4):
        x, y, z = lever_arm(surfaces, at, corner)
        row = surfaces.node[surfaces.face[surfaces.touched[at], corner]]
        fx, fy, fz = values[row, 0], values[row, 1], values[row, 2]
        mx, my, mz = mx + y * fz - z * fy, my + z * fx - x * fz, mz + x * fy - y * fx
    return mx, my, mz


@leaf
def lever_arm(surfaces, at, corner):
    """Lever arm [m] of a corner about the middle of the face below a point that touches."""
    face = surfaces.touched[at]
    one = surfaces.face[face, corner]
    x, y, z = surfaces.place[one, 0], surfaces.place[one, 1], surfaces.place[one, 2]
    for k in range(4):
        other = surfaces.face[face, k]
        x -= 0.25 * surfaces.place[other, 0]
        y -= 0.25 * surfaces.place[other, 1]
        z -= 0.25 * surfaces.place[other, 2]
    return x, y, z


@leaf
def solve_inertia(surfaces, at, mx, my, mz):
    """Solve I a = m with the inertia tensor I [m^2] of unit masses at the corners of the face below a point that touches."""
    xx = yy = zz = xy = xz = yz = 0.0
    for corner in range(4):
        x, y, z = lever_arm(surfaces, at, corner)
        xx, yy, zz = xx + y * y + z * z, yy + x * x + z * z, zz + x * x + y * y
        xy, xz, yz = xy - x * y, xz - x * z, yz - y * z
    axx, axy, axz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    ayy, ayz, azz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    scale = 1.0 / (xx * axx + xy * axy + xz * axz)
    return (
        scale * (axx * mx + axy * my + axz * mz),
        scale * (axy * mx + ayy * my + ayz * mz),
        scale * (axz * mx + ayz * my + azz * mz),
    )


@leaf
def slip_velocity(surfaces, at, v):
    """Velocity of a point that touches relative to the face below it, which rotates about the closest point."""
    x, y, z = relative(surfaces, at, v)
    if surfaces.numbers[RUBBING] > 0.0:
        mx, my, mz = moment_of(surfaces, at, v)
        wx, wy, wz = solve_inertia(surfaces, at, mx, my, mz)
        ex, ey, ez, depth = surfaces.out[at, 0], surfaces.out[at, 1], surfaces.out[at, 2], surfaces.out[at, 3]
        x, y, z = x + depth * (wy * ez - wz * ey), y + depth * (wz * ex - wx * ez), z + depth * (wx * ey - wy * ex)
    return x, y, z


@leaf
def add_couple(surfaces, at, force, x, y, z):
    """Add to the corners of the face below a point that touches the moment of its friction force about the closest point."""
    ex, ey, ez, depth = surfaces.out[at, 0], surfaces.out[at, 1], surfaces.out[at, 2], surfaces.out[at, 3]
    ax, ay, az = solve_inertia(surfaces, at, depth * (ey * z - ez * y), depth * (ez * x - ex * z), depth * (ex * y - ey * x))
    for corner in range(4):
        rx, ry, rz = lever_arm(surfaces, at, corner)
        row = surfaces.node[surfaces.face[surfaces.touched[at], corner]]
        force[row, 0] += ay * rz - az * ry
        force[row, 1] += az * rx - ax * rz
        force[row, 2] += ax * ry - ay * rx


@leaf
def mobility_of(surfaces, at, nodes):
    """Relative acceleration of a point that touches and the face below it over a force between them [1/kg].

    The points around it have the same pressure: with the force of one point alone those on one node would brake it many times,
    and a surface that sticks would chatter.
    """
    point = surfaces.touching[at]
    mobility = 0.0
    for corner in range(4):
        one, other = surfaces.face[surfaces.point_face[point], corner], surfaces.face[surfaces.touched[at], corner]
        mobility += surfaces.share[point, corner] * surfaces.area[one] * nodes.inverse_mass[surfaces.node[one], 0]
        mobility += surfaces.weight[at, corner] * surfaces.area[other] * nodes.inverse_mass[surfaces.node[other], 0]
    return mobility / surfaces.part[point]


@leaf
def note_depths(surfaces):
    """Note the deepest point of each pair of bodies, if it is deeper than before."""
    for at in range(surfaces.touches[0]):
        a, b = surfaces.body[surfaces.point_face[surfaces.touching[at]]], surfaces.body[surfaces.touched[at]]
        surfaces.pairs[min(a, b), max(a, b)] = max(surfaces.pairs[min(a, b), max(a, b)], surfaces.out[at, 3])


@part_of_kernels
def add_surfaces(force, u, v, surfaces, nodes, gain):
    """Add the contact forces at displacement u to the node rows; give the elastic energy of the contact [J].

    Parameters
    ----------
    v : velocity of the half step before.
    gain : s. What a force over a mass adds to a velocity in this step.
    """
    square = 0.0
    for at in range(len(surfaces.node)):
        row = surfaces.node[at]
        square = max(square, v[row, 0] * v[row, 0] + v[row, 1] * v[row, 1] + v[row, 2] * v[row, 2])
    surfaces.numbers[SPEED] = math.sqrt(square)
    surfaces.numbers[REACH] = ENTRY_STEPS * math.sqrt(square) * gain
    energy = find_touching(surfaces, u)
    friction = surfaces.numbers[RUBBING]
    for at in range(surfaces.touches[0]):
        ex, ey, ez, depth = surfaces.out[at, 0], surfaces.out[at, 1], surfaces.out[at, 2], surfaces.out[at, 3]
        push, _, _ = penalty(surfaces.stiff[at, 0], depth, surfaces.stiff[at, 1])
        x, y, z = slip_velocity(surfaces, at, v)
        mobility = gain * mobility_of(surfaces, at, nodes)
        damper = surfaces.stiff[at, 2]
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
            add_couple(surfaces, at, force, along * x, along * y, along * z)
        bx, by, bz = brake * ex + along * x, brake * ey + along * y, brake * ez + along * z
        surfaces.brake[at, 0], surfaces.brake[at, 1], surfaces.brake[at, 2] = bx, by, bz
        surfaces.brake[at, 3] = bx * (x + normal * ex) + by * (y + normal * ey) + bz * (z + normal * ez)
        add_pair(surfaces, at, force, push * ex + bx, push * ey + by, push * ez + bz)
    note_depths(surfaces)
    return energy


@part_of_kernels
def surfaces_loss(surfaces, v, behind, ahead):
    """What dampers and friction lose in a step [J], with its new velocities; ``behind`` and ``ahead`` are half steps [s]."""
    loss = 0.0
    for at in range(surfaces.touches[0]):
        x, y, z = slip_velocity(surfaces, at, v)
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
        stiffness = surfaces.stiff[at, 0] * (surfaces.numbers[STIFFER] + 2.0 * surfaces.out[at, 3] / surfaces.stiff[at, 1])
        push = -stiffness * ((x - hx) * ex + (y - hy) * ey + (z - hz) * ez)
        add_pair(surfaces, at, force, push * ex, push * ey, push * ez)


@leaf
def add_surface_pressure(surfaces, pressure, pairs):
    """Write a sample: pressure at each node, in the user's numbering [Pa], and depths of pairs of bodies since the last one."""
    for at in range(len(pressure)):
        pressure[at] = 0.0
    if len(pressure) == 0:
        return
    for one in range(len(pairs)):
        for other in range(len(pairs)):
            pairs[one, other] = surfaces.pairs[one, other]
            surfaces.pairs[one, other] = 0.0
    note_depths(surfaces)
    for at in range(surfaces.touches[0]):
        point = surfaces.touching[at]
        push, _, _ = penalty(surfaces.stiff[at, 0], surfaces.out[at, 3], surfaces.stiff[at, 1])
        for corner in range(4):
            one, other = surfaces.face[surfaces.point_face[point], corner], surfaces.face[surfaces.touched[at], corner]
            pressure[surfaces.user[one]] += push * surfaces.share[point, corner] / surfaces.area[one]
            pressure[surfaces.user[other]] += push * surfaces.weight[at, corner] / surfaces.area[other]
