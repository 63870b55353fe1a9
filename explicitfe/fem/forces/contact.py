"""Contact of a body's surface with a rigid tool of revolution that moves along -z.

The tool is known by its distance function g, so a contact needs no search. The surface is sampled at points of its faces, not at
its nodes alone: a face then bends around an edge instead of cutting through it, and the force grows smoothly while a face comes
into contact. Where a point is inside (g < 0) a stiff spring pushes it out along the normal: the energy is the sum of 1/2 k g^2,
so frictionless contact is conservative. A tool under a force is massless: its way is found anew in every iteration, such
that the springs balance the force. Friction is Coulomb's, with an elastic slip that is small beside the elements; its anchor
is that of the last converged state, so the answer does not depend on how an iteration got there.
"""

from __future__ import annotations

import math

from explicitfe.platform.compiled.arrays import (
    ADHESION,
    COMPLIANCE,
    DEPTH,
    DRIVE,
    EDGE_RADIUS,
    FLAT_RADIUS,
    FREE,
    FRICTION,
    LOAD,
    LOWEST,
    REACH,
    TIED,
    TILT,
    WALL,
)
from explicitfe.platform.compiled.jit import leaf

# The depth of a tool under a force is found by Newton's method. It is exact once it is known which points touch, and that is
# known when a turn began from an imbalance below this share of the force.
NEWTON_TURNS = 30
LAST_TURN_IMBALANCE_SHARE = 1e-3


@leaf
def clearance(x, y, z, shape, depth):
    """Distance [m] of a point from the tool, negative inside, and the normal out of the tool."""
    if shape[TILT] == 0.0:
        return upright(x, y, z - (shape[LOWEST] - depth), shape)
    # the tool leans about the y axis through the middle of its face: look from where it stands upright
    c, s = math.cos(shape[TILT]), math.sin(shape[TILT])
    above = z - (shape[LOWEST] - depth)
    gap, nx, ny, nz = upright(c * x - s * above, y, s * x + c * above, shape)
    return gap, c * nx + s * nz, ny, c * nz - s * nx


@leaf
def upright(x, y, above, shape):
    """Distance and normal for an upright tool; ``above`` is the height over its lowest point."""
    r = math.sqrt(x * x + y * y)
    out, edge = r - shape[FLAT_RADIUS], shape[EDGE_RADIUS]
    if shape[TIED] > 0.0 or out <= 0.0:
        return -above, 0.0, 0.0, -1.0
    if shape[WALL] > 0.0 and above >= edge:
        return out - edge, x / r, y / r, 0.0
    up = above - edge
    d = math.sqrt(out * out + up * up)
    if d == 0.0:  # at the centre of the rounding every direction is as good
        return -edge, 0.0, 0.0, -1.0
    return d - edge, out / d * (x / r), out / d * (y / r), up / d


@leaf
def shape_of(contact):
    """The tool's shape as plain numbers: references to an array that is handed on are counted, which costs more than the rest."""
    shape = contact.shape
    return shape[0], shape[1], shape[2], shape[3], shape[4], shape[5], shape[6], shape[7], shape[8]


@leaf
def push_at(gap, spring, area, shape):
    """Normal force of the tool on a point [N], negative where it sticks to it, and its slope [N/m]."""
    if gap < 0.0 or shape[TIED] > 0.0:
        return -spring * gap - shape[ADHESION] * area, spring
    if gap < shape[REACH]:
        hold = shape[ADHESION] * area
        return -hold * (1.0 - gap / shape[REACH]), -hold / shape[REACH]
    return 0.0, 0.0


