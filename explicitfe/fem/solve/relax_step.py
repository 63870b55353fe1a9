"""One iteration of dynamic relaxation, compiled whole, and what the tool feels at a state."""

from __future__ import annotations

import math

from explicitfe.fem.forces.contact import add_contact, clearance, find_depth, follow, friction, push_at, shape_of
from explicitfe.fem.forces.springs import add_springs
from explicitfe.fem.solve.boundary import turn, turn_back
from explicitfe.platform.compiled.arrays import (
    COMPLIANCE,
    DEAD_WORK,
    DEPTH,
    DRIVE,
    FREE,
    GOAL,
    KINETIC_RATIO,
    LOADS,
    MOMENT,
    MOVED_MOMENT,
    MOVED_POWER,
    PACE,
    POWER,
    PRESSED,
    PUSHED,
    RESIDUAL,
    REST_J,
    STIFFNESS,
    SUM_J,
    SUM_POWER,
    UNBALANCED,
    WORK,
)
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.pieces import call_at
from explicitfe.platform.compiled.simd import ROW, WIDTH, load, splat, store, sum_lanes
from explicitfe.platform.compiled.threads import wait

NEWEST_ESTIMATE_WEIGHT = 0.1  # of the stiffness, in a relaxation's mean
# The last increment tells of the modes that move fastest, which are above the slowest: this share of its Rayleigh quotient is
# damped critically. On the specimens of docs/reference/performance.md a load takes the fewest iterations between 0.3 and 0.5.
DAMPED_SHARE = 0.5
LARGEST_STIFFNESS_ESTIMATE = 3.8  # above it a relaxation stops: fresh masses keep it below 3.7, beyond 4 nothing is stable
ITERATIONS_PER_RESIDUAL = 20  # between two looks at it


