"""The barrier of elements/barrier.py in the sums over elements: which blocks are suspect, their forces and energies.

The loop over all elements only notes the blocks in which a corner may be folding. A second loop goes over these few, so that
the first one stays short.
"""

from __future__ import annotations

from explicitfe.compiled.arrays import CORNER, STIFFEST
from explicitfe.compiled.choose import any_below_zero, choose
from explicitfe.compiled.jit import leaf
from explicitfe.compiled.simd import WIDTH, load, load_many, maximum, min_lanes, minimum, splat, sum_lanes
from explicitfe.elements import barrier
from explicitfe.elements.barrier import (
    MODULUS,
    NUMBERS,
    PER_MASS,
    REACH,
    REST,
    WHOLE,
    corners_of_edges,
    edges_of_corners,
    ratio,
    spans,
)
from explicitfe.forces.corners import add_corner_forces, gather_corners


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
def _edges(u, position, nodes, at):
    """The 12 edges of each component as they lie now."""
    ux, uy, uz = gather_corners(u, nodes, at)
    x, y, z = gather_corners(position, nodes, at)
    return edges_of_corners(_sum(ux, x)), edges_of_corners(_sum(uy, y)), edges_of_corners(_sum(uz, z))


@leaf
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7]


@leaf
def _guarded(now, numbers):
    """D_a of the eight corners, 0 where one is not guarded."""
    zero = 0.0 * numbers[REST]
    return (
        choose(numbers[REST], now[0], zero),
        choose(numbers[REST + 1], now[1], zero),
        choose(numbers[REST + 2], now[2], zero),
        choose(numbers[REST + 3], now[3], zero),
        choose(numbers[REST + 4], now[4], zero),
        choose(numbers[REST + 5], now[5], zero),
        choose(numbers[REST + 6], now[6], zero),
        choose(numbers[REST + 7], now[7], zero),
    )


@leaf
def _total(D):
    return ((D[0] + D[1]) + (D[2] + D[3])) + ((D[4] + D[5]) + (D[6] + D[7]))


@leaf
def _ratios(D, numbers, j):
    """D_a / D_a(rest) of the eight corners; j where one is not guarded."""
    return (
        ratio(D[0], numbers[REST], j),
        ratio(D[1], numbers[REST + 1], j),
        ratio(D[2], numbers[REST + 2], j),
        ratio(D[3], numbers[REST + 3], j),
        ratio(D[4], numbers[REST + 4], j),
        ratio(D[5], numbers[REST + 5], j),
        ratio(D[6], numbers[REST + 6], j),
        ratio(D[7], numbers[REST + 7], j),
    )


@leaf
def _smallest(s):
    low = minimum(minimum(s[0], s[1]), minimum(s[2], s[3]))
    return minimum(low, minimum(minimum(s[4], s[5]), minimum(s[6], s[7])))


