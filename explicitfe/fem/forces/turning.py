"""Follower forces on nodes: their components are constant along axes that turn with an element.

The axes are those of an element at the node: e1 along the mean of its edges of the first natural direction, e3 normal to
the means of the first two, e2 = e3 x e1. A rigid rotation turns them exactly. Such a force has no potential in general, so its
work depends on the path.
"""

from __future__ import annotations

import math

from explicitfe.platform.compiled.jit import leaf

# Corners 1, 2, 5, 6 of a hexahedron lie at +1 of the first natural direction, corners 2, 3, 6, 7 at +1 of the second one.


@leaf
def axes_of(corners, position, u):
    """Unit vectors e1, e2, e3 of an element at displacement u, as nine numbers."""
    ax = ay = az = bx = by = bz = 0.0
    for corner in range(8):
        node = corners[corner]
        x = position[corner, 0] + u[node, 0]
        y = position[corner, 1] + u[node, 1]
        z = position[corner, 2] + u[node, 2]
        first = 1.0 if corner == 1 or corner == 2 or corner == 5 or corner == 6 else -1.0
        second = 1.0 if corner == 2 or corner == 3 or corner == 6 or corner == 7 else -1.0
        ax, ay, az = ax + first * x, ay + first * y, az + first * z
        bx, by, bz = bx + second * x, by + second * y, bz + second * z
    size = 1.0 / math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax * size, ay * size, az * size
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = 1.0 / math.sqrt(cx * cx + cy * cy + cz * cz)
    cx, cy, cz = cx * size, cy * size, cz * size
    return ax, ay, az, cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax, cx, cy, cz


@leaf
def add_turning_loads(force, u, loads, activation, instant):
    """Add the loads at displacement u to the node rows."""
    for entry in range(len(loads.node)):
        scale = activation[loads.profile[entry], instant]
        if scale != 0.0:
            ax, ay, az, bx, by, bz, cx, cy, cz = axes_of(loads.corners[entry], loads.position[entry], u)
            node = loads.node[entry]
            a, b, c = scale * loads.force[entry, 0], scale * loads.force[entry, 1], scale * loads.force[entry, 2]
            force[node, 0] += a * ax + b * bx + c * cx
            force[node, 1] += a * ay + b * by + c * cy
            force[node, 2] += a * az + b * bz + c * cz
