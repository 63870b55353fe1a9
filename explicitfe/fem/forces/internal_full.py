"""Internal forces and energies of the fully integrated hex (elements/full.py): templates, the law is bound."""

from __future__ import annotations

import math
from types import ModuleType

from explicitfe.fem.elements.full import GAUSS_POINTS, NUMBERS_PER_POINT, minus_point_forces, point_gradient
from explicitfe.fem.elements.hex8 import GEOMETRY
from explicitfe.fem.forces import contraction, response
from explicitfe.fem.forces.contraction import no_contraction, no_start
from explicitfe.fem.forces.corners import add_corner_forces, gather_corners
from explicitfe.fem.forces.response import Layout
from explicitfe.fem.materials import Leaves, volumetric
from explicitfe.fem.materials.kinematics import cofactor, determinant
from explicitfe.platform.compiled.jit import PLACEHOLDER, Dispatcher, bind, leaf
from explicitfe.platform.compiled.simd import WIDTH, load, min_lanes, minimum, splat, store, sum_lanes
from explicitfe.platform.errors import InputError

# Placeholders, bound below to a law of materials/.
invariants = first_stress = law_isochoric = law_slopes = PLACEHOLDER
law_constants = PLACEHOLDER
LAW_CONSTANTS = 1
start, contract = no_start, no_contraction
_ELEMENT_STRIDE = GAUSS_POINTS * NUMBERS_PER_POINT * WIDTH
_POINT_STRIDE = NUMBERS_PER_POINT * WIDTH


def bound(law: Leaves, treatment: ModuleType, layout: Layout, muscles: bool, derived: bool) -> tuple[Dispatcher, Dispatcher]:
    """The force and the energy kernel of a law, with or without stress of muscles; ``treatment`` is elements/full.py.

    Geometry is always read, never ``derived``: that of eight points takes too long.

    Raises
    ------
    InputError : there are effects, which have a memory at one point of an element only.
    """
    if layout:
        raise InputError('element = "hex8-full" knows no effects of the material; take "hex8".')
    common = {
        "invariants": law.kind.invariants,
        "LAW_CONSTANTS": law.count,
        "law_constants": response.bound_constants(law),
    }
    active = {"start": contraction.start_contraction, "contract": contraction.contract} if muscles else {}
    leaves = {"law_slopes": law.slopes_at, "first_stress": law.kind.first_stress}
    force = bind(internal_force, apart=True, **leaves, **common, **active)
    energy = bind(internal_energy, apart=True, law_isochoric=law.isochoric_at, **common)
    return force, energy


@leaf
def _deformation(x, y, z, numbers, at):
    """Deformation gradient at the Gauss point whose numbers start at ``at``."""
    return (
        point_gradient(x, numbers, at, 0) + 1.0,
        point_gradient(x, numbers, at, 1),
        point_gradient(x, numbers, at, 2),
        point_gradient(y, numbers, at, 0),
        point_gradient(y, numbers, at, 1) + 1.0,
        point_gradient(y, numbers, at, 2),
        point_gradient(z, numbers, at, 0),
        point_gradient(z, numbers, at, 1),
        point_gradient(z, numbers, at, 2) + 1.0,
    )


def internal_force(u, force, blocks):
    """Subtract the internal force at displacement u from the node rows ``force``; give the smallest J of any Gauss point."""
    start(blocks)
    numbers = blocks.hourglass
    smallest = splat(math.inf)
    for block in range(len(blocks.nodes)):
        x, y, z = gather_corners(u, blocks.nodes, block * (8 * WIDTH))
        c = law_constants(blocks, block)
        volume = splat(0.0)
        for point in range(GAUSS_POINTS):
            at = block * _ELEMENT_STRIDE + point * _POINT_STRIDE
            F = _deformation(x, y, z, numbers, at)
            J = determinant(F, cofactor(F))
            smallest = minimum(smallest, J)
            volume = volume + load(numbers, at) * J
        mean = volume / load(blocks.geometry, (block * GEOMETRY + GEOMETRY - 1) * WIDTH)
        pressure = volumetric.pressure(mean, c[LAW_CONSTANTS - 1])
        zero = splat(0.0)
        fx = fy = fz = (zero, zero, zero, zero, zero, zero, zero, zero)
        for point in range(GAUSS_POINTS):
            at = block * _ELEMENT_STRIDE + point * _POINT_STRIDE
            F = _deformation(x, y, z, numbers, at)
            cof = cofactor(F)
            J = determinant(F, cof)
            here = invariants(F, cof, J)
            P = first_stress(F, cof, J, here, law_slopes(here, c), pressure)
            P = contract(P, F, load(numbers, at), blocks, block)
            fx = minus_point_forces(fx, P[0], P[1], P[2], numbers, at)
            fy = minus_point_forces(fy, P[3], P[4], P[5], numbers, at)
            fz = minus_point_forces(fz, P[6], P[7], P[8], numbers, at)
        add_corner_forces(force, blocks.nodes, block * (8 * WIDTH), fx, fy, fz)
        # zero times a force that is not finite is NaN: J > 0 then says that the force is sound as well
        smallest = minimum(smallest, mean + 0.0 * (fx[0] + fy[0] + fz[0]))
    return min_lanes(smallest)


def internal_energy(u, blocks, element_J, element_energy, element_hourglass, sums):
    """Strain energy at displacement u, and 0 for hourglass control, for what is lost and for a barrier [J], into ``sums``.

    ``element_J`` (B, W) receives the mean J, ``element_energy`` (B, W) the strain energy [J], ``element_hourglass`` zeros.
    """
    numbers = blocks.hourglass
    internal = splat(0.0)
    for block in range(len(blocks.nodes)):
        x, y, z = gather_corners(u, blocks.nodes, block * (8 * WIDTH))
        c = law_constants(blocks, block)
        volume = splat(0.0)
        energy = splat(0.0)
        for point in range(GAUSS_POINTS):
            at = block * _ELEMENT_STRIDE + point * _POINT_STRIDE
            F = _deformation(x, y, z, numbers, at)
            cof = cofactor(F)
            J = determinant(F, cof)
            w = load(numbers, at)
            volume = volume + w * J
            energy = energy + w * law_isochoric(invariants(F, cof, J), c)
        reference = load(blocks.geometry, (block * GEOMETRY + GEOMETRY - 1) * WIDTH)
        mean = volume / reference
        energy = energy + reference * volumetric.energy(mean, c[LAW_CONSTANTS - 1])
        internal = internal + energy
        store(element_J, block * WIDTH, mean)
        store(element_energy, block * WIDTH, energy)
        store(element_hourglass, block * WIDTH, splat(0.0))
    sums[0], sums[1], sums[2], sums[3] = sum_lanes(internal), 0.0, 0.0, 0.0
    return sums[0]