@leaf
def follow(u, contact, number, count):
    """Note the displacements of the contact points, of share ``number`` of ``count`` shares: what else is here reads them."""
    points = len(contact.spring)
    for point in range(number * points // count, (number + 1) * points // count):
        x = y = z = 0.0
        for corner in range(4):
            node, weight = contact.node[point, corner], contact.weight[point, corner]
            x += weight * u[node, 0]
            y += weight * u[node, 1]
            z += weight * u[node, 2]
        contact.moved[point, 0], contact.moved[point, 1], contact.moved[point, 2] = x, y, z


@leaf
def find_depth(contact, tool):
    """Move a tool under a force to where the springs balance it, and a tool in a rig that gives way to where the rig does."""
    soft = tool[COMPLIANCE] > 0.0
    shape = shape_of(contact)
    moved, position, anchor = contact.moved, contact.position, contact.anchor
    if tool[FREE] > 0.0 or soft:
        depth = tool[DEPTH]
        for _ in range(NEWTON_TURNS):
            force = 0.0
            slope = 0.0
            nearest = math.inf
            for point in range(len(contact.spring)):
                x, y, z = moved[point, 0], moved[point, 1], moved[point, 2]
                gap, nx, ny, nz = clearance(x + position[point, 0], y + position[point, 1], z + position[point, 2], shape, depth)
                push, stiff = push_at(gap, contact.spring[point], contact.area[point], shape)
                if stiff != 0.0:
                    grip = contact.grip[point]
                    sx, sy, sz = x - anchor[point, 0], y - anchor[point, 1], z + depth - anchor[point, 2]
                    _, _, rubbing = friction(sx, sy, sz, nx, ny, nz, push, grip, shape)
                    force -= push * nz + rubbing
                    slope += max(stiff, 0.0) * nz * nz + grip * (1.0 - nz * nz)
                elif nz < 0.0:
                    nearest = min(nearest, gap)
            load = tool[LOAD]
            if soft and not tool[FREE] > 0.0:
                load = (tool[DRIVE] - depth) / tool[COMPLIANCE]
                slope += 1.0 / tool[COMPLIANCE]
            if slope == 0.0:  # nothing is touched: go to where something is
                depth += nearest + 1e-12
                continue
            depth += (load - force) / slope
            if abs(load - force) <= LAST_TURN_IMBALANCE_SHARE * max(abs(load), abs(force)):
                break
        tool[DEPTH] = depth


@leaf
def add_contact(force, contact, tool):
    """Add the forces of the tool to the node rows; give the tool's own, along -z [N]."""
    total = 0.0
    depth = tool[DEPTH]
    shape = shape_of(contact)
    moved, position, anchor = contact.moved, contact.position, contact.anchor
    for point in range(len(contact.spring)):
        x, y, z = moved[point, 0], moved[point, 1], moved[point, 2]
        gap, nx, ny, nz = clearance(x + position[point, 0], y + position[point, 1], z + position[point, 2], shape, depth)
        push, stiff = push_at(gap, contact.spring[point], contact.area[point], shape)
        if stiff == 0.0:
            continue
        sx, sy, sz = x - anchor[point, 0], y - anchor[point, 1], z + depth - anchor[point, 2]
        tx, ty, tz = friction(sx, sy, sz, nx, ny, nz, push, contact.grip[point], shape)
        fx, fy, fz = push * nx + tx, push * ny + ty, push * nz + tz
        total -= fz
        for corner in range(4):
            node, weight = contact.node[point, corner], contact.weight[point, corner]
            force[node, 0] += weight * fx
            force[node, 1] += weight * fy
            force[node, 2] += weight * fz
    return total


@leaf
def friction(sx, sy, sz, nx, ny, nz, push, grip, shape):
    """Friction force on a point that has slipped by s since its anchor: -grip s along the surface, at most its share of push."""
    if grip == 0.0:
        return 0.0, 0.0, 0.0
    along = sx * nx + sy * ny + sz * nz
    sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
    size = grip * math.sqrt(sx * sx + sy * sy + sz * sz)
    most = shape[FRICTION] * max(push, 0.0)
    pull = -grip if size <= most or shape[TIED] > 0.0 else -grip * most / size
    return pull * sx, pull * sy, pull * sz
