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
from explicitfe.elements.barrier import MODULUS, NUMBERS, PER_MASS, REACH, REST, edges_of_modes, modes_of_edges, ratio, spans
from explicitfe.elements.hex8 import derived_geometry, gradient, minus_from_modes
from explicitfe.forces.corners import add_corner_forces, element_modes
from explicitfe.materials.kinematics import cofactor, determinant


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
def _corners(u, blocks, block):
    """What the barrier of a block needs: edges, D_a and D_a / D_a(rest), F's cofactor, J, geometry and the barrier's numbers."""
    at = block * (8 * WIDTH)
    mx, my, mz = element_modes(u, blocks.nodes, at)
    X, Y, Z = element_modes(blocks.position, blocks.nodes, at)
    g = derived_geometry((X, Y, Z))
    numbers = load_many(blocks.barrier, block * (NUMBERS * WIDTH), NUMBERS)
    F = (
        gradient(mx, g, 0) + 1.0, gradient(mx, g, 1), gradient(mx, g, 2),
        gradient(my, g, 0), gradient(my, g, 1) + 1.0, gradient(my, g, 2),
        gradient(mz, g, 0), gradient(mz, g, 1), gradient(mz, g, 2) + 1.0,
    )  # fmt: skip
    cof = cofactor(F)
    J = determinant(F, cof)
    edges = edges_of_modes(_sum(X, mx)), edges_of_modes(_sum(Y, my)), edges_of_modes(_sum(Z, mz))
    now = spans(edges[0], edges[1], edges[2])
    ratios = (
        ratio(now[0], numbers[REST], J),
        ratio(now[1], numbers[REST + 1], J),
        ratio(now[2], numbers[REST + 2], J),
        ratio(now[3], numbers[REST + 3], J),
        ratio(now[4], numbers[REST + 4], J),
        ratio(now[5], numbers[REST + 5], J),
        ratio(now[6], numbers[REST + 6], J),
        ratio(now[7], numbers[REST + 7], J),
    )
    return edges, now, ratios, cof, J, g, numbers


@leaf
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6]


@leaf
def _smallest(s):
    low = minimum(minimum(s[0], s[1]), minimum(s[2], s[3]))
    return minimum(low, minimum(minimum(s[4], s[5]), minimum(s[6], s[7])))


@leaf
def hold_corners(u, force, blocks, count, smallest):
    """Subtract the forces of the barrier in the suspect blocks, and note in ``blocks.corner`` how near it is and how stiff.

    Gives the smallest J, which is not a number where a force of the barrier is none.
    """
    nearest = splat(1.0)
    stiffest = splat(0.0)
    for entry in range(count):
        block = blocks.suspect[entry]
        edges, now, ratios, cof, J, g, numbers = _corners(u, blocks, block)
        lowest = _smallest(ratios)
        if any_below_zero(lowest - barrier.THRESHOLD * J):
            w = (1.0 / barrier.THRESHOLD) / J
            nearest = minimum(nearest, lowest * w)
            p0, c0 = _pull_and_curvature(ratios[0] * w)
            p1, c1 = _pull_and_curvature(ratios[1] * w)
            p2, c2 = _pull_and_curvature(ratios[2] * w)
            p3, c3 = _pull_and_curvature(ratios[3] * w)
            p4, c4 = _pull_and_curvature(ratios[4] * w)
            p5, c5 = _pull_and_curvature(ratios[5] * w)
            p6, c6 = _pull_and_curvature(ratios[6] * w)
            p7, c7 = _pull_and_curvature(ratios[7] * w)
            # dE / dD_a = v_a B G phi' ds/dD_a = B G phi' / (512 t J); by J it is - sum_a D_a dE/dD_a / J
            k = numbers[MODULUS] * w * (1.0 / 512.0)
            pulls = k * p0, k * p1, k * p2, k * p3, k * p4, k * p5, k * p6, k * p7
            along = pulls[0] * now[0] + pulls[1] * now[1] + pulls[2] * now[2] + pulls[3] * now[3]
            along = along + pulls[4] * now[4] + pulls[5] * now[5] + pulls[6] * now[6] + pulls[7] * now[7]
            by_J = -along / J
            hx, hy, hz = barrier.edge_forces(edges[0], edges[1], edges[2], pulls)
            fx = _minus_corner_forces(modes_of_edges(hx), by_J * cof[0], by_J * cof[1], by_J * cof[2], g)
            fy = _minus_corner_forces(modes_of_edges(hy), by_J * cof[3], by_J * cof[4], by_J * cof[5], g)
            fz = _minus_corner_forces(modes_of_edges(hz), by_J * cof[6], by_J * cof[7], by_J * cof[8], g)
            add_corner_forces(force, blocks.nodes, block * (8 * WIDTH), fx, fy, fz)
            smallest = minimum(smallest, J + 0.0 * (fx[0] + fy[0] + fz[0]))
            # v_a B G phi'' |ds/d nodes|^2 / m <= B G / (8 m) phi'' |dD_a/d edges|^2 / (t^2 J^2 D_a(rest))
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
            stiffest = minimum(stiffest, barrier.stiffness(edges[0], edges[1], edges[2], curvatures))
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
def _minus_corner_forces(m, sx, sy, sz, g):
    """Minus the corner values of one component, from forces on the modes and the derivative (sx, sy, sz) by its row of F."""
    return minus_from_modes(
        (
            m[0] + sx * g[0] + sy * g[1] + sz * g[2],
            m[1] + sx * g[3] + sy * g[4] + sz * g[5],
            m[2] + sx * g[6] + sy * g[7] + sz * g[8],
            m[3] + sx * g[9] + sy * g[10] + sz * g[11],
            m[4] + sx * g[12] + sy * g[13] + sz * g[14],
            m[5] + sx * g[15] + sy * g[16] + sz * g[17],
            m[6],
        )
    )


@leaf
def barrier_energy(u, blocks):
    """Energy of the barrier in all elements [J]."""
    energy = splat(0.0)
    for block in range(len(blocks.nodes)):
        _, _, ratios, _, J, _, numbers = _corners(u, blocks, block)
        w = (1.0 / barrier.THRESHOLD) / J
        low = _energy(ratios[0] * w, numbers[REST]) + _energy(ratios[1] * w, numbers[REST + 1])
        low = low + _energy(ratios[2] * w, numbers[REST + 2]) + _energy(ratios[3] * w, numbers[REST + 3])
        top = _energy(ratios[4] * w, numbers[REST + 4]) + _energy(ratios[5] * w, numbers[REST + 5])
        top = top + _energy(ratios[6] * w, numbers[REST + 6]) + _energy(ratios[7] * w, numbers[REST + 7])
        energy = energy + numbers[MODULUS] * (low + top)
    return sum_lanes(energy)


@leaf
def _energy(s, inverse):
    """v_a phi of a corner [m^3]."""
    return choose(inverse, barrier.density(s) / (512.0 * inverse), 0.0 * s)
