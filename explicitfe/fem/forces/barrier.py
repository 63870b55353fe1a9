"""The barrier of elements/barrier.py in the sums over elements: which blocks are suspect, their forces and energies.

The loop over all elements only notes the blocks in which a corner may be folding. A second loop goes over these few, so that
the first one stays short.
"""

from __future__ import annotations

from explicitfe.fem.elements import barrier
from explicitfe.fem.elements.barrier import (
    MODULUS,
    NUMBERS,
    PER_MASS,
    REACH,
    REST,
    WHOLE,
    corners_of_edges,
    cross,
    edges_at,
    edges_of_corners,
    ratio,
)
from explicitfe.fem.forces.corners import add_corner_forces, gather_corners
from explicitfe.platform.compiled.arrays import CORNER, STIFFEST
from explicitfe.platform.compiled.choose import any_below_zero, choose
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, load, load_many, maximum, min_lanes, minimum, splat, store, sum_lanes

# Places in the work array, vectors: edges and forces on them (x, y, z by 12); of each corner D_a, phi' and phi'' / D_a(rest).
EDGES, FORCES, SPANS, SLOPES, CURVATURES = 0, 36, 72, 80, 88


@leaf
def no_suspects(cof, J, qx, qy, qz, blocks, block, count):
    """How many blocks are suspect, in an element without a barrier."""
    return count


@leaf
def no_barrier(u, force, blocks, count, smallest):
    """The smallest J, where there is nothing to add."""
    return smallest


@leaf
def no_barrier_energy(u, blocks):
    """The energy of a barrier that is not there [J]."""
    return 0.0


@leaf
def note_suspects(cof, J, qx, qy, qz, blocks, block, count):
    """Note a block in which a corner may be folding; give how many there are."""
    blocks.suspect[count] = block
    reach = load(blocks.barrier, (block * NUMBERS + REACH) * WIDTH)
    if any_below_zero(barrier.slack(cof, J, qx, qy, qz, reach)):
        return count + 1
    return count


@leaf
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7]


@leaf
def _edge(work, which):
    return load(work, (EDGES + which) * WIDTH), load(work, (EDGES + 12 + which) * WIDTH), load(work, (EDGES + 24 + which) * WIDTH)


@leaf
def _add(work, which, pull, n):
    for k in range(3):
        at = (FORCES + 12 * k + which) * WIDTH
        store(work, at, load(work, at) + pull * n[k])


@leaf
def _look(u, blocks, block):
    """Put the edges of a block and D_a of its guarded corners into the work array; give j and the smallest D_a / D_a(rest).

    Loops over the corners, with a work array, instead of straight lines: that compiles in half the time. Their number is read
    from an array, as the compiler would make straight lines of a loop over eight.
    """
    work, numbers, corners = blocks.work, block * NUMBERS, blocks.barrier.shape[1] - REST
    at = block * (8 * WIDTH)
    ux, uy, uz = gather_corners(u, blocks.nodes, at)
    x, y, z = gather_corners(blocks.position, blocks.nodes, at)
    _keep(work, EDGES, edges_of_corners(_sum(ux, x)))
    _keep(work, EDGES + 12, edges_of_corners(_sum(uy, y)))
    _keep(work, EDGES + 24, edges_of_corners(_sum(uz, z)))
    total = splat(0.0)
    for corner in range(corners):
        one, two, three = edges_at(corner)
        a, n = _edge(work, one), cross(_edge(work, two), _edge(work, three))
        inverse = load(blocks.barrier, (numbers + REST + corner) * WIDTH)
        D = choose(inverse, a[0] * n[0] + a[1] * n[1] + a[2] * n[2], splat(0.0))
        store(work, (SPANS + corner) * WIDTH, D)
        total = total + D
    j = total * load(blocks.barrier, (numbers + WHOLE) * WIDTH)
    lowest = j
    for corner in range(corners):
        inverse = load(blocks.barrier, (numbers + REST + corner) * WIDTH)
        lowest = minimum(lowest, ratio(load(work, (SPANS + corner) * WIDTH), inverse, j))
    return j, lowest


@leaf
def _keep(work, first, edges):
    """Put 12 vectors into the work array."""
    store(work, first * WIDTH, edges[0])
    store(work, (first + 1) * WIDTH, edges[1])
    store(work, (first + 2) * WIDTH, edges[2])
    store(work, (first + 3) * WIDTH, edges[3])
    store(work, (first + 4) * WIDTH, edges[4])
    store(work, (first + 5) * WIDTH, edges[5])
    store(work, (first + 6) * WIDTH, edges[6])
    store(work, (first + 7) * WIDTH, edges[7])
    store(work, (first + 8) * WIDTH, edges[8])
    store(work, (first + 9) * WIDTH, edges[9])
    store(work, (first + 10) * WIDTH, edges[10])
    store(work, (first + 11) * WIDTH, edges[11])