@leaf
def hold_corners(u, force, blocks, count, smallest):
    """Add minus the forces of the barrier in the suspect blocks, and note in ``blocks.corner`` how near it is and how stiff.

    Gives the smallest J, which is not a number where a force of the barrier is none.
    """
    nearest = splat(1.0)
    stiffest = splat(0.0)
    for entry in range(count):
        block = blocks.suspect[entry]
        at = block * (8 * WIDTH)
        numbers = load_many(blocks.barrier, block * (NUMBERS * WIDTH), NUMBERS)
        x, y, z = _edges(u, blocks.position, blocks.nodes, at)
        D = _guarded(spans(x, y, z), numbers)
        j = _total(D) * numbers[WHOLE]
        ratios = _ratios(D, numbers, j)
        lowest = _smallest(ratios)
        if any_below_zero(lowest - barrier.THRESHOLD * j):
            w = (1.0 / barrier.THRESHOLD) / j
            nearest = minimum(nearest, lowest * w)
            p0, c0 = _pull_and_curvature(ratios[0] * w)
            p1, c1 = _pull_and_curvature(ratios[1] * w)
            p2, c2 = _pull_and_curvature(ratios[2] * w)
            p3, c3 = _pull_and_curvature(ratios[3] * w)
            p4, c4 = _pull_and_curvature(ratios[4] * w)
            p5, c5 = _pull_and_curvature(ratios[5] * w)
            p6, c6 = _pull_and_curvature(ratios[6] * w)
            p7, c7 = _pull_and_curvature(ratios[7] * w)
            # - dE / dD_a = - v_a B G phi' ds_a/dD_a = - B G phi' / (8 t j), and the same part of all by j
            k = numbers[MODULUS] * w * (-1.0 / 8.0)
            work = D[0] * p0 + D[1] * p1 + D[2] * p2 + D[3] * p3 + D[4] * p4 + D[5] * p5 + D[6] * p6 + D[7] * p7
            by_j = -work * numbers[WHOLE] / j
            zero = 0.0 * by_j
            pulls = (
                k * (p0 + choose(numbers[REST], by_j, zero)),
                k * (p1 + choose(numbers[REST + 1], by_j, zero)),
                k * (p2 + choose(numbers[REST + 2], by_j, zero)),
                k * (p3 + choose(numbers[REST + 3], by_j, zero)),
                k * (p4 + choose(numbers[REST + 4], by_j, zero)),
                k * (p5 + choose(numbers[REST + 5], by_j, zero)),
                k * (p6 + choose(numbers[REST + 6], by_j, zero)),
                k * (p7 + choose(numbers[REST + 7], by_j, zero)),
            )
            # v_a B G phi'' |ds_a/d nodes|^2 / m <= B G / (2 m) phi'' |dD_a/d edges|^2 / (t^2 j^2 D_a(rest))
            k = -numbers[PER_MASS] * w * w
            curvatures = (
                k * c0 * numbers[REST],
                k * c1 * numbers[REST + 1],
                k * c2 * numbers[REST + 2],
                k * c3 * numbers[REST + 3],
                k * c4 * numbers[REST + 4],
                k * c5 * numbers[REST + 5],
                k * c6 * numbers[REST + 6],
                k * c7 * numbers[REST + 7],
            )
            hx, hy, hz, minus_stiffness = barrier.edge_forces(x, y, z, pulls, curvatures)
            fx, fy, fz = corners_of_edges(hx), corners_of_edges(hy), corners_of_edges(hz)
            add_corner_forces(force, blocks.nodes, at, fx, fy, fz)
            stiffest = minimum(stiffest, minus_stiffness)
            smallest = minimum(smallest, 1e300 + 0.0 * (fx[0] + fy[0] + fz[0]))
    blocks.corner[CORNER] = min_lanes(nearest)
    blocks.corner[STIFFEST] = -min_lanes(stiffest)
    return smallest


@leaf
def _pull_and_curvature(s):
    """phi' and phi'' at s = r_a / t; below the last ratio, those at it."""
    within = maximum(s, 0.0 * s + barrier.LAST_RATIO)
    inverse = 1.0 / within
    return barrier.density_slope(within, inverse), barrier.density_curvature(within, inverse)


@leaf
def barrier_energy(u, blocks):
    """Energy of the barrier in all elements [J]."""
    energy = splat(0.0)
    for block in range(len(blocks.nodes)):
        numbers = load_many(blocks.barrier, block * (NUMBERS * WIDTH), NUMBERS)
        x, y, z = _edges(u, blocks.position, blocks.nodes, block * (8 * WIDTH))
        D = _guarded(spans(x, y, z), numbers)
        j = _total(D) * numbers[WHOLE]
        ratios = _ratios(D, numbers, j)
        w = (1.0 / barrier.THRESHOLD) / j
        low = _energy(ratios[0] * w, numbers[REST]) + _energy(ratios[1] * w, numbers[REST + 1])
        low = low + _energy(ratios[2] * w, numbers[REST + 2]) + _energy(ratios[3] * w, numbers[REST + 3])
        top = _energy(ratios[4] * w, numbers[REST + 4]) + _energy(ratios[5] * w, numbers[REST + 5])
        top = top + _energy(ratios[6] * w, numbers[REST + 6]) + _energy(ratios[7] * w, numbers[REST + 7])
        energy = energy + numbers[MODULUS] * (low + top)
    return sum_lanes(energy)


@leaf
def _energy(s, inverse):
    """v_a phi of a corner [m^3]."""
    return choose(inverse, barrier.density(s) / (8.0 * inverse), 0.0 * s)
