"""Searches that begin in the wrong place, or stop before they arrive."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from synthetic import UPWARD, Linear, Planted, elastic, fitted, programme, white

from explicitfe.close_loop.statistics.fingerprints import scores
from explicitfe.close_loop.statistics.refit import BestFit, refit
from explicitfe.close_loop.statistics.starts import quality, refit_with, settled
from explicitfe.close_loop.statistics.system import Hypothesis
from explicitfe.effects.effect import Sought
from explicitfe.errors import RunError

D = programme(3)
# Waves of any number in a ramp, tried at three numbers: a search from the wrong one ends among the ripples between.
WAVES = {"wave": Planted(lambda n: np.sin(2.0 * np.pi * n * D), {"size": UPWARD, "n": Sought((1.0, 2.0, 3.5), 0.5, 6.0)})}


def with_waves(n: float, *, smooth: bool, fails: Callable[[Hypothesis], bool] = lambda model: False) -> Linear:
    return elastic(np.random.default_rng(1), effects=WAVES, extra=0.1 * np.sin(2.0 * np.pi * n * D), smooth=smooth, fails=fails)


def ends(system: Linear, starts: int = 3) -> tuple[BestFit, BestFit, BestFit]:
    """The baseline, one search from the trial, and the best of several starts."""
    covariance = white(system)
    fit, candidates, prints = fitted(system, covariance)
    (score,) = scores(fit, prints, candidates)
    begin = (score.values, *score.others)[:starts]
    once = refit(system, fit.model.plus(score.candidate.term, score.values), covariance)
    return fit, once, refit_with(system, fit, score.candidate.term, begin, covariance, score.drop)


def test_a_fit_with_an_effect_ends_no_worse_than_without_it():
    """Answers that are rough, as of a mesh, so that there are few steps: the search from the trial ends above the baseline; the
    one from no strength, where the model is the baseline, cannot.
    """
    fit, once, best = ends(with_waves(2.8, smooth=False))
    assert once.chi2 > fit.chi2
    assert quality(best) <= quality(fit)


def test_a_search_begins_again_where_a_trial_kept_no_promise():
    """The model cannot be computed at the best trial, and the search from the next one arrives: 120 rows, 4 parameters."""
    system = with_waves(1.4, smooth=True)
    covariance = white(system)
    fit, candidates, prints = fitted(system, covariance)
    (score,) = scores(fit, prints, candidates)
    assert score.values[1] == 1.0 and [values[1] for values in score.others] == [2.0, 3.5]
    broken = with_waves(1.4, smooth=True, fails=lambda model: bool(model.terms) and model.x[-1] < 1.1)
    best = refit_with(broken, fit, score.candidate.term, (score.values, *score.others), covariance, score.drop)
    assert best.chi2 < 2.0 * (3 * 40 - 4) and best.model.x[-1] == pytest.approx(1.4, abs=0.02)


def test_an_end_above_the_model_without_the_effect_is_a_failure():
    """Where not even no strength at all can be computed with the effect, nothing leads below the baseline."""
    system = with_waves(2.8, smooth=False)
    covariance = white(system)
    fit, candidates, prints = fitted(system, covariance)
    (score,) = scores(fit, prints, candidates)
    broken = with_waves(2.8, smooth=False, fails=lambda model: bool(model.terms) and model.x[-2] == 0.0)
    with pytest.raises(RunError, match="every end fits worse"):
        refit_with(broken, fit, score.candidate.term, (score.values,), covariance, score.drop)


@pytest.mark.parametrize("n", [1.4, 1.6])
def test_a_search_that_stopped_on_its_way_goes_on(n):
    """Eight steps are too few. The search goes on where it stopped, and comes to the noise of 120 rows."""
    _, once, _ = ends(system := with_waves(n, smooth=False))
    assert not once.converged
    arrived = settled(system, once, white(system))
    assert arrived.converged and arrived.chi2 < 2.0 * 120 < once.chi2
    assert settled(system, arrived, white(system)) is arrived
