"""Internal forces and energies of one-point hexes: templates, the law and the hourglass treatment are bound."""

from __future__ import annotations

import math
from types import ModuleType

from explicitfe.fem.elements.hex8 import (
    GEOMETRY,
    VOLUME,
    derived_geometry,
    geometry,
    gradient,
    hourglass_modes,
    minus_corner_forces,
)
from explicitfe.fem.forces import contraction, response
from explicitfe.fem.forces.barrier import barrier_energy, hold_corners, no_barrier, no_barrier_energy, no_suspects, note_suspects
from explicitfe.fem.forces.contraction import no_contraction, no_start
from explicitfe.fem.forces.corners import add_corner_forces, element_modes
from explicitfe.fem.forces.response import Layout
from explicitfe.fem.materials import Leaves
from explicitfe.fem.materials.kinematics import cofactor, determinant
from explicitfe.fem.mesh.hexmesh import CORNERS
from explicitfe.platform.compiled.jit import PLACEHOLDER, Dispatcher, bind, leaf
from explicitfe.platform.compiled.simd import WIDTH, load_many, min_lanes, minimum, splat, store, sum_lanes

# Placeholders, bound below to the response of a material and an hourglass treatment of elements/.
respond = energies = hourglass_invariant = hourglass_force = PLACEHOLDER
shape = hourglass_of_shape = law_constants = PLACEHOLDER
HOURGLASS_CONSTANTS = 1
start, contract = no_start, no_contraction
note, hold_apart, held_apart = no_suspects, no_barrier, no_barrier_energy


def bound(law: Leaves, treatment: ModuleType, layout: Layout, muscles: bool, derived: bool) -> tuple[Dispatcher, Dispatcher]:
    """The force and the energy kernel of a law with effects and an hourglass treatment.

    With or without stress of muscles, with geometry that is derived at each step or read.
    """
    respond, energies = response.bound(law, layout)
    common = {
        "law_constants": response.bound_constants(law),
        "hourglass_invariant": treatment.invariant,
        "shape": bound_shape(treatment, derived),
    }
    active = {"start": contraction.start_contraction, "contract": contraction.contract} if muscles else {}
    if treatment.HAS_BARRIER:
        active |= {"note": note_suspects, "hold_apart": hold_corners}
    energy_of_barrier = {"held_apart": barrier_energy} if treatment.HAS_BARRIER else {}
    force = bind(internal_force, apart=True, respond=respond, hourglass_force=treatment.force, **common, **active)
    energy = bind(internal_energy, apart=True, energies=energies, **common, **energy_of_barrier)
    return force, energy


def bound_shape(treatment: ModuleType, derived: bool) -> Dispatcher:
    """The leaf that gives the geometry of W elements and what the hourglass treatment knows of it."""
    if derived:
        return bind(derived_shape, inline=True, hourglass_of_shape=treatment.of_shape)
    return bind(read_shape, inline=True, HOURGLASS_CONSTANTS=hourglass_constants(treatment))


def read_shape(blocks, block):
    """Geometry (GEOMETRY,) and hourglass constants of W elements, as they are stored."""
    g = load_many(blocks.geometry, block * (GEOMETRY * WIDTH), GEOMETRY)
    h = load_many(blocks.hourglass, block * (HOURGLASS_CONSTANTS * WIDTH), HOURGLASS_CONSTANTS)
    return g, h


def derived_shape(blocks, block):
    """The same, from the reference positions of the nodes."""
    modes = element_modes(blocks.position, blocks.nodes, block * (8 * WIDTH))
    g = derived_geometry(modes)
    return g, hourglass_of_shape(modes, g)


def hourglass_constants(treatment: ModuleType) -> int:
    """How many numbers of each element an hourglass treatment reads."""
    cube = CORNERS[None] / 2.0
    return treatment.constants(cube, geometry(cube)).shape[1]


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

    The derivative of V W(F, delta), total Lagrangian (Miller et al. 2007): f_a = (V P + Q) B_a + sum_k r_k g_k with
    F = 1 + sum_a u_a B_a, P = dW/dF at constant delta, Q = V W' d delta/dF and r_k = V W' d delta/dq_k. The muscles' stress is
    added to P. The barrier adds its forces where a corner is about to fold.
    """
    start(blocks)
    suspects = 0
    smallest = splat(math.inf)
    for block in range(len(blocks.nodes)):
        at = block * (8 * WIDTH)
        g, h = shape(blocks, block)
        F, qx, qy, qz = kinematics(element_modes(u, blocks.nodes, at), g)
        cof = cofactor(F)
        J = determinant(F, cof)
        c = law_constants(blocks, block)
        delta = hourglass_invariant(F, qx, qy, qz, h)
        P, slope = respond(F, cof, J, delta, c, blocks, block)
        v = g[VOLUME]
        P = contract(P, F, v, blocks, block)
        rx, ry, rz, Q = hourglass_force(F, qx, qy, qz, h, v * slope)
        fx = minus_corner_forces(v * P[0] + Q[0], v * P[1] + Q[1], v * P[2] + Q[2], rx, g)
        fy = minus_corner_forces(v * P[3] + Q[3], v * P[4] + Q[4], v * P[5] + Q[5], ry, g)
        fz = minus_corner_forces(v * P[6] + Q[6], v * P[7] + Q[7], v * P[8] + Q[8], rz, g)
        add_corner_forces(force, blocks.nodes, at, fx, fy, fz)
        # zero times a force that is not finite is NaN: J > 0 then says that the force is sound as well
        smallest = minimum(smallest, J + 0.0 * (fx[0] + fy[0] + fz[0]))
        suspects = note(cof, J, qx, qy, qz, blocks, block, suspects)
    return min_lanes(hold_apart(u, force, blocks, suspects, smallest))


def internal_energy(u, blocks, element_J, element_energy, element_hourglass, sums):
    """Strain energy, hourglass energy, energy lost in the material so far, and that of the barrier, at displacement u [J].

    They are written into the first four entries of ``sums``; the first one is returned.

    ``element_J``, ``element_energy`` and ``element_hourglass``, (B, W) each, receive J, the strain energy without that of
    hourglass control, and the latter [J].
    """
    internal = splat(0.0)
    hourglass = splat(0.0)
    lost = splat(0.0)
    for block in range(len(blocks.nodes)):
        g, h = shape(blocks, block)
        F, qx, qy, qz = kinematics(element_modes(u, blocks.nodes, block * (8 * WIDTH)), g)
        cof = cofactor(F)
        J = determinant(F, cof)
        c = law_constants(blocks, block)
        delta = hourglass_invariant(F, qx, qy, qz, h)
        alone, e, gone = energies(F, cof, J, delta, c, blocks, block)
        internal = internal + g[VOLUME] * alone
        hourglass = hourglass + g[VOLUME] * e
        lost = lost + g[VOLUME] * gone
        store(element_J, block * WIDTH, J)
        store(element_energy, block * WIDTH, g[VOLUME] * alone)
        store(element_hourglass, block * WIDTH, g[VOLUME] * e)
    sums[0], sums[1], sums[2], sums[3] = sum_lanes(internal), sum_lanes(hourglass), sum_lanes(lost), held_apart(u, blocks)
    return sums[0]
