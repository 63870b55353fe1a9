"""Central differences are of second order in time, also where a load jumps and where mass-proportional damping acts.

u_(n+1) - 2 u_n + u_(n-1) = dt^2 u'' + O(dt^4) for smooth u. A jump of the load keeps the order if the start takes half a
step, v_(-1/2) = v_0 - dt/2 a_0, and if a jump on a step boundary is taken with the mean of both sides; damping keeps it if its
velocity is (v- + v+) / 2. Any of these done otherwise leaves an error of first order.
"""

from __future__ import annotations

import numpy as np
import pytest
from support import IN_RUNS, LAWS, assert_order, block_mesh, model_of, true_limit

from explicitfe.fem.model.model import NodalLoad
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient

STEPS = 16  # of the stable limit, in the whole run


@pytest.mark.parametrize(("law", "element"), IN_RUNS)
def test_second_order_with_load_jumps_and_damping(law, element, record_property):
    """|u_dt(T) - u(T)| ~ dt^2 for steps of 1/8 to 1/64 of the limit: orders of 2.0 +- 0.15 over three halvings.

    A clamped block, a step load from 0 to T/2, alpha = 40 1/s, T = 16 limits. The phase of the highest mode is off by
    (omega dt)^2 / 24 omega T = (1/4)^2 / 24 x 32 = 0.08 at the longest step: asymptotic, its square moves the order by less
    than 0.1. The reference, 1/512 of the limit, is off by 1/64 of the last error, which moves the last order by
    log2((1 - 1/256) / (1 - 1/64)) = 0.02.
    """
    mesh = block_mesh((2, 2, 2), seed=13)
    nodes = mesh.node_sets["x1"]
    force = np.tile(np.array([0.01, 0.0, 0.02]) / len(nodes), (len(nodes), 1))
    limit = true_limit(Simulation(model_of(mesh, LAWS[law], held=("x0",), element=element)), np.zeros_like(mesh.points))
    duration = STEPS * limit
    load = NodalLoad("end", nodes, force, Profile.step(0.0, 0.5 * duration))
    model = model_of(mesh, LAWS[law], held=("x0",), alpha_per_s=40.0, loads=(load,), element=element)

    def end(parts: int) -> np.ndarray:
        simulation = Simulation(model)
        transient = Transient(simulation, duration, step_s=limit / parts)
        assert transient.advance_to(duration) is None
        assert simulation.steps == STEPS * parts
        return simulation.displacement.copy()

    reference = end(512)
    assert np.abs(reference).max() > 3e-4  # 3 % of an edge
    parts = [8, 16, 32, 64]
    errors = [np.linalg.norm(end(k) - reference) for k in parts]
    record_property("orders", assert_order(errors, [limit / k for k in parts], order=2.0, tolerance=0.15).tolist())