@leaf
def hold_corners(u, force, blocks, count, smallest):
    """Add minus the forces of the barrier in the suspect blocks, and note in ``blocks.corner`` how near it is and how stiff.

    Gives the smallest J, which is not a number where a force of the barrier is none.
    """
    work = blocks.work
    nearest = splat(1.0)
    stiffest = splat(0.0)
    for entry in range(count):
        block = blocks.suspect[entry]
        j, lowest = _look(u, blocks, block)
        if any_below_zero(lowest - barrier.THRESHOLD * j):
            w = (1.0 / barrier.THRESHOLD) / j
            nearest = minimum(nearest, lowest * w)
            stiff = _pull(blocks, block, w, j)
            fx = corners_of_edges(load_many(work, FORCES * WIDTH, 12))
            fy = corners_of_edges(load_many(work, (FORCES + 12) * WIDTH, 12))
            fz = corners_of_edges(load_many(work, (FORCES + 24) * WIDTH, 12))
            add_corner_forces(force, blocks.nodes, block * (8 * WIDTH), fx, fy, fz)
            stiffest = minimum(stiffest, -stiff)
            smallest = minimum(smallest, 1e300 + 0.0 * (fx[0] + fy[0] + fz[0]))
    blocks.corner[CORNER] = min_lanes(nearest)
    blocks.corner[STIFFEST] = -min_lanes(stiffest)
    return smallest


@leaf
def _pull(blocks, block, w, j):
    """Put minus the forces on the edges into the work array; give a bound of the stiffness over mass [1/s^2]. w = 1 / (t j)."""
    work, numbers, corners = blocks.work, block * NUMBERS, blocks.barrier.shape[1] - REST
    moved = splat(0.0)
    for corner in range(corners):
        inverse = load(blocks.barrier, (numbers + REST + corner) * WIDTH)
        D = load(work, (SPANS + corner) * WIDTH)
        slope, curvature = _slope_and_curvature(ratio(D, inverse, j) * w)
        store(work, (SLOPES + corner) * WIDTH, slope)
        store(work, (CURVATURES + corner) * WIDTH, curvature * inverse)
        moved = moved + D * slope
    for place in range(36):
        store(work, (FORCES + place) * WIDTH, splat(0.0))
    # - dE / dD_a = - v_a B G phi' ds_a/dD_a = - B G phi' / (8 t j), and the same part of all by j
    factor = load(blocks.barrier, (numbers + MODULUS) * WIDTH) * w * (-1.0 / 8.0)
    by_j = moved * load(blocks.barrier, (numbers + WHOLE) * WIDTH) / j
    stiff = splat(0.0)
    for corner in range(corners):
        inverse = load(blocks.barrier, (numbers + REST + corner) * WIDTH)
        pull = factor * (load(work, (SLOPES + corner) * WIDTH) - choose(inverse, by_j, splat(0.0)))
        one, two, three = edges_at(corner)
        a, b, c = _edge(work, one), _edge(work, two), _edge(work, three)
        na, nb, nc = cross(b, c), cross(c, a), cross(a, b)
        _add(work, one, pull, na)
        _add(work, two, pull, nb)
        _add(work, three, pull, nc)
        stiff = stiff + load(work, (CURVATURES + corner) * WIDTH) * (_square(na) + _square(nb) + _square(nc))
    # v_a B G phi'' |ds_a/d nodes|^2 / m <= B G / (2 m) phi'' |dD_a/d edges|^2 / (t^2 j^2 D_a(rest)): the corner's own node moves
    # all three edges, so |dD_a/d nodes|^2 <= 4 |dD_a/d edges|^2
    return load(blocks.barrier, (numbers + PER_MASS) * WIDTH) * w * w * stiff


@leaf
def _square(n):
    return n[0] * n[0] + n[1] * n[1] + n[2] * n[2]


@leaf
def _slope_and_curvature(s):
    """phi' and phi'' at s = r_a / t; below the last ratio, those at it."""
    within = maximum(s, 0.0 * s + barrier.LAST_RATIO)
    inverse = 1.0 / within
    return barrier.density_slope(within, inverse), barrier.density_curvature(within, inverse)


@leaf
def barrier_energy(u, blocks):
    """Energy of the barrier in all elements [J]."""
    work, corners = blocks.work, blocks.barrier.shape[1] - REST
    energy = splat(0.0)
    for block in range(len(blocks.nodes)):
        j, _ = _look(u, blocks, block)
        w = (1.0 / barrier.THRESHOLD) / j
        total = splat(0.0)
        for corner in range(corners):
            inverse = load(blocks.barrier, (block * NUMBERS + REST + corner) * WIDTH)
            s = ratio(load(work, (SPANS + corner) * WIDTH), inverse, j) * w
            total = total + choose(inverse, barrier.density(s) / (8.0 * inverse), splat(0.0))
        energy = energy + load(blocks.barrier, (block * NUMBERS + MODULUS) * WIDTH) * total
    return sum_lanes(energy)
