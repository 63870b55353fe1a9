"""The paper's iteration: it converges to the constants, its trace is what it did, and what it cannot do it says."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import LOADS_N, TRUTH, response, setup

from explicitfe.inverse.identify.paper import ALPHA_M, BETA_M, MOST_RUNS, by_simulator, first_guess, identify_by_paper


def forward(C10: float, C20: float) -> np.ndarray:
    return response().at_force(LOADS_N, C10, C20)[0]


def test_it_converges_to_the_constants():
    """alpha and beta of 5 and 10 um are 0.5 % and 0.2 % of the displacements, which depend on the constants about linearly."""
    measured = forward(*TRUTH)
    fit = identify_by_paper(forward, measured, first_guess(setup(), LOADS_N[0], measured[0]))
    assert fit.status == "converged"
    assert fit.constants[0] == pytest.approx(TRUTH[0], rel=0.01)
    assert fit.constants[1] == pytest.approx(TRUTH[1], rel=0.05)
    assert fit.within.all()
    assert len(fit.trace) < 25


def test_its_trace_is_the_papers():
    """C10 <- C10 u1 / U1 while the smallest load is off by alpha or more; only else C20 changes; the end is within both."""
    measured = forward(*TRUTH)
    seen = []
    fit = identify_by_paper(forward, measured, (300.0, 10.0), progress=seen.append)
    assert seen == list(range(1, len(fit.trace) + 1))
    for before, after in zip(fit.trace, fit.trace[1:], strict=False):
        miss = before.displacement_m[0] - measured[0]
        if after.changed == "C10":
            assert abs(miss) >= ALPHA_M
            assert after.C10_Pa == pytest.approx(before.C10_Pa * before.displacement_m[0] / measured[0])
            assert after.C20_Pa == before.C20_Pa
        else:
            assert abs(miss) < ALPHA_M
            assert after.C10_Pa == before.C10_Pa
            assert abs(before.displacement_m[-1] - measured[-1]) >= BETA_M
        assert after.displacement_m == pytest.approx(forward(after.C10_Pa, after.C20_Pa))
    assert abs(fit.errors_m[0]) < ALPHA_M
    assert abs(fit.errors_m[-1]) < BETA_M
    assert {step.changed for step in fit.trace} == {"start", "C10", "C20"}


@pytest.mark.parametrize("start", [(50.0, 0.0), (2000.0, 500.0), (190.0, 400.0)])
def test_where_it_starts_does_not_matter(start):
    fit = identify_by_paper(forward, forward(*TRUTH), start)
    assert fit.status == "converged"
    assert fit.constants == pytest.approx(TRUTH, rel=0.06)


def test_softer_than_any_yeoh_law_is_a_bound():
    measured = forward(190.0, 0.0) * np.linspace(1.0, 1.1, len(LOADS_N))
    fit = identify_by_paper(forward, measured, (200.0, 50.0))
    assert fit.status == "bound"
    assert fit.constants[1] == 0.0


def test_no_convergence_is_told():
    """A forward model that does not answer to C20, always too soft: C20 grows until the runs are used up."""
    fit = identify_by_paper(lambda C10, C20: 1e-3 * np.array([100.0 / C10, 4.0]), np.array([1e-3, 3e-3]), (80.0, 20.0))
    assert fit.status == "not-converged"
    assert len(fit.trace) == MOST_RUNS


def test_always_too_stiff_ends_at_the_bound():
    fit = identify_by_paper(lambda C10, C20: 1e-3 * np.array([100.0 / C10, 2.0]), np.array([1e-3, 3e-3]), (80.0, 20.0))
    assert fit.status == "bound"
    assert fit.constants[1] == 0.0


def test_by_the_simulator_itself():
    """Real force-controlled runs agree with the response within its roughness."""
    run = by_simulator(setup(), LOADS_N)
    assert run(*TRUTH) == pytest.approx(forward(*TRUTH), rel=5.0 * response().roughness)
