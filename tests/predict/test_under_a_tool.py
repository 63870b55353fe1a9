"""Tests under a tool that cannot be computed: the cost has a bound, and the message names the load, the cause and a remedy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tool_curves import tool_curve

from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict import under_a_tool
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import EVERY, Constants, Numerics, Tissue
from explicitfe.platform.errors import RunError

pytestmark = pytest.mark.slow

TIME_s = np.linspace(0.0, 10.0, 11)


def glued(control: str = "force") -> Curve:
    """A ramp to 0.8 N or to 6 mm by a glued disc."""
    return tool_curve("ramp", TIME_s, 6e-4 * TIME_s, 0.08 * TIME_s, control=control, shape="bonded-disc")


def tissue(C10_Pa: float, refinement: float = 0.3) -> Tissue:
    numerics = Numerics(refinement=refinement, density=0.5, tolerance=1e-3)
    return Tissue(constants={EVERY: Constants(C10_Pa=C10_Pa)}, numerics=numerics)


def test_a_tissue_too_soft_for_a_force_is_named():
    with pytest.raises(
        RunError, match=r'curve "ramp": no equilibrium at .* N, .* s: .*; the last converged load is .* N\. .*stiffer'
    ):
        predict_test((glued(),), tissue(15.0))


def test_a_displacement_that_is_not_reached_is_named():
    """18 mm of 20 mm: coarse elements go there, small ones at the edge of the disc turn inside out on the way."""
    far = glued("displacement")
    far = replace(far, columns=far.columns | {"displacement_m": 3.0 * far.displacement_m})
    with pytest.raises(RunError, match=r"no equilibrium at .* mm, .* s: .*; the last converged load is .* mm\. .*displacement"):
        predict_test((far,), tissue(200.0, refinement=1.0))


def test_a_test_has_a_bound_on_its_iterations(monkeypatch):
    """A bound below what the first loads need: the test is given up there, and not computed to its end."""
    (whole,) = predict_test((glued(),), tissue(200.0))
    mean = whole.iterations / whole.instants
    monkeypatch.setattr(under_a_tool, "MOST_MEAN_ITERATIONS", int(0.5 * mean))
    with pytest.raises(RunError, match=r'curve "ramp": given up at .* s after \d+ iterations for \d of \d+ instants: .* stiffer'):
        predict_test((glued(),), tissue(200.0))
