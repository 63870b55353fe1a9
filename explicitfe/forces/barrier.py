"""The barrier of elements/barrier.py in the sums over elements: which blocks are suspect, their forces and energies.

The loop over all elements only notes the blocks in which a corner may be folding. A second loop goes over these few, so that
the first one stays short.
"""

from __future__ import annotations

from explicitfe.compiled.arrays import CORNER, STIFFEST
from explicitfe.compiled.choose import any_below_zero
from explicitfe.compiled.jit import leaf
from explicitfe.compiled.simd import WIDTH, load, min_lanes, minimum, splat, sum_lanes
from explicitfe.elements import barrier
from explicitfe.elements.barrier import NUMBERS, edges_of_modes, modes_of_edges, ratio, spans
from explicitfe.elements.hex8 import VOLUME, derived_geometry, gradient, minus_from_modes
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
    reach = load(blocks.barrier, block * (NUMBERS * WIDTH))
    if any_below_zero(barrier.slack(cof, J, qx, qy, qz, reach)):
        return count + 1
    return count


@leaf
def _corners(u, blocks, block):
    """What the barrier of a block needs: the edges of each component, D_a, r_a / t, F's cofactor, J and the geometry."""
    at = block * (8 * WIDTH)
    mx, my, mz = element_modes(u, blocks.nodes, at)
    X, Y, Z = element_modes(blocks.position, blocks.nodes, at)
    g = derived_geometry((X, Y, Z))
    F = (
        gradient(mx, g, 0) + 1.0, gradient(mx, g, 1), gradient(mx, g, 2),
        gradient(my, g, 0), gradient(my, g, 1) + 1.0, gradient(my, g, 2),
        gradient(mz, g, 0), gradient(mz, g, 1), gradient(mz, g, 2) + 1.0,
    )  # fmt: skip
    cof = cofactor(F)
    J = determinant(F, cof)
    at_rest = spans(edges_of_modes(X), edges_of_modes(Y), edges_of_modes(Z))
    edges = edges_of_modes(_sum(X, mx)), edges_of_modes(_sum(Y, my)), edges_of_modes(_sum(Z, mz))
    now = spans(edges[0], edges[1], edges[2])
    v = g[VOLUME]
    s = (
        ratio(now[0], at_rest[0], J, v),
        ratio(now[1], at_rest[1], J, v),
        ratio(now[2], at_rest[2], J, v),
        ratio(now[3], at_rest[3], J, v),
        ratio(now[4], at_rest[4], J, v),
        ratio(now[5], at_rest[5], J, v),
        ratio(now[6], at_rest[6], J, v),
        ratio(now[7], at_rest[7], J, v),
    )
    return edges, now, at_rest, s, cof, J, g


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
    lowest = splat(1.0)
    stiffest = splat(0.0)
    for entry in range(count):
        block = blocks.suspect[entry]
        edges, now, at_rest, s, cof, J, g = _corners(u, blocks, block)
        v = g[VOLUME]
        nearest = _smallest(s)
        lowest = minimum(lowest, nearest)
        if any_below_zero(nearest - 1.0):
            # v_a B G phi' ds/dD_a = B G phi' / (512 t J)
            k = load(blocks.barrier, (block * NUMBERS + 1) * WIDTH) / (512.0 * barrier.THRESHOLD * J)
            pulls = (
                k * barrier.density_slope(s[0]),
                k * barrier.density_slope(s[1]),
                k * barrier.density_slope(s[2]),
                k * barrier.density_slope(s[3]),
                k * barrier.density_slope(s[4]),
                k * barrier.density_slope(s[5]),
                k * barrier.density_slope(s[6]),
                k * barrier.density_slope(s[7]),
            )
            # by J: - sum_a pulls_a D_a / J
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
            w = (-1.0 / (barrier.THRESHOLD * barrier.THRESHOLD)) / (J * J)
            curvatures = (
                barrier.curvature(s[0], at_rest[0], v),
                barrier.curvature(s[1], at_rest[1], v),
                barrier.curvature(s[2], at_rest[2], v),
                barrier.curvature(s[3], at_rest[3], v),
                barrier.curvature(s[4], at_rest[4], v),
                barrier.curvature(s[5], at_rest[5], v),
                barrier.curvature(s[6], at_rest[6], v),
                barrier.curvature(s[7], at_rest[7], v),
            )
            stiff = w * barrier.stiffness(edges[0], edges[1], edges[2], curvatures)
            stiffest = minimum(stiffest, load(blocks.barrier, (block * NUMBERS + 2) * WIDTH) * stiff)
    blocks.corner[CORNER] = min_lanes(lowest)
    blocks.corner[STIFFEST] = -min_lanes(stiffest)
    return smallest


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
        _, _, at_rest, s, _, _, _ = _corners(u, blocks, block)
        k = load(blocks.barrier, (block * NUMBERS + 1) * WIDTH) * (1.0 / 512.0)
        low = at_rest[0] * barrier.density(s[0]) + at_rest[1] * barrier.density(s[1])
        low = low + at_rest[2] * barrier.density(s[2]) + at_rest[3] * barrier.density(s[3])
        top = at_rest[4] * barrier.density(s[4]) + at_rest[5] * barrier.density(s[5])
        top = top + at_rest[6] * barrier.density(s[6]) + at_rest[7] * barrier.density(s[7])
        energy = energy + k * (low + top)
    return sum_lanes(energy)
