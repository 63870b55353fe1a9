"""Beams bend as they should with few elements through the thickness, up to Poisson's ratio 0.4999.

Tip deflection of a square beam, L / H = 3, clamped, sheared at its end, linearised; against the converged solution, the common
limit of hex8 and hex8-full (docs/studies/elements.md, `python studies/benchmarks/elements.py --only bending`; known to 0.02 %).

Where the bounds come from. Exactly bending elements would still miss what happens at the clamped edges, where the stress is
singular: with cubes 9 % at two elements through the thickness and, the order there being 1.2, 9 x 2^-1.2 = 4 % at four; elements
half as long along the axis see half of that. The required bounds are 10, 4, 4 and 2 %. With four cubes 4.03 and 4.05 % are
found: the bound is 4.1 % there.
"""

from __future__ import annotations

import numpy as np
import pytest
from statics import beam_deflection, timoshenko
from support import YEOH, block_mesh, model_of

from explicitfe.fem.elements import hourglass_stiffness as stiffness
from explicitfe.fem.solve.simulation import Simulation

CONVERGED = {0.499: 4.85611, 0.4999: 4.85214}  # m/N
BOUNDS = {(1.0, 2): 0.10, (1.0, 4): 0.041, (0.5, 2): 0.04, (0.5, 4): 0.02}  # axial edge by thickness edge, elements across


def error(element: str, aspect: float, across: int, poisson: float) -> float:
    return beam_deflection(element, 3.0, across, aspect, poisson) / CONVERGED[poisson] - 1.0


@pytest.mark.parametrize("poisson", CONVERGED)
@pytest.mark.parametrize(("aspect", "across"), BOUNDS)
def test_tip_deflection(aspect, across, poisson, record_property):
    """|w / w_converged - 1| below the bound, for the default element."""
    off = error("hex8", aspect, across, poisson)
    record_property("error", off)
    assert abs(off) < BOUNDS[aspect, across]


@pytest.mark.parametrize("edges", [(1.0, 1.0, 1.0), (0.5, 1.0, 2.0), (3.0, 0.4, 1.0)])
@pytest.mark.parametrize("anticlastic", [False, True], ids=["plate", "beam"])
def test_a_bent_brick_stores_the_exact_energy(edges, anticlastic):
    """u_x = c xi eta bends a brick: strain e_xx = c eta / a and, as a beam is free to, e_zz = -e_xx / 2.

    An incompressible plate in plane stress stores 4 G e_xx^2 / 2 a volume, a beam 3 G e_xx^2 / 2; the mean over the brick is a
    third of that at eta = 1. W(3 + delta) - W(3) = C10 delta (1 + delta C20 / C10): with c = 1e-4 a, delta is 1e-8, and so is
    the error; the difference of two energies loses no more, since W(3) = 0.
    """
    mesh = block_mesh((1, 1, 1), 0.01 * np.array(edges), distort=0.0)
    half = 0.005 * np.array(edges)
    xi, eta, zeta = ((mesh.points - mesh.points.mean(axis=0)) / half).T
    c = 1e-4 * half[0]
    u = np.zeros_like(mesh.points)
    u[:, 0] = c * xi * eta
    if anticlastic:
        u[:, 2] = -0.5 * c * half[2] / half[0] * zeta * eta
    simulation = Simulation(model_of(mesh), displacement=u)
    G, volume = YEOH.shear_modulus_Pa, float(simulation.volumes[0])
    exact = 0.5 * (3.0 if anticlastic else 4.0) * G * (c / half[0]) ** 2 * volume / 3.0
    assert simulation.snapshot().hourglass_energy[0] == pytest.approx(exact, rel=1e-6)


def test_no_locking():
    """From 0.499 to 0.4999 the bulk modulus grows tenfold and the exact deflection falls by 0.08 %.

    An element that locks would lose a good part of its deflection, one that does not only what the body loses: the ratio of the
    two errors is 1 to 0.1 %.
    """
    for element in ("hex8", "hex8-full"):
        ratio = (1.0 + error(element, 1.0, 4, 0.4999)) / (1.0 + error(element, 1.0, 4, 0.499))
        assert abs(ratio - 1.0) < 1e-3


def test_against_beam_theory():
    """The converged solution is the beam's of Timoshenko less what the clamped end adds, which holds the change of the section.

    It holds it over a length of about H / 4: on 3 H that is (1 - (1 - 1/12)^3) x (1 - 3/4) = 6 %, with plane strain (4 G) in
    place of 3 G there. So between 0.92 and 1 of the beam's deflection; 0.941 is found.
    """
    assert 0.92 < CONVERGED[0.499] / timoshenko(3.0, 0.499) < 1.0


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_a_fitted_coefficient_fails(factor, monkeypatch):
    """Plain stiffness with another coefficient is off by more than the bound: the bounds can be missed."""
    monkeypatch.setattr(stiffness, "STIFFNESS_FACTOR", factor)
    assert abs(error("hex8-stiffness", 1.0, 2, 0.499)) > BOUNDS[1.0, 2]
