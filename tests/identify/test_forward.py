"""Responses: one point against its closed form, the scaling that makes C10 free, interpolation against the simulator."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import COARSE, DEEPEST_M, LOADS_N, TRUTH, response, setup

from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.inverse.identify.forward import PointResponse, Smooth, UniformResponse, forces, ratio, smoothest
from explicitfe.inverse.predict.setup import Setup, is_uniform
from explicitfe.platform.errors import RunError

POISSON = 0.499


def test_uniaxial_stress_is_that_of_an_incompressible_bar_but_for_its_compressibility():
    """P = 2 W' (l - l^-2) with W' = C10 + 2 C20 (l^2 + 2/l - 3); a bar that can change its volume differs by its J - 1,
    about (1 - 2 nu) E strain / E = 0.002 of the strain, which the stiffening law multiplies by less than 5 here."""
    stretch = np.array([0.5, 0.8, 0.95, 1.1, 1.5])
    C10, C20 = TRUTH
    closed = 2.0 * (C10 + 2.0 * C20 * (stretch**2 + 2.0 / stretch - 3.0)) * (stretch - stretch**-2)
    stress = point.uniaxial(Yeoh(C10_Pa=C10, C20_Pa=C20, poisson=POISSON), (), np.zeros(len(stretch)), stretch)
    assert np.abs(stress / closed - 1.0).max() < 5.0 * (1.0 - 2.0 * POISSON)
    tighter = point.uniaxial(Yeoh(C10_Pa=C10, C20_Pa=C20, poisson=0.4999), (), np.zeros(len(stretch)), stretch)
    # It is ten times less compressible, and ten times nearer.
    assert np.abs(tighter / closed - 1.0).max() == pytest.approx(0.1 * np.abs(stress / closed - 1.0).max(), rel=0.1)


def test_shear_stress_is_exact():
    """Simple shear keeps the volume: P12 = 2 W' g with I1 - 3 = g^2."""
    amount = np.array([-0.4, 0.0, 0.1, 0.7])
    stress = point.shear(Yeoh(C10_Pa=200.0, C20_Pa=100.0, poisson=POISSON), (), np.zeros(len(amount)), amount)
    assert stress == pytest.approx(2.0 * (200.0 + 200.0 * amount**2) * amount, rel=1e-12)


def test_slopes_of_responses():
    """What a response says of its slope is its derivative, by central differences."""
    for kind in ("uniaxial", "shear"):
        forward = PointResponse(kind, POISSON)
        x, h = np.array([0.7, 0.9, 1.2]), 1e-4
        slope = (forward.at(x + h, *TRUTH)[0] - forward.at(x - h, *TRUTH)[0]) / (2.0 * h)
        assert forward.at(x, *TRUTH)[1] == pytest.approx(slope, rel=1e-6)
    forward, h = response(), 1e-7
    depth = np.array([1e-3, 4e-3, 6e-3])
    slope = (forward.at_depth(depth + h, *TRUTH)[0] - forward.at_depth(depth - h, *TRUTH)[0]) / (2.0 * h)
    assert forward.at_depth(depth, *TRUTH)[1] == pytest.approx(slope, rel=1e-6)


def test_depth_and_force_are_inverse():
    forward = response()
    depth, slope = forward.at_force(LOADS_N, *TRUTH)
    force, stiffness = forward.at_depth(depth, *TRUTH)
    assert force == pytest.approx(LOADS_N, rel=1e-9)
    assert slope * stiffness == pytest.approx(1.0, rel=1e-9)
    assert forward.at_force(np.array([0.0, -1.0]), *TRUTH)[0] == pytest.approx([0.0, 0.0])
    assert forward.at_depth(np.array([0.0, -1e-3]), *TRUTH)[0] == pytest.approx([0.0, 0.0])


def test_both_constants_doubled_double_the_force():
    """F = C10 Phi(d; C20 / C10): exact, so the simulator agrees within the tolerance of its runs, 1e-4."""
    depths = np.array([1e-3, 3e-3, 5e-3])
    once, twice = (forces(setup(), (scale * 100.0, scale * 50.0), depths) for scale in (1.0, 2.0))
    assert twice == pytest.approx(2.0 * once, rel=2e-4)


def test_response_agrees_with_the_simulator_between_its_runs():
    """Within the roughness of contact on this coarse mesh."""
    forward = response()
    assert min(abs(ratio(*TRUTH) - q) for q in forward.ratios) > 0.01
    depths = np.array([2e-3, 4e-3, 6e-3])
    assert forward.at_depth(depths, *TRUTH)[0] == pytest.approx(forces(setup(), TRUTH, depths), rel=5.0 * forward.roughness)
    assert 0.0 < forward.roughness < 0.02


def test_beyond_its_runs_a_response_goes_straight_on():
    forward = response()
    depth = DEEPEST_M * np.array([1.0, 1.1, 1.2])
    force, slope = forward.at_depth(depth, *TRUTH)
    assert np.diff(force) == pytest.approx(slope[0] * np.diff(depth), rel=1e-9)


def test_specimen_between_smooth_platens_is_homogeneous():
    """The closed form of the homogeneous state against the simulator, up to a compression of 0.4."""
    body = {"symmetry": "sector", "radius_mm": 25.0, "height_mm": 30.0, "base": "sliding", "refinement": COARSE}
    platen = Setup(body, {"shape": "platen", "friction": 0.0}, POISSON, 1040.0)
    assert is_uniform(platen)
    forward = UniformResponse(platen, POISSON)
    depths = np.array([1e-3, 6e-3, 12e-3])
    assert forward.at_depth(depths, *TRUTH)[0] == pytest.approx(forces(platen, TRUTH, depths), rel=2e-3)
    assert forward.at_force(forward.at_depth(depths, *TRUTH)[0], *TRUTH)[0] == pytest.approx(depths, rel=1e-9)


def test_smoothing_keeps_what_is_smooth_and_measures_what_is_rough():
    """A polynomial comes back exactly; noise of 1e-3 is seen as that, with 16 points and 5 to 10 coefficients within half."""
    depths = 1e-3 * np.arange(1, 17) / 16
    secant = 3.0 + 2.0 * (depths / 1e-3) ** 2
    smooth = Smooth(1e-3, 1.0, 5)
    c, rough = smooth.coefficients(depths, secant * depths)
    assert rough < 1e-12
    assert smooth.at(c, depths)[0] == pytest.approx(secant * depths, rel=1e-12)
    noise = 1.0 + 1e-3 * np.random.default_rng(3).standard_normal(16)
    runs = [secant * depths * noise]
    assert smoothest(depths, runs).coefficients(depths, runs[0])[1] == pytest.approx(1e-3, rel=0.5)


def test_a_depth_that_is_not_reached_says_so():
    """The specimen is 20 mm high: no mesh can be pressed to 22."""
    with pytest.raises(RunError, match=r"the forward model stops at .* mm of 22 mm"):
        forces(setup(refinement=0.4), (200.0, 0.0), [5e-3, 22e-3])
