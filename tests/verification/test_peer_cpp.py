"""The step against an independent statement of it: studies/benchmarks/peer_cpp.cpp, the elements written by hand in C++."""

from __future__ import annotations

import numpy as np
import peer_cpp
import pytest

from explicitfe.app.tools.speed import problem
from explicitfe.fem.solve.stable_step import STEP_SHARE_OF_LIMIT
from explicitfe.platform.compiled.arrays import DAMPING_LOSS, SMALLEST_J

STEPS = 20


@pytest.mark.skipif(peer_cpp.compiler() is None, reason="there is no C++ compiler")
@pytest.mark.parametrize("element", ["hex8", "hex8-stiffness"])
def test_twenty_steps_agree(element, record_property):
    """Both ways to the geometry in C++ give our displacements, damping loss and smallest J.

    F is 1 and a strain, here of 2e-4 at most, and is rounded at 1e-16 of 1: forces differ by 1e-12 of themselves, and in twenty
    stable steps by twenty times that at most, 2e-11. Measured: below 1e-12.
    """
    simulation = problem(1000, element, 1)
    dt_s = STEP_SHARE_OF_LIMIT * simulation.stable_limit(20)
    simulation.start(dt_s)
    lost = simulation.ledger[DAMPING_LOSS]
    programs = [peer_cpp.InCpp(simulation, dt_s, geometry) for geometry in peer_cpp.GEOMETRIES]
    simulation.advance(STEPS, dt_s)
    ours = simulation.state.u[:, :3]
    for program in programs:
        program.run(STEPS)
        off = np.abs(program.displacement() - ours).max() / np.abs(ours).max()
        record_property(f"{program.geometry} off by", off)
        assert off < 2e-11
        expected = simulation.ledger[DAMPING_LOSS] - lost, simulation.ledger[SMALLEST_J]
        assert program.ledger() == pytest.approx(expected, rel=2e-11)
