"""Fast answers near a baseline, with a system whose full answers are known functions."""

from __future__ import annotations

import numpy as np
import pytest

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.statistics.refit import BestFit
from explicitfe.inverse.close_loop.statistics.sketch import Sketch, change_by_terms
from explicitfe.inverse.close_loop.statistics.system import Hypothesis, Parameter, Term

ROWS = np.linspace(0.1, 1.0, 12)
BASE = (Parameter("a", Sought((1.0,), 0.0, 10.0), 1.0), Parameter("b", Sought((1.0,), 0.0, 10.0), 1.0))
HISTORY = Term("slow", (Parameter("slow.g", Sought((0.2,), 0.0, 1.0), 0.2),))
SHAPE = Term(
    "shape", (Parameter("shape.size", Sought((0.3,), 0.0, 1.0), 0.3), Parameter("shape.place", Sought((0.5,), 0.0, 1.0), 0.5))
)


class Series:
    measured = ROWS


class Known:
    """Full answers a x + b x^2 (1 - g) + size sin x; fast ones are 1 to 10 % smaller and have no ``shape``."""

    series = (Series(),)
    base = BASE

    fast_everywhere = False

    def has_sketch(self, effect: str) -> bool:
        return effect == "slow"

    def sketched(self, models):
        return [[self.full(model) / (1.1 - 0.02 * self.full(model))] for model in models]

    def full(self, model: Hypothesis) -> np.ndarray:
        a, b = model.x[:2]
        strength = {term.effect: value for term, value in zip(model.terms, model.x[2:], strict=False)}
        return a * ROWS + b * ROWS**2 * (1.0 - strength.get("slow", 0.0)) + strength.get("shape", 0.0) * np.sin(ROWS)


def sketch(baseline: Hypothesis) -> Sketch:
    system = Known()
    slopes = np.column_stack([ROWS, ROWS**2])
    answer = system.full(baseline)
    fit = BestFit(baseline, answer, slopes, 0.0 * answer, slopes, (), True)
    return Sketch(system, fit)


def test_a_factor_of_the_answer_makes_fast_answers_full_ones():
    """The fast answers lack a factor that is linear in the full ones, and so close to a cubic in the fast ones."""
    baseline = Hypothesis(BASE, (), np.array([2.0, 3.0]))
    one = sketch(baseline)
    (answer,) = one.answers([baseline])
    assert answer[0] == pytest.approx(one.system.full(baseline), rel=1e-12)
    moved = baseline.at([1.6, 3.3])  # smaller answers than those of the baseline
    (answer,) = one.answers([moved])
    assert answer[0] == pytest.approx(one.system.full(moved), rel=1e-4)
    assert one.slopes(baseline)[:-1] == pytest.approx(
        one.baseline.slopes[:-1], rel=2e-3
    )  # beyond the last row the factor is constant


def test_the_factor_is_not_extrapolated():
    baseline = Hypothesis(BASE, (), np.array([2.0, 3.0]))
    one = sketch(baseline)
    stiffer = baseline.at([3.0, 4.5])
    (fast,), (more,) = one.system.sketched([baseline, stiffer])
    (answer,) = one.answers([stiffer])
    factor = one.system.full(baseline)[-1] / fast[-1]
    assert answer[0][-1] == pytest.approx(factor * more[-1], rel=1e-4)


def test_history_is_fast_and_derivatives_of_shapes_are_left_open():
    """History changes the fast answer; a model with another effect has none, and its derivatives stay open."""
    baseline = Hypothesis(BASE, (), np.array([2.0, 3.0]))
    one = sketch(baseline)
    slow = baseline.plus(HISTORY, (0.2,))
    (answer,) = one.answers([slow])
    assert answer[0] == pytest.approx(one.system.full(slow), rel=1e-4)
    assert change_by_terms(one, slow) == pytest.approx(answer[0] - one.system.full(baseline), rel=1e-9)
    shaped = slow.plus(SHAPE, (0.3, 0.5))
    slopes = one.slopes(shaped)
    assert slopes[:-1, 2] == pytest.approx(-3.0 * ROWS[:-1] ** 2, rel=2e-3)
    assert np.isnan(slopes[:, 3:]).all()
    assert one.answers([shaped, slow])[0] is None
    assert one.answers([shaped, slow])[1][0] == pytest.approx(answer[0])
