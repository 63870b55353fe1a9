"""How probable each cause is: closed forms of the evidence, and searches of a linear system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from synthetic import Linear, Planted, elastic, said
from test_loop import BUMP, EFFECTS, TWIN, WAVE, D

from explicitfe.close_loop.posterior import (
    Posterior,
    amplitude,
    count_of_testable,
    discrepancy,
    evidence_of,
    posterior_of,
    sureness,
)
from explicitfe.close_loop.search import Outcome, search
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.close_loop.verdict import follow_posterior

UNSEEN = "effects that the search was not told"


def searched(seed: int = 1, effects=EFFECTS, max_effects: int = 2, **more) -> tuple[Linear, Outcome, Posterior]:
    system = elastic(np.random.default_rng(seed), tests=4, effects=effects, **more)
    outcome = search(system, max_effects=max_effects)
    return system, outcome, posterior_of(evidence_of(outcome, system), count_of_testable(outcome))


@pytest.mark.parametrize(("along", "limit"), [(3.0, 10.0), (-4.0, 10.0), (40.0, 2.0), (-60.0, 0.5)])
def test_evidence_of_an_amplitude(along, limit):
    """log of the integral of exp(a b - a^2 g / 2) under a half-normal prior that ends at the limit, by quadrature."""
    size, sd = 9.0, 0.7
    whole = 2.0 * norm.cdf(limit / sd) - 1.0
    integral, _ = quad(lambda a: np.exp(a * along - 0.5 * a * a * size) * 2.0 * norm.pdf(a, scale=sd) / whole, 0.0, limit)
    log = amplitude(np.array([along]), np.array([size]), np.array([sd]), np.array([limit]))
    assert log[0] == pytest.approx(np.log(integral), abs=1e-6)


def test_evidence_of_a_discrepancy():
    """What noise leaves (chi2 = free) speaks against one, twice as much of forty functions for it, by nats."""
    assert discrepancy(40.0, 40) < -0.5
    assert discrepancy(80.0, 40) > 3.0
    assert discrepancy(0.0, 0) == pytest.approx(0.0, abs=1e-12)


def test_a_control_is_most_likely_that():
    """Over twenty seeds: the mean probability of nothing is what is left by two of three effects at odds of one half."""
    sure = [posterior.of(frozenset()) for _, _, posterior in map(searched, range(20))]
    assert np.mean(sure) > 0.5 and np.mean([p > 0.5 for p in sure]) >= 0.8


@pytest.mark.parametrize("name", ["rate", "wave", "bump"])
def test_one_cause(name):
    _, outcome, posterior = searched(hidden={name: 0.05})
    assert next(iter(posterior.causes)) == name
    assert (
        sureness(outcome, posterior) == pytest.approx(posterior.of(frozenset({name}))) and posterior.of(frozenset({name})) > 0.6
    )
    assert sum(posterior.closed.values()) + sum(posterior.open.values()) == pytest.approx(1.0)


def test_two_causes():
    _, _, posterior = searched(hidden={"rate": 0.2, "bump": 0.05})
    assert next(iter(posterior.causes)) == "bump + rate"


def test_two_causes_that_hide_each_other():
    """Each alone explains next to nothing: 0.1 of one against 0.1 of its near image leaves 0.1 of the small difference."""
    image = Planted(lambda: -WAVE + 0.3 * BUMP)
    effects = {"wave": EFFECTS["wave"], "image": image}
    _, _, posterior = searched(effects=effects, hidden={"wave": 0.3, "image": 0.3})
    assert posterior.of(frozenset({"wave", "image"})) > 0.5


def test_twins_share_the_probability():
    """These data cannot tell the two, so the odds are about one, and the verdict is as sure as both together."""
    effects = EFFECTS | {"twin": TWIN}
    _, outcome, posterior = searched(effects=effects, hidden={"rate": 0.05})
    first, second = (posterior.of(frozenset({name})) for name in ("rate", "twin"))
    assert outcome.verdict == "ambiguous" and 0.2 < first / second < 5.0
    assert sureness(outcome, posterior) == pytest.approx(first + second)


def test_two_forms_of_one_mechanism_count_as_one():
    """The verdict names the usual form, and is as sure as both are together."""
    effects = EFFECTS | {"twin": replace(TWIN, variant_of="rate")}
    _, outcome, posterior = searched(effects=effects, hidden={"rate": 0.05})
    assert (outcome.verdict, outcome.effects) == ("effect-found", ("rate",))
    together = frozenset({"rate", "twin"})
    forms = [frozenset({"rate"}), frozenset({"twin"}), together]
    assert sureness(outcome, posterior) == pytest.approx(sum(posterior.of(causes) for causes in forms))
    assert posterior.of(frozenset({"twin"})) > 0.1


def test_something_else():
    """A smooth curve that none of the effects makes: the discrepancy is what is left to believe."""
    unseen = {UNSEEN: Planted(lambda: np.cos(7.0 * D) * (D > 0.0))}
    system = elastic(np.random.default_rng(3), tests=4, effects=EFFECTS | unseen, hidden={UNSEEN: 0.3})
    known = Linear(system.series, system.X, EFFECTS)
    outcome = search(known, max_effects=1)
    posterior = posterior_of(evidence_of(outcome, known), count_of_testable(outcome))
    assert posterior.something_else > 0.9
    assert posterior.of(frozenset()) < 0.01


def test_no_case_is_certain():
    """However clear the data, the probability of what nobody thought of is left."""
    _, outcome, posterior = searched(hidden={"wave": 3.0})
    sure = sureness(outcome, posterior)
    assert sure is not None and 0.8 < sure <= 1.0 - THRESHOLDS.unforeseen_probability


def test_no_alarm_where_nothing_is_too_probable():
    """An outcome that names an effect falls where nothing is more probable than the threshold, and stands where it is less."""
    _, outcome, posterior = searched(hidden={"wave": 0.05})
    assert follow_posterior(outcome, posterior) is outcome
    doubtful = Posterior({frozenset(): 0.4, frozenset({"wave"}): 0.55}, {frozenset(): 0.05})
    quiet = follow_posterior(outcome, doubtful)
    assert (quiet.verdict, quiet.effects, quiet.remainder) == ("no-missing-effect", (), "at-floor")
    assert sureness(quiet, doubtful) == 0.4
    assert "Noise alone plausibly explains this residual." in said(quiet)
    slight = replace(quiet, no_consequence=("wave",))
    assert sureness(slight, doubtful) == pytest.approx(0.95)