def relax(force_at, state, external, inner, part, nodes, surface, goal, sums, iterations, monitor):
    """Relax towards equilibrium by up to so many iterations; give the number done.

    Central differences with dt = 1 and fictitious masses, under viscous damping that follows the lowest frequency that still
    moves (Underwood 1983): c = 2 sqrt(S / 2) with S = v.(f_before - f_now) / v.M v, the Rayleigh quotient of the last increment.
    It is done when the nodal forces that nothing balances are below the tolerance times those of the tool and the loads
    (2-norms), and the kinetic energy is below its square times the work: near the end both go as the square of the distance.

    The threads of all parts call this at the same time. Each has its elements and its node rows; what is sought at the surface,
    by the tool, springs and symmetry, is the first one's. All see the same sums, so all decide alike.

    Parameters
    ----------
    force_at : address of the internal force.
    state : State, changed in place; v is the increment of the last iteration, force all forces but the external ones.
    external : (N, 4) N. Dead loads. ``inner`` (N, 4) is a work array.
    part : Part.
    nodes : Nodes with fictitious masses.
    surface : Surface. Rotational symmetry is for one part only; the state of the tool is changed in place.
    goal : Goal.
    sums : (parts, SUMS). Work array, what each part adds to sums over all.
    monitor : (MONITOR,). What the last look saw, changed in place.
    """
    u, v, force = state
    turned, springs, contact, tool = surface
    tolerance, least_load, least_work = goal
    begin, end = part.first * ROW, (part.first + part.own) * ROW
    own_sums = sums[part.number]
    first = part.number == 0
    before = monitor[POWER]
    inertia = monitor[MOMENT]
    stiffness = monitor[STIFFNESS]
    rest_J = monitor[REST_J]
    done = 0
    while done < iterations:
        if first:
            turn(u, turned)
        part.force[:] = 0.0
        own_sums[SUM_J] = call_at(force_at, (part.u, part.force, part.blocks))
        follow(u, contact, part.number, part.parts)
        wait(part.gate, part.parts)
        rest_J = smallest(sums)
        if not (rest_J > 0.0):
            break
        if part.parts > 1:
            for here in range(0, part.lower.size, WIDTH):
                store(part.force, here, load(part.force, here) + load(part.lower, here))
            for at in range(begin, end, WIDTH):
                store(force, at, load(part.force, at - begin))
            wait(part.gate, part.parts)
        looks = done % ITERATIONS_PER_RESIDUAL == 0
        if first:
            add_springs(u, force, springs)
            turn_back(force, turned)
            if looks:
                for at in range(0, u.size, WIDTH):
                    store(inner, at, load(force, at))
            if not tool[FREE] > 0.0:
                tool[DRIVE] += min(max(tool[GOAL] - tool[DRIVE], -tool[PACE]), tool[PACE])
                if tool[COMPLIANCE] == 0.0:
                    tool[DEPTH] = tool[DRIVE]
            find_depth(contact, tool)
            own_sums[PRESSED] = add_contact(force, contact, tool)
        wait(part.gate, part.parts)
        if looks:
            residual = splat(0.0)
            loads = splat(0.0)
            work = splat(0.0)
            for at in range(begin, end, WIDTH):
                free = load(nodes.inverse_mass, at) * load(nodes.mass, at)
                dead = load(external, at)
                unbalanced = free * (load(force, at) + dead)
                pushed = free * (load(force, at) + dead - load(inner, at))
                residual = residual + unbalanced * unbalanced
                loads = loads + pushed * pushed
                work = work + dead * load(u, at)
            own_sums[UNBALANCED], own_sums[PUSHED], own_sums[DEAD_WORK] = sum_lanes(residual), sum_lanes(loads), sum_lanes(work)
            wait(part.gate, part.parts)
            done_work = 0.5 * (abs(sums[0, PRESSED] * tool[DEPTH]) + abs(total(sums, DEAD_WORK)))
            pushed_by = math.sqrt(total(sums, PUSHED))
            # a body without any load is at rest where it is
            off = math.sqrt(total(sums, UNBALANCED)) / max(pushed_by, least_load, 1e-150)
            kinetic = 0.5 * inertia / max(done_work, least_work, 1e-300)
            if first:
                monitor[LOADS], monitor[WORK], monitor[RESIDUAL], monitor[KINETIC_RATIO] = pushed_by, done_work, off, kinetic
            arrived = tool[FREE] > 0.0 or tool[DRIVE] == tool[GOAL]
            if arrived and off <= tolerance and kinetic <= tolerance * tolerance:
                break
        power = splat(0.0)
        for at in range(begin, end, WIDTH):
            power = power + load(v, at) * (load(force, at) + load(external, at))
        own_sums[SUM_POWER] = sum_lanes(power)
        wait(part.gate, part.parts)
        if inertia > 0.0:
            quotient = (before - total(sums, SUM_POWER)) / inertia
            if quotient > 0.0:
                stiffness = (1.0 - NEWEST_ESTIMATE_WEIGHT) * stiffness + NEWEST_ESTIMATE_WEIGHT * min(quotient, 4.0)
                if stiffness > LARGEST_STIFFNESS_ESTIMATE:
                    break
        c = 2.0 * math.sqrt(DAMPED_SHARE * stiffness)
        keep = (2.0 - c) / (2.0 + c)
        gain = 2.0 / (2.0 + c)
        power = splat(0.0)
        moment = splat(0.0)
        for at in range(begin, end, WIDTH):
            push = load(force, at) + load(external, at)
            new = keep * load(v, at) + gain * load(nodes.inverse_mass, at) * push
            store(v, at, new)
            store(u, at, load(u, at) + new)
            power = power + new * push
            moment = moment + new * new * load(nodes.mass, at)
        own_sums[MOVED_POWER], own_sums[MOVED_MOMENT] = sum_lanes(power), sum_lanes(moment)
        wait(part.gate, part.parts)
        before = total(sums, MOVED_POWER)
        inertia = total(sums, MOVED_MOMENT)
        done += 1
    if first:
        monitor[POWER], monitor[MOMENT], monitor[STIFFNESS], monitor[REST_J] = before, inertia, stiffness, rest_J
    return done


@leaf
def total(sums, entry):
    """Sum over the parts, always in the same order."""
    value = 0.0
    for number in range(len(sums)):
        value += sums[number, entry]
    return value


@leaf
def smallest(sums):
    """The smallest J of all parts; NaN if one is."""
    value = sums[0, SUM_J]
    for number in range(1, len(sums)):
        if value == value and not (sums[number, SUM_J] >= value):
            value = sums[number, SUM_J]
    return value


def press(u, force, contact, tool):
    """Add the forces of the tool to the node rows; give its own, along -z [N]."""
    follow(u, contact, 0, 1)
    return add_contact(force, contact, tool)


def touch(u, contact, tool, gap, push, traction):
    """Distance [m], normal force [N] and friction force [N] of each contact point: (k,), (k,), (k, 3)."""
    follow(u, contact, 0, 1)
    shape, depth = shape_of(contact), tool[DEPTH]
    moved, position, anchor = contact.moved, contact.position, contact.anchor
    for point in range(len(contact.spring)):
        x, y, z = moved[point, 0], moved[point, 1], moved[point, 2]
        gap[point], nx, ny, nz = clearance(x + position[point, 0], y + position[point, 1], z + position[point, 2], shape, depth)
        push[point], _ = push_at(gap[point], contact.spring[point], contact.area[point], shape)
        sx, sy, sz = x - anchor[point, 0], y - anchor[point, 1], z + depth - anchor[point, 2]
        traction[point] = friction(sx, sy, sz, nx, ny, nz, push[point], contact.grip[point], shape)
