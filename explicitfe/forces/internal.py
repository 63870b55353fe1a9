"""Internal forces of the elements, and their energies. Both are templates: the law and the hourglass treatment are bound."""

from __future__ import annotations

import math

from explicitfe.elements.hex8 import GEOMETRY, corner_forces, gradient, hourglass_modes, to_modes
from explicitfe.jit import leaf
from explicitfe.materials.kinematics import cofactor, determinant
from explicitfe.simd import WIDTH, gather_rows, load_many, min_lanes, minimum, scatter_rows, splat, store, sum_lanes

# Placeholders, bound in build.py to a law of materials/ and a treatment of elements/.
law_energy = law_stress = hourglass_energy = hourglass_force = None
LAW_CONSTANTS = HOURGLASS_CONSTANTS = 1


@leaf
def element_modes(u, nodes, at):
    """Seven displacement modes of each component, for the W elements whose node numbers start at ``at``."""
    x0, y0, z0 = gather_rows(u, nodes, at)
    x1, y1, z1 = gather_rows(u, nodes, at + WIDTH)
    x2, y2, z2 = gather_rows(u, nodes, at + 2 * WIDTH)
    x3, y3, z3 = gather_rows(u, nodes, at + 3 * WIDTH)
    x4, y4, z4 = gather_rows(u, nodes, at + 4 * WIDTH)
    x5, y5, z5 = gather_rows(u, nodes, at + 5 * WIDTH)
    x6, y6, z6 = gather_rows(u, nodes, at + 6 * WIDTH)
    x7, y7, z7 = gather_rows(u, nodes, at + 7 * WIDTH)
    return (
        to_modes((x0, x1, x2, x3, x4, x5, x6, x7)),
        to_modes((y0, y1, y2, y3, y4, y5, y6, y7)),
        to_modes((z0, z1, z2, z3, z4, z5, z6, z7)),
    )


@leaf
def subtract_corner_forces(force, nodes, at, fx, fy, fz):
    """Subtract the corner forces of W elements from the node rows."""
    scatter_rows(force, nodes, at, fx[0], fy[0], fz[0])
    scatter_rows(force, nodes, at + WIDTH, fx[1], fy[1], fz[1])
    scatter_rows(force, nodes, at + 2 * WIDTH, fx[2], fy[2], fz[2])
    scatter_rows(force, nodes, at + 3 * WIDTH, fx[3], fy[3], fz[3])
    scatter_rows(force, nodes, at + 4 * WIDTH, fx[4], fy[4], fz[4])
    scatter_rows(force, nodes, at + 5 * WIDTH, fx[5], fy[5], fz[5])
    scatter_rows(force, nodes, at + 6 * WIDTH, fx[6], fy[6], fz[6])
    scatter_rows(force, nodes, at + 7 * WIDTH, fx[7], fy[7], fz[7])


@leaf
def kinematics(modes, g):
    """Deformation gradient F = 1 + grad u and hourglass modes q of each component."""
    mx, my, mz = modes
    xx, xy, xz = gradient(mx, g, 0), gradient(mx, g, 1), gradient(mx, g, 2)
    yx, yy, yz = gradient(my, g, 0), gradient(my, g, 1), gradient(my, g, 2)
    zx, zy, zz = gradient(mz, g, 0), gradient(mz, g, 1), gradient(mz, g, 2)
    qx = hourglass_modes(mx, g, xx, xy, xz)
    qy = hourglass_modes(my, g, yx, yy, yz)
    qz = hourglass_modes(mz, g, zx, zy, zz)
    return (xx + 1.0, xy, xz, yx, yy + 1.0, yz, zx, zy, zz + 1.0), qx, qy, qz


def internal_force(u, force, blocks):
    """Subtract the internal force at displacement u from the node rows ``force``; give the smallest J.

    f_a = V P B_a + sum_k r_k g_k with F = 1 + sum_a u_a B_a, P = dW/dF and r_k = dE/dq_k: the derivative of
    V W(F) + E(q) (total Lagrangian; Miller et al. 2007).
    """
    smallest = splat(math.inf)
    for block in range(len(blocks.nodes)):
        at = block * (8 * WIDTH)
        g = load_many(blocks.geometry, block * (GEOMETRY * WIDTH), GEOMETRY)
        F, qx, qy, qz = kinematics(element_modes(u, blocks.nodes, at), g)
        cof = cofactor(F)
        J = determinant(F, cof)
        smallest = minimum(smallest, J)
        c = load_many(blocks.constants, block * (LAW_CONSTANTS * WIDTH), LAW_CONSTANTS)
        P = law_stress(F, cof, J, c)
        h = load_many(blocks.hourglass, block * (HOURGLASS_CONSTANTS * WIDTH), HOURGLASS_CONSTANTS)
        fx = corner_forces(P[0], P[1], P[2], hourglass_force(qx, h), g)
        fy = corner_forces(P[3], P[4], P[5], hourglass_force(qy, h), g)
        fz = corner_forces(P[6], P[7], P[8], hourglass_force(qz, h), g)
        subtract_corner_forces(force, blocks.nodes, at, fx, fy, fz)
    return min_lanes(smallest)


def internal_energy(u, blocks, element_J, element_hourglass):
    """Strain energy and hourglass energy at displacement u [J].

    ``element_J`` (B, W) receives J and ``element_hourglass`` (B, W) the hourglass energy [J] of each element.
    """
    internal = splat(0.0)
    hourglass = splat(0.0)
    for block in range(len(blocks.nodes)):
        g = load_many(blocks.geometry, block * (GEOMETRY * WIDTH), GEOMETRY)
        F, qx, qy, qz = kinematics(element_modes(u, blocks.nodes, block * (8 * WIDTH)), g)
        J = determinant(F, cofactor(F))
        c = load_many(blocks.constants, block * (LAW_CONSTANTS * WIDTH), LAW_CONSTANTS)
        h = load_many(blocks.hourglass, block * (HOURGLASS_CONSTANTS * WIDTH), HOURGLASS_CONSTANTS)
        e = hourglass_energy(qx, qy, qz, h)
        internal = internal + g[33] * law_energy(F, J, c)
        hourglass = hourglass + e
        store(element_J, block * WIDTH, J)
        store(element_hourglass, block * WIDTH, e)
    return sum_lanes(internal), sum_lanes(hourglass)


def largest_strain_rate(v, blocks):
    """Largest |grad v| of any element [1/s], in reference coordinates, at the velocity v."""
    largest = splat(0.0)
    for block in range(len(blocks.nodes)):
        g = load_many(blocks.geometry, block * (GEOMETRY * WIDTH), GEOMETRY)
        square = splat(0.0)
        for modes in element_modes(v, blocks.nodes, block * (8 * WIDTH)):
            x, y, z = gradient(modes, g, 0), gradient(modes, g, 1), gradient(modes, g, 2)
            square = square + x * x + y * y + z * z
        largest = minimum(largest, -square)
    return math.sqrt(-min_lanes(largest))
