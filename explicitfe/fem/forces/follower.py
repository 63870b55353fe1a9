"""Tense fibres that turn with the deformation: each vertex of a polyline is pulled along the segments that meet there.

A segment under tension T pulls its two ends together, T t and -T t with t the unit vector along it as it lies now. So the
resultant and the moment of every fibre are zero at every instant, and the bends in between are pushed inwards.
"""

from __future__ import annotations

import math

from explicitfe.platform.compiled.jit import leaf


@leaf
def add_follower_fibres(force, u, fibres, activation, instant):
    """Add the pull of the fibres at displacement u to the node rows."""
    for fibre in range(len(fibres.profile)):
        scale = activation[fibres.profile[fibre], instant]
        if scale == 0.0:
            continue
        first, last = fibres.start[fibre], fibres.start[fibre + 1] - 1
        x, y, z = vertex(u, fibres, first)
        before_x = before_y = before_z = 0.0  # pull of the segment before, on its far end
        for point in range(first, last + 1):
            pull_x = pull_y = pull_z = 0.0
            if point < last:
                next_x, next_y, next_z = vertex(u, fibres, point + 1)
                dx, dy, dz = next_x - x, next_y - y, next_z - z
                factor = scale * fibres.tension[point] / math.sqrt(dx * dx + dy * dy + dz * dz)
                pull_x, pull_y, pull_z = factor * dx, factor * dy, factor * dz
                x, y, z = next_x, next_y, next_z
            fx, fy, fz = pull_x - before_x, pull_y - before_y, pull_z - before_z
            before_x, before_y, before_z = pull_x, pull_y, pull_z
            for corner in range(8):
                node, weight = fibres.nodes[point, corner], fibres.weights[point, corner]
                force[node, 0] += weight * fx
                force[node, 1] += weight * fy
                force[node, 2] += weight * fz


@leaf
def vertex(u, fibres, point):
    """Present position of a vertex."""
    x, y, z = fibres.position[point, 0], fibres.position[point, 1], fibres.position[point, 2]
    for corner in range(8):
        node, weight = fibres.nodes[point, corner], fibres.weights[point, corner]
        x += weight * u[node, 0]
        y += weight * u[node, 1]
        z += weight * u[node, 2]
    return x, y, z
