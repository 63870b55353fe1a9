"""A one-point hex that is held by energy sampling, beside the elements of the package: a table of docs/studies/elements.md.

    python studies/benchmarks/energy_sampling.py [--out docs/studies/elements.md]

Mean-strain hex with energy-sampling stabilisation (Krysl 2015, Int. J. Numer. Meth. Engng, doi:10.1002/nme.4721; with an
optimised share: Krysl 2016, Finite Elem. Anal. Des. 108):

    E = V W(F_mean) + s (sum_g w_g W_s(F_g) - V W_s(F_mean)),

with the law's own isochoric energy and a bulk modulus of Poisson's ratio 0.3 as W_s, which grows without bound where a Gauss
point gets flat. The share s is 1; or phi / (1 + phi), phi = 2 (1 + 0.3) (shortest / longest edge)^2, with which a slender element
bends as a beam with shear (Krysl 2016); or that of a cube, 0.72, for every element. The element is a prototype: it lives here and
is no choice of a scenario. A quarter of an hour on one core.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import elements  # sets the path to the tests
import numpy as np
from statics import MOTIONS, beam_deflection, block_run, cantilever, panel_tip, swing

from explicitfe.fem.elements import full
from explicitfe.fem.elements.full import GAUSS_POINTS, NUMBERS_PER_POINT, minus_point_forces, point_gradient
from explicitfe.fem.elements.hex8 import VOLUME, derived_geometry, to_modes
from explicitfe.fem.forces import response
from explicitfe.fem.forces.corners import add_corner_forces, element_modes, gather_corners
from explicitfe.fem.forces.internal import kinematics
from explicitfe.fem.materials import volumetric
from explicitfe.fem.materials.kinematics import cofactor, determinant
from explicitfe.fem.mesh.quality import edge_lengths
from explicitfe.fem.solve.kernels import ELEMENTS
from explicitfe.platform.compiled.jit import PLACEHOLDER, bind, leaf
from explicitfe.platform.compiled.simd import WIDTH, load, min_lanes, minimum, splat, store, sum_lanes

STABILISING_POISSON = 0.3
TIMED_TURNS = 40
BULK_PER_SHEAR = volumetric.bulk_modulus(1.0, STABILISING_POISSON)
SHARE_AT = GAUSS_POINTS * NUMBERS_PER_POINT  # place of s among the numbers of an element, after those of its Gauss points
NUMBERS = SHARE_AT + 1
_POINT_STRIDE = NUMBERS_PER_POINT * WIDTH

# Placeholders, bound below to a law of materials/.
invariants = first_stress = law_isochoric = law_slopes = law_constants = PLACEHOLDER
LAW_CONSTANTS = 1


def one(corners: np.ndarray) -> np.ndarray:
    """The whole of the stabilising energy, (m,)."""
    return np.ones(len(corners))


def optimised(corners: np.ndarray) -> np.ndarray:
    """The share (m,) with which elements of any proportions bend alike."""
    edges = edge_lengths(corners.reshape(-1, 3), np.arange(8 * len(corners)).reshape(-1, 8))
    phi = 2.0 * (1.0 + STABILISING_POISSON) * (edges.min(axis=1) / edges.max(axis=1)) ** 2
    return phi / (1.0 + phi)


def that_of_a_cube(corners: np.ndarray) -> np.ndarray:
    """The optimised share of a cube for every element, (m,)."""
    phi = 2.0 * (1.0 + STABILISING_POISSON)
    return np.full(len(corners), phi / (1.0 + phi))


def bound(law: Any, treatment: Any, layout: Any, muscles: bool, derived: bool) -> tuple[Any, Any]:
    """The force and the energy kernel of a law; neither effects nor muscles are known to the prototype."""
    assert not layout and not muscles
    common = {
        "invariants": law.kind.invariants,
        "LAW_CONSTANTS": law.count,
        "law_constants": response.bound_constants(law),
        "law_slopes": law.slopes_at,
    }
    force = bind(internal_force, stored=False, first_stress=law.kind.first_stress, **common)
    energy = bind(internal_energy, stored=False, law_isochoric=law.isochoric_at, **common)
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


@leaf
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7], a[8] + b[8]


def internal_force(u, force, blocks):
    """Subtract the internal force at displacement u from the node rows ``force``; give the smallest J.

    The mean gradient is the mean of those at the Gauss points, so the stress of F_mean acts as one more stress at each of them.
    """
    numbers = blocks.hourglass
    smallest = splat(math.inf)
    for block in range(len(blocks.nodes)):
        x, y, z = gather_corners(u, blocks.nodes, block * (8 * WIDTH))
        c = law_constants(blocks, block)
        first = block * (NUMBERS * WIDTH)
        share = load(numbers, first + SHARE_AT * WIDTH)
        g = derived_geometry(element_modes(blocks.position, blocks.nodes, block * (8 * WIDTH)))
        F = kinematics((to_modes(x), to_modes(y), to_modes(z)), g)[0]
        cof = cofactor(F)
        J = determinant(F, cof)
        here = invariants(F, cof, J)
        slopes = law_slopes(here, c)
        bulk = share * (BULK_PER_SHEAR * 2.0) * law_slopes((splat(3.0),), c)[0]
        pressure = volumetric.pressure(J, c[LAW_CONSTANTS - 1]) - volumetric.pressure(J, bulk)
        mean = first_stress(F, cof, J, here, ((1.0 - share) * slopes[0],), pressure)
        worst = J
        zero = splat(0.0)
        fx = fy = fz = (zero, zero, zero, zero, zero, zero, zero, zero)
        for point in range(GAUSS_POINTS):
            at = first + point * _POINT_STRIDE
            F = _deformation(x, y, z, numbers, at)
            cof = cofactor(F)
            J = determinant(F, cof)
            worst = minimum(worst, J)
            here = invariants(F, cof, J)
            slopes = law_slopes(here, c)
            P = _sum(mean, first_stress(F, cof, J, here, (share * slopes[0],), volumetric.pressure(J, bulk)))
            fx = minus_point_forces(fx, P[0], P[1], P[2], numbers, at)
            fy = minus_point_forces(fy, P[3], P[4], P[5], numbers, at)
            fz = minus_point_forces(fz, P[6], P[7], P[8], numbers, at)
        add_corner_forces(force, blocks.nodes, block * (8 * WIDTH), fx, fy, fz)
        # zero times a force that is not finite is NaN: J > 0 then says that the force is sound as well
        smallest = minimum(smallest, worst + 0.0 * (fx[0] + fy[0] + fz[0]))
    return min_lanes(smallest)


def internal_energy(u, blocks, element_J, element_energy, element_hourglass):
    """V W(F_mean), the energy of stabilisation, and 0 for what is lost [J]; of each element J, and both energies."""
    numbers = blocks.hourglass
    internal = splat(0.0)
    stabilising = splat(0.0)
    for block in range(len(blocks.nodes)):
        x, y, z = gather_corners(u, blocks.nodes, block * (8 * WIDTH))
        c = law_constants(blocks, block)
        first = block * (NUMBERS * WIDTH)
        share = load(numbers, first + SHARE_AT * WIDTH)
        g = derived_geometry(element_modes(blocks.position, blocks.nodes, block * (8 * WIDTH)))
        bulk = (BULK_PER_SHEAR * 2.0) * law_slopes((splat(3.0),), c)[0]
        held = splat(0.0)
        for point in range(GAUSS_POINTS):
            at = first + point * _POINT_STRIDE
            F = _deformation(x, y, z, numbers, at)
            cof = cofactor(F)
            J = determinant(F, cof)
            held = held + load(numbers, at) * (law_isochoric(invariants(F, cof, J), c) + volumetric.energy(J, bulk))
        F = kinematics((to_modes(x), to_modes(y), to_modes(z)), g)[0]
        cof = cofactor(F)
        J = determinant(F, cof)
        isochoric = law_isochoric(invariants(F, cof, J), c)
        energy = g[VOLUME] * (isochoric + volumetric.energy(J, c[LAW_CONSTANTS - 1]))
        held = share * (held - g[VOLUME] * (isochoric + volumetric.energy(J, bulk)))
        internal = internal + energy
        stabilising = stabilising + held
        store(element_J, block * WIDTH, J)
        store(element_energy, block * WIDTH, energy)
        store(element_hourglass, block * WIDTH, held)
    return sum_lanes(internal), sum_lanes(stabilising), 0.0, 0.0


def treatment(share: Callable[[np.ndarray], np.ndarray]) -> SimpleNamespace:
    """What a body asks of an element: its numbers, (m, NUMBERS), those of the fully integrated hex and s."""
    return SimpleNamespace(
        HAS_BARRIER=False,
        constants=lambda corners, geometry: np.column_stack([full.constants(corners, geometry), share(corners)]),
    )


TEMPLATES = SimpleNamespace(bound=bound)
SHARES = {"sampling": one, "sampling, optimised": optimised, "sampling, 0.72": that_of_a_cube}
ROWS = {"hex8": "hex8", "full": "hex8-full"} | {name: name for name in SHARES}
for name, share in SHARES.items():
    ELEMENTS[name] = TEMPLATES, treatment(share)  # type: ignore[assignment]


def check() -> None:
    """The force is the derivative of the energy, and an affine field on distorted hexes has no stabilising energy."""
    from support import block_mesh, model_of

    from explicitfe.fem.solve.simulation import Simulation
    from explicitfe.platform.compiled.arrays import HOURGLASS, INTERNAL

    random = np.random.default_rng(0)
    mesh = block_mesh((3, 3, 3), 0.01, distort=0.15)
    for element in SHARES:

        def energies(u: np.ndarray, element: str = element) -> np.ndarray:
            return Simulation(model_of(mesh, element=element), displacement=u).snapshot().energies

        u, way = (1e-3 * random.standard_normal(mesh.points.shape) for _ in range(2))
        force = Simulation(model_of(mesh, element=element)).internal_force(u)
        step = 1e-4
        rise = sum(s * (e[INTERNAL] + e[HOURGLASS]) for s in (1.0, -1.0) for e in [energies(u + s * step * way)]) / (2.0 * step)
        print(f"{element}: work {np.sum(force * way):.10e}, rise of the energy {rise:.10e}", flush=True)
        assert abs(np.sum(force * way) / rise - 1.0) < 1e-6
        affine = energies(mesh.points @ np.array([[0.2, 0.1, 0.0], [0.3, -0.1, 0.2], [0.0, 0.1, 0.1]]))
        print(f"{element}: affine field {affine[HOURGLASS] / affine[INTERNAL]:.1e}", flush=True)
        assert abs(affine[HOURGLASS] / affine[INTERNAL]) < 1e-12


def converged(text: str) -> dict[str, float]:
    """The converged values that docs/studies/elements.md states, in its units."""
    values = {f"{nu} bending": float(re.search(rf"\| 3 \| {nu} \| ([\d.]+) ", text)[1]) for nu in ("0.499", "0.4999")}  # type: ignore[index]
    values["panel"] = float(re.search(r"Converged: ([\d.]+) ±", text)[1])  # type: ignore[index]
    values["peak"] = float(re.search(r"\| 0.02 \| full \| 12 \| [^|]* \| ([\d.]+) ", text)[1])  # type: ignore[index]
    return values | {kind: float(re.search(rf"{kind} ([\d.]+) mJ ±", text)[1]) for kind in MOTIONS}  # type: ignore[index]


def rows(exact: dict[str, float]) -> list[list[str]]:
    """What is asked, and the answer of every element."""

    def off(value: float, reference: float) -> str:
        return f"{100 * (value / reference - 1):+.1f}"

    def bending(element: str, n: int, aspect: float, nu: str) -> str:
        return off(beam_deflection(element, 3.0, n, aspect, float(nu)), exact[f"{nu} bending"])

    def block(element: str, kind: str, n: int) -> str:
        run = block_run(kind, element, n)
        ended = f", stops: {run.status}" if run.status else ""
        return f"{off(1e3 * run.energy, exact[kind])}; {run.folded}; {run.smallest_J:.2f}{ended}"

    def peak(element: str, n: int) -> str:
        try:
            return off(1e3 * swing(*cantilever(element, n, 2.2))[1], exact["peak"])
        except RuntimeError as error:
            return f"stops: {error}"

    asked: dict[str, Callable[[str], str]] = {}
    for nu in ("0.499", "0.4999"):
        for shape, aspect in (("cubes", 1.0), ("half", 0.5)):
            for n in (2, 4):
                asked[f"bending 3:1, {shape} {n}, Poisson {nu}: error, %"] = lambda e, n=n, a=aspect, nu=nu: bending(e, n, a, nu)
    for n in (2, 4, 8):
        asked[f"tapered panel {n} x {n}: error, %"] = lambda e, n=n: off(1e3 * panel_tip(e, n)[0], exact["panel"])
    for n in (4, 8):
        for kind in MOTIONS:
            what = f"block {kind}, n = {n}: energy error, %; folded of {2 * n**3}; smallest J"
            asked[what] = lambda e, kind=kind, n=n: block(e, kind, n)
    for n in (4, 8):
        asked[f"cantilever 0.02 N, {n} across: first peak, error, %"] = lambda e, n=n: peak(e, n)
    lines = []
    for what, answer in asked.items():
        lines.append([what, *(answer(element) for element in ROWS.values())])
        print(lines[-1], flush=True)
    return lines


def costs() -> list[list[str]]:
    """Cost of a step and the stable step, all elements in one run, one after the other in each turn."""
    every = elements.costs(ROWS.values(), (10, 10, 10), TIMED_TURNS)
    ns_of_hex8, step_of_hex8 = every["hex8"]
    lines = [
        ["1 000 elements: ns per step and element", *(f"{ns:.0f}" for ns, _ in every.values())],
        ["the same, ratio to hex8", *(f"{ns / ns_of_hex8:.2f}" for ns, _ in every.values())],
        ["stable step, ratio to hex8", *(f"{step / step_of_hex8:.3f}" for _, step in every.values())],
    ]
    print(lines, flush=True)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=elements.ROOT / "docs" / "studies" / "elements.md")
    arguments = parser.parse_args()
    check()
    text = arguments.out.read_text(encoding="utf-8")
    table = elements.table(("", *ROWS), costs() + rows(converged(text)))
    mark, end = "<!-- sampling -->", "<!-- end sampling -->"
    before, following = text.split(mark)
    arguments.out.write_text(before + mark + "\n\n" + table + "\n\n" + end + following.split(end)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
