"""Curves that are read off a ramp."""

from __future__ import annotations

import numpy as np
import pytest
from tool_curves import tool_curve

from explicitfe.inverse.close_loop.specimens.plan import Plan, plan_of
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict.tissue import EVERY, Constants, Tissue

DEPTH_M = 1e-3 * np.array([-0.02, 0.0, 0.5, 1.0, 2.0, 0.0])
RAMP_M = np.linspace(0.0, 2e-3, 21)


def curve(shape: str, depth_m: np.ndarray = DEPTH_M) -> Curve:
    return tool_curve("one", np.arange(float(len(depth_m))), depth_m, 100.0 * depth_m, shape=shape)


def read(shape: str, first_N: float) -> np.ndarray:
    """What a ramp answers that begins at a force and is linear in the depth."""
    one = curve(shape)
    ramp = curve(shape, RAMP_M)
    plan = Plan(((ramp,), ""), (one,), by_ramp=True, by_hexahedra=False)
    return plan.read([first_N + 100.0 * RAMP_M], {})["one"]


@pytest.mark.parametrize("first_N", [0.0, 0.05])
def test_a_preload_is_kept_at_zero_displacement(first_N):
    """The displacement counts from the preload, so the force there is the preload, also where the tool is lifted."""
    assert read("flat-cylinder", first_N) == pytest.approx(first_N + 100.0 * np.maximum(DEPTH_M, 0.0), abs=1e-12)


def test_a_small_pull_of_a_tied_disc_is_the_opposite_of_a_push():
    assert read("bonded-disc", 0.0) == pytest.approx(100.0 * DEPTH_M, abs=1e-12)


def test_only_a_large_pull_of_a_tied_disc_needs_its_whole_course():
    tissue = Tissue(constants={EVERY: Constants(C10_Pa=200.0, C20_Pa=100.0)})
    small, large = curve("bonded-disc"), curve("bonded-disc", np.array([0.0, 1e-3, -5e-4]))
    assert plan_of(tissue, (small,), (small,), False).by_ramp
    assert not plan_of(tissue, (large,), (large,), False).by_ramp
