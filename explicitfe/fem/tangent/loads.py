"""How dead loads, follower fibres and ties change: the derivatives of forces/dead.py, forces/follower.py and forces/ties.py."""

from __future__ import annotations

import math

from explicitfe.fem.forces.follower import vertex
from explicitfe.fem.tangent.arrays import COMPONENTS
from explicitfe.platform.compiled.jit import leaf, part_of_kernels
from explicitfe.platform.compiled.simd import WIDTH, load, splat, store


@leaf
def add_dead_changes(loads, activation, instant, tangents):
    """Add the changes of the dead loads: those of their forces."""
    rows = tangents.u.shape[1]
    groups = len(tangents.u)
    if len(tangents.dead) == 0:
        return
    for of in range(len(loads.profile)):
        scale = activation[loads.profile[of], instant]
        if scale == 0.0:
            continue
        for entry in range(loads.start[of], loads.start[of + 1]):
            for group in range(groups):
                at = (group * rows + loads.node[entry]) * (COMPONENTS * WIDTH)
                for k in range(3):
                    change = scale * load(tangents.dead, ((entry * 3 + k) * groups + group) * WIDTH)
                    store(tangents.force, at + k * WIDTH, load(tangents.force, at + k * WIDTH) + change)


@leaf
def _vertex_change(fibres, point, changes, first):
    x, y, z = splat(0.0), splat(0.0), splat(0.0)
    for corner in range(8):
        at, weight = first + fibres.nodes[point, corner] * (COMPONENTS * WIDTH), fibres.weights[point, corner]
        x = x + weight * load(changes, at)
        y = y + weight * load(changes, at + WIDTH)
        z = z + weight * load(changes, at + 2 * WIDTH)
    return x, y, z


@leaf
def _add_at_vertex(fibres, point, force, first, f):
    for corner in range(8):
        at, weight = first + fibres.nodes[point, corner] * (COMPONENTS * WIDTH), fibres.weights[point, corner]
        for k in range(3):
            store(force, at + k * WIDTH, load(force, at + k * WIDTH) + weight * f[k])


@part_of_kernels
def add_fibre_changes(u, fibres, activation, instant, tangents):
    """Add the changes of the pull of follower fibres: T t changes by dT t + T (1 - t t) dx / |x|."""
    for fibre in range(len(fibres.profile)):
        scale = activation[fibres.profile[fibre], instant]
        if scale == 0.0:
            continue
        for point in range(fibres.start[fibre], fibres.start[fibre + 1] - 1):
            x, y, z = vertex(u, fibres, point)
            next_x, next_y, next_z = vertex(u, fibres, point + 1)
            X, Y, Z = next_x - x, next_y - y, next_z - z
            inverse = 1.0 / math.sqrt(X * X + Y * Y + Z * Z)
            X, Y, Z = X * inverse, Y * inverse, Z * inverse
            pull = scale * fibres.tension[point] * inverse
            for group in range(len(tangents.u)):
                first = group * (tangents.u.shape[1] * COMPONENTS * WIDTH)
                ax, ay, az = _vertex_change(fibres, point, tangents.u, first)
                bx, by, bz = _vertex_change(fibres, point + 1, tangents.u, first)
                dx, dy, dz = bx - ax, by - ay, bz - az
                along = (-pull) * (X * dx + Y * dy + Z * dz)
                if len(tangents.tension) > 0:
                    along = along + scale * load(tangents.tension, (point * len(tangents.u) + group) * WIDTH)
                f = (pull * dx + X * along, pull * dy + Y * along, pull * dz + Z * along)
                _add_at_vertex(fibres, point, tangents.force, first, f)
                _add_at_vertex(fibres, point + 1, tangents.force, first, (-f[0], -f[1], -f[2]))


@part_of_kernels
def add_tie_changes(ties, tangents):
    """Add the changes of the pull of ties, which is linear in the displacement."""
    moved, shift = tangents.tied, tangents.shift
    for group in range(len(tangents.u)):
        first = group * (tangents.u.shape[1] * COMPONENTS * WIDTH)
        shift[:] = 0.0
        for row in range(len(ties.node)):
            at = first + ties.node[row] * (COMPONENTS * WIDTH)
            for k in range(3):
                store(moved, (3 * row + k) * WIDTH, load(tangents.u, at + k * WIDTH))
        for row in range(len(ties.node)):
            x, y, z = splat(0.0), splat(0.0), splat(0.0)
            for entry in range(ties.start[row], ties.start[row + 1]):
                column, stiffness = 3 * ties.column[entry] * WIDTH, ties.stiffness[entry]
                x = x + stiffness * load(moved, column)
                y = y + stiffness * load(moved, column + WIDTH)
                z = z + stiffness * load(moved, column + 2 * WIDTH)
            bone = ties.bone[row]
            X, Y, Z = ties.normal[bone, 0], ties.normal[bone, 1], ties.normal[bone, 2]
            along = ties.excess[bone] * (x * X + y * Y + z * Z)
            f = (x + X * along, y + Y * along, z + Z * along)
            at = first + ties.node[row] * (COMPONENTS * WIDTH)
            for k in range(3):
                store(tangents.force, at + k * WIDTH, load(tangents.force, at + k * WIDTH) - f[k])
                place = (3 * bone + k) * WIDTH
                store(shift, place, load(shift, place) + f[k])
        for row in range(len(ties.node)):
            bone = ties.bone[row]
            share = ties.row_sum[row] / (ties.bone_stiffness[bone] + ties.total[bone])  # 0 for a bone that is fixed
            at = first + ties.node[row] * (COMPONENTS * WIDTH)
            for k in range(3):
                change = share * load(shift, (3 * bone + k) * WIDTH)
                store(tangents.force, at + k * WIDTH, load(tangents.force, at + k * WIDTH) + change)
