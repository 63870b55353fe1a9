"""A look at the stable step of the present state, compiled: scans of the nodes, and the highest frequency of the whole mesh.

No mesh vibrates faster than omega with, over all nodes n and the elements e that share them,

    omega^2 <= max_n  sum_e m_e omega_e^2 / sum_e m_e,

where omega_e is the highest frequency of an element by itself and m_e what it gives to the mass of the node: in Rayleigh's
quotient u K u = sum_e u_e K_e u_e <= sum_e omega_e^2 m_e |u_e|^2, summed node by node (Irons & Treharne 1971 take the largest
omega_e; but one element that is pressed flat between others is held back by their masses). An element vibrates fastest by
changing its volume, so omega_e^2 follows the gradient of its volume (``element_bound.py``). A *scan* evaluates this bound at all
nodes, now and a step on, for less than the price of a force. Only where it has grown, or after many steps, is the frequency
itself sought, by Lanczos iteration.

All threads of a run call these functions together; what they return is the same in each.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from explicitfe.fem.elements.hex8 import gradient
from explicitfe.fem.forces.corners import add_corner_forces, element_modes
from explicitfe.fem.solve.element_bound import volume_stiffness
from explicitfe.fem.solve.stable_step import STEP_SHARE_OF_LIMIT
from explicitfe.platform.compiled.arrays import INTERVAL, LIMIT, LOWEST_LIMIT, PERIOD, SINCE, WAIT
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.pieces import call_at
from explicitfe.platform.compiled.simd import ROW, WIDTH, load, load_many, min_lanes, minimum, splat, store, sum_lanes
from explicitfe.platform.compiled.threads import wait

# Placeholders, bound in solve/kernels.py.
shape: Any = None
add_stiffness: Any = None
hold: Any = None

# Each change of the step moves energy between the highest vibrations, at random; so it is kept while it lies between these shares
# of the limit, and is lengthened only where it has been too short for many steps.
LONGEST_STEP_SHARE, SHORTEST_STEP_SHARE = 0.91, 0.82
STEPS_IN_A_PERIOD = 500
# The highest frequency is sought before it can have grown so far that the step is this share of the limit, or by one of these
# shares where that is less or more.
SHARE_THAT_CALLS_FOR_A_LOOK = 0.93
SMALLEST_GROWTH, LARGEST_GROWTH = 0.03, 0.15
FEWEST_STEPS_BETWEEN_SCANS, MOST_STEPS_BETWEEN_LOOKS = 2, 100
STEPS_THAT_CALL_FOR_ALL_TURNS = 200  # since the last look: stands for a call of the barrier
MOST_STEPS_BETWEEN_SCANS = 25
SHARE_OF_STEPS_AHEAD = 0.4
LONGEST_INTERVAL_SHARE = 1.5  # of an interval between two scans: how long the next may be
SHORT_WAIT_STEPS = 4  # instead of scanning again so soon, the frequency is sought
# By how much of the square of the highest frequency the barrier against folding may stiffen before a look: 0.9 of the limit is
# then 0.96 of the new one at most.
BARRIER_MARGIN = 0.15
# Where nothing calms a body, the fastest vibrations take their part of its energy and keep it. Then shares near the limit are not
# stable for long: the limit swings by a third within some steps, and each change of the step pumps them. At these shares looks
# are needed less often, and the energy stays (docs/studies/step.md).
UNDAMPED_LONGEST_STEP_SHARE, UNDAMPED_SHORTEST_STEP_SHARE = 0.75, 0.45
UNDAMPED_SHARE_THAT_CALLS_FOR_A_LOOK = 0.8
UNDAMPED_LARGEST_GROWTH = 0.3
UNDAMPED_BARRIER_MARGIN = 0.4
# There a corner that folds comes back from the barrier as from a wall. In a step it may fall by this share of what is left of it.
UNDAMPED_FALL_SHARE = 0.1
# Contact stiffness that the limit leaves room for, over that at first touch: a point becomes twice as stiff 0.05 mm deep.
FIRST_TOUCHES = 2.0
NOISE_SHARE = 0.3  # of the length of a start vector
LOUDNESS_POWER = 8  # of a bound over what it may grow to: how loud the noise is at a node
FEWEST_TURNS = 3  # of the iteration
BREAKDOWN_SHARE = 1e-12  # of the first eigenvalue: below it the basis spans an invariant space
MAXIMUM, ALONG, SQUARE = 0, 1, 2  # places of the sums of threads


class Margins(NamedTuple):
    """How near to the limit of its stability a step may come.

    Attributes
    ----------
    longest, shortest : shares of the limit between which a step is kept.
    calling : the share before which the limit is looked for again.
    growth : the most that the highest frequency may grow by before, as a share of it.
    barrier : the same for the barrier against folding, as a share of its square.
    fall : the most that the corner nearest to folding may fall in a step, as a share of what is left of it.
    """

    longest: float
    shortest: float
    calling: float
    growth: float
    barrier: float
    fall: float


class Ceilings(NamedTuple):
    """What may happen in a step before the next stability check is due at once."""

    barrier: float  # how stiff the barrier against folding may become, over mass [1/s^2]
    fall: float  # largest decrease of the smallest corner Jacobian in one step, as a share of its present value
    contact: float  # how much stiffer the contact of a face with a bone may become, over its stiffness at first touch


@leaf
def margins_of(undamped):
    """Those of a body that is damped, or of one that nothing calms."""
    if undamped:
        return Margins(
            UNDAMPED_LONGEST_STEP_SHARE,
            UNDAMPED_SHORTEST_STEP_SHARE,
            UNDAMPED_SHARE_THAT_CALLS_FOR_A_LOOK,
            UNDAMPED_LARGEST_GROWTH,
            UNDAMPED_BARRIER_MARGIN,
            UNDAMPED_FALL_SHARE,
        )
    return Margins(LONGEST_STEP_SHARE, SHORTEST_STEP_SHARE, SHARE_THAT_CALLS_FOR_A_LOOK, LARGEST_GROWTH, BARRIER_MARGIN, math.inf)


@leaf
def total(sums, part, place, value):
    """Sum over the parts, the same in all threads. The next sum in the same place needs another meeting in between."""
    if part.parts == 1:
        return value
    sums[part.number, place] = value
    wait(part.gate, part.parts)
    result = 0.0
    for number in range(part.parts):
        result += sums[number, place]
    return result


@leaf
def smallest(sums, part, place, value):
    """Smallest of all parts, as ``total``; NaN if one is."""
    if part.parts == 1:
        return value
    sums[part.number, place] = value
    wait(part.gate, part.parts)
    result = value
    for number in range(part.parts):
        other = sums[number, place]
        if not other >= result:
            result = other
    return result


def evaluate(state, part, looks, looker, actions, instant, force_at):
    """Minus the internal force at ``looks.shifted`` into ``looks.response``, with ties and the stiffness of contact."""
    force = looker.force
    force[:] = 0.0
    call_at(force_at, (looker.shifted, force, looker.blocks))
    wait(part.gate, part.parts)
    for at in range(0, looker.lower.size, WIDTH):
        store(force, at, load(force, at) + load(looker.lower, at))
    for at in range(0, part.own * ROW, WIDTH):
        store(looks.response, at + part.first * ROW, load(force, at))
    hold(looks.response, looks.shifted, state, part, actions, instant)


def hold_nodes(force, u, state, part, actions, instant):
    """Add to all rows the pull of ties at displacement u, and the change of contact since the present state, linearised."""
    wait(part.gate, part.parts)
    if part.number == 0:
        add_stiffness(force, u, state.u, actions, instant)
    wait(part.gate, part.parts)


def highest_frequency(state, part, looks, looker, actions, instant, turns, settled, length, force_at):
    """Highest angular frequency [1/s] of the present state, whose force is there; NaN where the force is not finite.

    Lanczos iteration on A = M^-1/2 K M^-1/2 (Parlett 1998, chapter 13), a power iteration that uses all its vectors: the tangent
    K is applied by differencing the internal force, which stands at an address, over ``length`` m, so no matrix is ever formed.
    The estimate comes from below and grows with the number of turns, one force each: so many at most, and no more once its square
    rises by less than a share of it, ``settled``. ``looks.vector`` is where it starts, with noise, and receives the last vector.
    """
    root, basis, sums = looks.root, looks.basis, looks.sums
    response = looks.response
    diagonal, beside = looker.tridiagonal[0], looker.tridiagonal[1]
    first, last, size = part.first * ROW, (part.first + part.own) * ROW, state.u.size
    for at in range(first, last, WIDTH):
        store(looks.base, at, load(state.force, at))
    start_vector(part, looks)
    hold(looks.base, state.u, state, part, actions, instant)
    done = 0
    eigenvalue = 0.0
    for turn in range(turns):
        here = turn * size
        largest = splat(0.0)
        for at in range(first, last, WIDTH):
            moved = load(root, at) * load(basis, here + at)
            largest = minimum(largest, minimum(moved, -moved))
        step = -length / smallest(sums, part, MAXIMUM, min_lanes(largest))
        for at in range(first, last, WIDTH):
            store(looks.shifted, at, load(state.u, at) + step * load(root, at) * load(basis, here + at))
        wait(part.gate, part.parts)
        evaluate(state, part, looks, looker, actions, instant, force_at)
        # A times the last vector, less the last two, is the next vector
        before, coupling = (here - size, beside[turn - 1]) if turn > 0 else (here, 0.0)
        product = splat(0.0)
        for at in range(first, last, WIDTH):
            change = (1.0 / step) * (load(root, at) * (load(looks.base, at) - load(response, at)))
            store(response, at, change)
            product = product + change * load(basis, here + at)
        diagonal[turn] = total(sums, part, ALONG, sum_lanes(product))
        square = splat(0.0)
        for at in range(first, last, WIDTH):
            remainder = load(response, at) - diagonal[turn] * load(basis, here + at) - coupling * load(basis, before + at)
            store(response, at, remainder)
            square = square + remainder * remainder
        beside[turn] = math.sqrt(total(sums, part, SQUARE, sum_lanes(square)))
        if not math.isfinite(beside[turn]):
            return math.nan
        done += 1
        former = eigenvalue
        eigenvalue = largest_eigenvalue(looker.tridiagonal, done)
        if beside[turn] <= BREAKDOWN_SHARE * abs(diagonal[0]):
            break
        if done >= FEWEST_TURNS and eigenvalue - former < settled * eigenvalue:
            break
        for at in range(first, last, WIDTH):
            store(basis, here + size + at, (1.0 / beside[turn]) * load(response, at))
    vector_of(looker.tridiagonal, done, eigenvalue)
    weights = looker.tridiagonal[2]
    square = splat(0.0)
    for at in range(first, last, WIDTH):
        vector = splat(0.0)
        for turn in range(done):
            vector = vector + weights[turn] * load(basis, turn * size + at)
        store(looks.vector, at, vector)
        square = square + vector * vector
    scale = 1.0 / math.sqrt(total(sums, part, ALONG, sum_lanes(square)))
    for at in range(first, last, WIDTH):
        store(looks.vector, at, scale * load(looks.vector, at))
    return math.sqrt(eigenvalue)


@leaf
def start_vector(part, looks):
    """The first Lanczos vector: what the last look has come to, with noise where bounds are near to calling for a look, or above.

    From the last vector alone the iteration would stay blind to elements that have stiffened elsewhere.
    """
    vector, noise, start = looks.vector, looks.noise, looks.basis[0]
    loudness = 0.0
    for node in range(part.first, part.first + part.own):
        loud = 1.0
        if looks.bound[node, 2] > 0.0:
            for _ in range(LOUDNESS_POWER):
                loud *= looks.bound[node, 0] / looks.bound[node, 2]
        for k in range(3):
            start[node, k] = loud * noise[node, k]
            loudness += start[node, k] * start[node, k]
    scale = NOISE_SHARE / math.sqrt(max(total(looks.sums, part, ALONG, loudness), 1e-300))
    size = 0.0
    for node in range(part.first, part.first + part.own):
        for k in range(3):
            start[node, k] = vector[node, k] + scale * start[node, k]
            size += start[node, k] * start[node, k]
    scale = 1.0 / math.sqrt(total(looks.sums, part, SQUARE, size))
    for node in range(part.first, part.first + part.own):
        for k in range(3):
            start[node, k] *= scale


@leaf
def largest_eigenvalue(tridiagonal, count):
    """Of a symmetric matrix with these diagonals, by bisection.

    T - x has negative pivots only, in Gauss's elimination, exactly if x is above all eigenvalues (Sylvester).
    """
    diagonal, beside = tridiagonal[0], tridiagonal[1]
    low, high = -math.inf, -math.inf
    for k in range(count):
        reach = (abs(beside[k - 1]) if k > 0 else 0.0) + (abs(beside[k]) if k < count - 1 else 0.0)
        low, high = max(low, diagonal[k]), max(high, diagonal[k] + reach)
    while high - low > BREAKDOWN_SHARE * abs(high):
        middle = 0.5 * (low + high)
        above = True
        pivot = 0.0
        for k in range(count):
            pivot = diagonal[k] - middle - (beside[k - 1] * beside[k - 1] / pivot if k > 0 else 0.0)
            if not pivot < 0.0:
                above = False
                break
        if above:
            high = middle
        else:
            low = middle
    return high


@leaf
def vector_of(tridiagonal, count, eigenvalue):
    """The vector of the largest eigenvalue, all components positive, into the third row.

    By inverse iteration just above it, where x - T has a positive inverse.
    """
    diagonal, beside, vector, pivots = tridiagonal[0], tridiagonal[1], tridiagonal[2], tridiagonal[3]
    near = eigenvalue + 4.0 * BREAKDOWN_SHARE * abs(eigenvalue)
    vector[:count] = 1.0
    for _ in range(3):
        for k in range(count):
            pivots[k] = near - diagonal[k]
            if k > 0:
                factor = beside[k - 1] / pivots[k - 1]
                pivots[k] -= factor * beside[k - 1]
                vector[k] += factor * vector[k - 1]
        largest = 0.0
        for back in range(count):
            k = count - 1 - back
            vector[k] = (vector[k] + (beside[k] * vector[k + 1] if back > 0 else 0.0)) / pivots[k]
            largest = max(largest, abs(vector[k]))
        for k in range(count):
            vector[k] /= largest


def scan(state, part, looks, looker, nodes, dt):
    """The bound at each node, now and after one step dt at the present velocities, into ``looks.bound``; give 0."""
    force, blocks = looker.force, looker.blocks
    force[:] = 0.0
    for block in range(len(blocks.nodes)):
        at = block * (8 * WIDTH)
        g, _ = shape(blocks, block)
        own = load_many(looker.shapes, block * (7 * WIDTH), 7)
        ux, uy, uz = element_modes(part.u, blocks.nodes, at)
        vx, vy, vz = element_modes(looker.velocity, blocks.nodes, at)
        F = (
            gradient(ux, g, 0) + 1.0,
            gradient(ux, g, 1),
            gradient(ux, g, 2),
            gradient(uy, g, 0),
            gradient(uy, g, 1) + 1.0,
            gradient(uy, g, 2),
            gradient(uz, g, 0),
            gradient(uz, g, 1),
            gradient(uz, g, 2) + 1.0,
        )
        ahead = (
            F[0] + dt * gradient(vx, g, 0),
            F[1] + dt * gradient(vx, g, 1),
            F[2] + dt * gradient(vx, g, 2),
            F[3] + dt * gradient(vy, g, 0),
            F[4] + dt * gradient(vy, g, 1),
            F[5] + dt * gradient(vy, g, 2),
            F[6] + dt * gradient(vz, g, 0),
            F[7] + dt * gradient(vz, g, 1),
            F[8] + dt * gradient(vz, g, 2),
        )
        now, then = own[6] * volume_stiffness(F, own), own[6] * volume_stiffness(ahead, own)
        zero = splat(0.0)
        add_corner_forces(
            force,
            blocks.nodes,
            at,
            (now, now, now, now, now, now, now, now),
            (then, then, then, then, then, then, then, then),
            (zero, zero, zero, zero, zero, zero, zero, zero),
        )
    wait(part.gate, part.parts)
    shared = len(looker.lower)
    for row in range(part.own):
        node = part.first + row
        mass, mobility = nodes.mass[node, 0], nodes.inverse_mass
        now = then = 0.0
        if mobility[node, 0] + mobility[node, 1] + mobility[node, 2] > 0.0:
            now, then = force[row, 0] / mass, force[row, 1] / mass
            if row < shared:
                now, then = now + looker.lower[row, 0] / mass, then + looker.lower[row, 1] / mass
        looks.bound[node, 0], looks.bound[node, 1] = now, then
    wait(part.gate, part.parts)
    return 0.0


@leaf
def steps_ahead(part, looks):
    """Steps until the bound of some node comes to where it calls for a look, if all go on as they do now."""
    least = math.inf
    for node in range(part.first, part.first + part.own):
        now, then, allowed = looks.bound[node, 0], looks.bound[node, 1], looks.bound[node, 2]
        if then > now or not now < allowed:
            # An edge that shortens at a constant rate reaches its end: the bound then grows faster than by the slope that it has
            ahead = now * (1.0 - now / allowed) / (then - now) if then > now else 0.0
            if ahead < least:
                least = ahead
    return smallest(looks.sums, part, MAXIMUM, least)


@leaf
def allow_growth(part, looks, square, share, margins):
    """From now on a look is due where a bound may have grown by as much as the step has left: it is this share of the limit.

    Bounds below the square of the highest frequency may grow to it before.
    """
    growth = min(max(margins.calling / share, 1.0 + SMALLEST_GROWTH), 1.0 + margins.growth) ** 2
    for node in range(part.first, part.first + part.own):
        looks.bound[node, 2] = growth * max(looks.bound[node, 0], square)


@leaf
def limit_of(highest, contact_frequency):
    """The longest stable step [s] where the whole mesh has this highest frequency [1/s].

    Contact adds at most the square of ``contact_frequency`` to its square before the next look, which is due where bone contact
    stiffens by more. Where the share of the limit that a step takes does not leave room for that, the limit is shorter.
    """
    touching = math.sqrt(highest * highest + contact_frequency * contact_frequency)
    return min(2.0 / highest, 2.0 / touching / STEP_SHARE_OF_LIMIT)


@leaf
def calls_for_another_step(watch, dt, fixed, margins):
    """Whether the step is too long for the limit, or too short for what that has been for a period.

    A period that has ended otherwise is followed by the next.
    """
    if fixed:
        return not dt <= watch[LIMIT]
    if not dt <= margins.longest * watch[LIMIT]:
        return True
    if watch[PERIOD] < STEPS_IN_A_PERIOD:
        return False
    if dt < margins.shortest * watch[LOWEST_LIMIT]:
        return True
    watch[PERIOD], watch[LOWEST_LIMIT] = 0.0, watch[LIMIT]
    return False


@leaf
def is_due(watch, ahead):
    """Whether the highest frequency has to be sought: ``ahead`` steps until some node's bound calls for it."""
    return watch[SINCE] >= MOST_STEPS_BETWEEN_LOOKS or not ahead >= SHORT_WAIT_STEPS


@leaf
def note_limit(watch, limit):
    """Note a limit [s] that has been found now."""
    watch[LIMIT] = limit
    watch[LOWEST_LIMIT] = min(limit, watch[LOWEST_LIMIT])
    watch[SINCE] = 0.0


@leaf
def plan_next_scan(watch, ahead):
    """Say when to scan the nodes again, if it is ``ahead`` steps until some node's bound calls for a look."""
    # A body that starts from rest, or under a load that rises, has no rate yet.
    longest = min(
        1.0 + LONGEST_INTERVAL_SHARE * watch[INTERVAL], MOST_STEPS_BETWEEN_SCANS, MOST_STEPS_BETWEEN_LOOKS - watch[SINCE]
    )
    soon = SHARE_OF_STEPS_AHEAD * ahead  # the bounds grow faster and faster
    watch[INTERVAL] = watch[WAIT] = max(float(FEWEST_STEPS_BETWEEN_SCANS), math.floor(min(soon, longest)))
