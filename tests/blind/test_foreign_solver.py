"""The implicit solver of the foreign family against what is known without it."""

from __future__ import annotations

import numpy as np
import pytest

from studies.blind.foreign.axisymmetric import Drive, Press, RoundSpecimen
from studies.blind.foreign.contact import RigidTool
from studies.blind.foreign.law import HiddenTissue
from studies.blind.foreign.tool_tests import RigReading, ToolTest, answers

pytestmark = pytest.mark.slow

pytest.importorskip("skfem")
SPECIMEN = RoundSpecimen(10.0, 8.0)
FLAT = RigidTool("sphere", 1e5)  # over a specimen of 10 mm it is flat up to half a micrometre
SLIDES = {"base_compliance_mm_kPa": 1e9}


def uniaxial_N(stretch: float, slope_Pa: float) -> float:
    """Force of the specimen in a homogeneous compression, with dW/dI1 as given."""
    return 1e-6 * np.pi * 10.0**2 * 2.0 * slope_Pa * (stretch**-2 - stretch)


def test_a_homogeneous_state_has_the_force_of_the_closed_form():
    press = Press(SPECIMEN, FLAT, HiddenTissue(200.0, 100.0, 50.0, **SLIDES), fineness=0.2)
    x = 0.75**2 + 2.0 / 0.75 - 3.0
    _, force = press.advance(1.0, Drive(True, 2.0))
    assert force == pytest.approx(uniaxial_N(0.75, 200.0 + 200.0 * x + 150.0 * x**2), rel=2e-3)


def test_a_rig_that_gives_way_takes_its_share_of_the_displacement():
    press = Press(SPECIMEN, FLAT, HiddenTissue(200.0, 100.0, **SLIDES), fineness=0.2)
    depth, force = press.advance(1.0, Drive(True, 2.0, compliance_mm_N=5.0))
    x = (1.0 - depth / 8.0) ** 2 + 2.0 / (1.0 - depth / 8.0) - 3.0
    assert depth + 5.0 * force == pytest.approx(2.0, abs=1e-9)
    assert force == pytest.approx(uniaxial_N(1.0 - depth / 8.0, 200.0 + 200.0 * x), rel=2e-3)


def test_relaxation_leaves_the_long_term_share_and_a_force_that_is_imposed_is_met():
    relaxing = HiddenTissue(200.0, prony=((0.4, 1.0),), **SLIDES)
    press = Press(SPECIMEN, FLAT, relaxing, fineness=0.2)
    press.advance(1e-6, Drive(True, 1.0))
    _, sudden = press.advance(2e-6, Drive(True, 1.0))
    _, late = press.advance(50.0, Drive(True, 1.0))
    assert sudden == pytest.approx(uniaxial_N(0.875, 200.0), rel=2e-3)
    assert late == pytest.approx(0.6 * sudden, rel=1e-3)
    deeper, force = press.advance(100.0, Drive(False, 1.2 * late))
    assert force == pytest.approx(1.2 * late, rel=1e-6)
    assert deeper > 1.0


def test_friction_makes_a_loop_and_an_elastic_tissue_makes_none():
    loops = []
    for friction in (0.0, 0.1):
        tool = RigidTool("flat-cylinder", 4.0, edge_mm=1.0, friction=friction)
        corners = ((0.0, 0.0), (1.0, 1.0), (2.0, 0.0))
        test = ToolTest("curve-1", SPECIMEN, tool, corners, False, np.array([0.0, 0.5, 1.0, 1.5, 2.0]), {}, 0)
        up, _, down = answers([test], HiddenTissue(200.0, 100.0), RigReading(), [1.0], fineness=0.3)[0][1:4]
        loops.append((up - down) / up)
    assert abs(loops[0]) < 1e-9
    assert loops[1] > 0.001


def test_weight_lowers_the_surface_and_the_tool_starts_there():
    press = Press(RoundSpecimen(3.0, 12.0), FLAT, HiddenTissue(1000.0, gravity_m_s2=9.81, **SLIDES), fineness=0.2)
    # The mean stress of its own weight is rho g h / 2, over E = 6 C10.
    assert press.touch_mm == pytest.approx(12.0 * 0.5 * 1000.0 * 9.81 * 12e-3 / 6000.0, rel=0.05)
    assert press.advance(0.0, Drive(True, 0.0))[1] == pytest.approx(0.0, abs=1e-6)
