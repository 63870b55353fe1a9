"""The loop from a linear system to a verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic import ROWS, UPWARD, Linear, Planted, elastic, programme, said

from explicitfe.close_loop import words
from explicitfe.close_loop.report import WHOLE_RANGE, WITHOUT_EFFECT, parameters, undetermined
from explicitfe.close_loop.search import Outcome, numerical_shares, search
from explicitfe.close_loop.selection import why_not_fitted
from explicitfe.close_loop.statistics.covariance import outside
from explicitfe.close_loop.statistics.fingerprints import Score
from explicitfe.close_loop.statistics.system import Scales, candidate
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.effects.effect import Sought
from explicitfe.errors import RunError
from explicitfe.results.loop_report import Estimate

TESTS = 4
D = programme(TESTS)
TEST = np.repeat(np.arange(float(TESTS)), ROWS) - 1.5
WAVE, BUMP = np.sin(2.0 * np.pi * D), np.exp(-(((D - 0.3) / 0.1) ** 2))
EFFECTS = {
    "rate": Planted(lambda: D * TEST),
    "wave": Planted(lambda: WAVE),
    "bump": Planted(lambda: BUMP, {"size": UPWARD}),
}
# d |TEST|^2-like: with the noise of 0.01 no one can tell it from "rate"
TWIN = Planted(lambda: D * TEST * (1.0 + 0.02 * D))


def outcome_of(seed: int = 1, effects=EFFECTS, max_effects: int = 3, single: bool = False, **more) -> Outcome:
    system = elastic(np.random.default_rng(seed), tests=more.pop("tests", TESTS), effects=effects, **more)
    return search(system, max_effects=max_effects, single=single)


def test_controls():
    """An alarm has p < 0.01: of 40 seeds with noise of the stated sd more than three would be one case in a thousand."""
    outcomes = [outcome_of(seed) for seed in range(40)]
    alarms = [c for c in outcomes if c.verdict != "no-missing-effect"]
    assert len(alarms) <= 3
    quiet = next(c for c in outcomes if c.verdict == "no-missing-effect")
    assert (quiet.remainder, quiet.effects, len(quiet.rounds)) == ("at-floor", (), 1)
    assert said(quiet).startswith("No missing effect is detected.") and words.where(quiet.rounds[0]) == ""


@pytest.mark.parametrize(("stated", "correlation"), [(True, 0.5), (False, 0.0), (False, 0.5)])
def test_controls_of_other_noise(stated, correlation):
    """The same where neighbouring rows go together or nothing is stated; what is estimated may alarm in three of a hundred:
    of 40 seeds more than five would then be one case in a hundred.
    """
    outcomes = [outcome_of(seed, stated=stated, correlation=correlation) for seed in range(40)]
    assert sum(c.verdict != "no-missing-effect" for c in outcomes) <= 5


@pytest.mark.parametrize("name", ["rate", "wave", "bump"])
def test_one_effect_is_found(name):
    """0.05 of it: |secant|^2 of more than 0.05^2 x 10 / 1e-4 = 250. Its strength comes back within four standard errors."""
    outcome = outcome_of(hidden={name: 0.05})
    assert (outcome.verdict, outcome.remainder, outcome.effects) == ("effect-found", "at-floor", (name,))
    last = outcome.rounds[-1]
    ((effect, values),) = last.fit.model.of_terms()
    error = np.sqrt(np.linalg.inv(last.fit.jacobian.T @ last.fit.jacobian)[-1, -1])
    assert effect == name and values["size"] == pytest.approx(0.05, abs=4.0 * error)
    assert said(outcome) == f"The model lacks {name}. The residual is within the noise and the numerical error."
    (first, second) = outcome.rounds
    assert first.chosen == name and second.chosen is None and first.fit.chi2 - second.fit.chi2 > 100.0


def test_two_effects_are_found_one_after_the_other():
    """The one that explains more comes first."""
    outcome = outcome_of(hidden={"rate": 0.2, "bump": 0.05})
    assert (outcome.verdict, outcome.remainder, outcome.effects) == ("effect-found", "at-floor", ("rate", "bump"))
    assert [one.chosen for one in outcome.rounds] == ["rate", "bump", None]


def test_what_is_left_of_two_when_one_may_be_added():
    outcome = outcome_of(hidden={"rate": 0.2, "bump": 0.02}, max_effects=1)
    assert (outcome.verdict, outcome.effects, outcome.remainder) == ("effect-found", ("rate",), "unexplained")
    assert words.where(outcome.rounds[-1]) != ""


def test_two_that_cannot_be_told_apart():
    """y_A - y_B of 0.05 strength is 0.05 x 0.02 x d^2 t less what a change of strength takes up: |.|^2 below
    (1e-3)^2 x 160 x 0.2 x 1.25 / 1e-4 = 0.4, and 25 are needed.
    """
    outcome = outcome_of(effects={**EFFECTS, "twin": TWIN}, hidden={"rate": 0.05})
    first = outcome.rounds[0]
    assert outcome.verdict == "ambiguous" and first.chosen is None
    assert {first.best, *first.ambiguous_with} == {"rate", "twin"}
    ((_, _, apart),) = [row for row in first.separations if set(row[:2]) == {"rate", "twin"}]
    assert apart < 0.5
    both = ("rate or twin", "twin or rate")
    assert said(outcome) in [f"Ambiguous cause: {rivals}. These data do not distinguish the causes." for rivals in both]


@pytest.mark.parametrize("usual", ["rate", "twin"])
def test_two_forms_of_one_mechanism_are_no_rivals(usual):
    """Of two that cannot be told apart the usual form is taken, whichever fits better by chance."""
    other = {"rate": "twin", "twin": "rate"}[usual]
    effects = {**EFFECTS, "twin": TWIN}
    effects[other] = replace(effects[other], variant_of=usual)
    outcome = outcome_of(effects=effects, hidden={"rate": 0.05})
    assert (outcome.verdict, outcome.effects) == ("effect-found", (usual,))
    assert outcome.rounds[0].ambiguous_with == ()


def test_a_separation_is_the_least_misfit_of_the_rival():
    """min over the rival's parameters of |y_A - y_B|^2 / sd^2 is |(1 - P) y_A|^2, P on the baseline and the rival."""
    near = Planted(lambda: D * TEST + 0.25 * WAVE)
    outcome = outcome_of(effects={"rate": EFFECTS["rate"], "near": near}, hidden={"rate": 0.05})
    first = outcome.rounds[0]
    (row,) = first.separations
    rival = np.column_stack([D, D**3, near.column()])
    best = first.refits["rate"]
    left = best.answer - rival @ np.linalg.lstsq(rival, best.answer, rcond=None)[0]
    wanted = float(left @ left) / 0.01**2
    assert first.best == "rate"
    # the search ends where a step gains less than 0.02 and 1e-5 of it; rows are stated white, their correlation is estimated
    sure = first.covariance.rows[0].correlation
    if sure == 0.0:
        assert row[2] == pytest.approx(wanted, abs=0.05, rel=1e-3)
    white = first.covariance.whiten(np.column_stack([best.answer, rival]))
    left = white[:, 0] - white[:, 1:] @ np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]
    assert row[2] == pytest.approx(float(left @ left), abs=0.05, rel=1e-3)
    assert (first.chosen is None) == (row[2] < THRESHOLDS.told_apart_separation)


def test_what_is_significant_and_not_added_has_its_reason():
    """No step is left out without a word: the most effects, noise, another that explains more, or one that is too like it."""
    both = {"rate": 0.2, "bump": 0.02}
    outcomes = {
        "--max-effects": outcome_of(hidden=both, max_effects=1).rounds[-1],
        "not distinguishable": outcome_of(effects={**EFFECTS, "twin": TWIN}, hidden={"rate": 0.05}).rounds[0],
        ", with wave ": outcome_of(hidden={"wave": 0.5, "bump": 0.02}).rounds[0],
    }
    for words_of_reason, one in outcomes.items():
        significant = {s.candidate.effect for s in one.scores if s.status == "significant"}
        assert significant and set(one.why_not) | ({one.chosen} if one.chosen else set()) == significant
        assert any(words_of_reason in why for why in one.why_not.values()), (words_of_reason, one.why_not)


def test_an_effect_that_left_out_tests_speak_against_is_not_added():
    """A wave in the last of four tests alone. What explains it has the opposite wave in the first, so that either of these tests
    foretells the other wrongly.
    """
    first, last = np.where(TEST < -1.0, WAVE, 0.0), np.where(TEST > 1.0, WAVE, 0.0)
    one = outcome_of(effects={"odd": Planted(lambda: last - first)}, extra=0.3 * last).rounds[0]
    assert [s.status for s in one.scores] == ["significant"]
    assert one.best is None and "cross-validated error" in one.why_not["odd"]


def test_a_strength_whose_interval_includes_none_is_not_determined():
    """A bump of 0.05 is known to a tenth of itself; with an interval down to its bound 0 it is not."""
    outcome = outcome_of(hidden={"bump": 0.05})
    last = outcome.rounds[-1]
    reported = parameters(last.fit, last)
    assert isinstance(reported["bump.size"], Estimate)
    assert undetermined(last.fit, reported) == {}
    reported["bump.size"].ci95 = [0.0, 0.2]
    assert undetermined(last.fit, reported) == {"bump.size": WITHOUT_EFFECT}
    assert "The model lacks bump. The strength of bump is not determined. The residual" in said(outcome, ["bump"])


def test_a_shape_that_may_be_anything_is_not_determined():
    """The width of a hump, with an interval from one end of its range to the other."""
    sought = {"size": UPWARD, "width": Sought((0.1, 0.3), 0.01, 1.0, kind="log")}
    hump = Planted(lambda width=0.1: np.exp(-(((D - 0.3) / width) ** 2)), sought)
    last = outcome_of(effects={"hump": hump}, hidden={"hump": 0.05}).rounds[-1]
    reported = parameters(last.fit, last)
    assert isinstance(reported["hump.width"], Estimate) and undetermined(last.fit, reported) == {}
    reported["hump.width"].ci95 = [0.01, 1.0]
    assert undetermined(last.fit, reported) == {"hump.width": WHOLE_RANGE}


def test_what_none_of_them_explains():
    """A corner and a steep end, of ten times the noise, which no candidate has."""
    outcome = outcome_of(extra=0.1 * np.abs(D - 0.6) - 0.3 * D**6)
    assert (outcome.verdict, outcome.effects) == ("unexplained", ())
    assert "An effect is missing that no candidate explains." in said(outcome)


def test_a_candidate_that_helps_a_little_is_not_what_is_missing():
    """Waves of 0.5, of which "bump" takes up some, significantly, and leaves more than half."""
    outcome = outcome_of(effects={"bump": EFFECTS["bump"]}, extra=0.5 * np.sin(9.0 * D) + 0.05 * BUMP)
    assert (outcome.verdict, outcome.effects) == ("unexplained", ())
    assert "An effect is missing that no candidate explains." in said(outcome)


def test_what_leaves_most_of_the_misfit_is_no_answer_though_two_effects_share_it():
    """Two effects that nobody can tell apart, worth 100 of chi2, beside a wave that is worth 0.03^2 / 2 / 1e-4 = 4.5 a row."""
    effects = {"rate": EFFECTS["rate"], "twin": TWIN}
    outcome = outcome_of(hidden={"rate": 0.012}, effects=effects, extra=0.03 * np.cos(3.0 * np.pi * D))
    assert outcome.rounds[0].ambiguous_with
    assert (outcome.verdict, set(outcome.nearest), outcome.effects) == ("unexplained", {"rate", "twin"}, ())


def test_a_single_test_is_ambiguous_at_most():
    effects = {"wave": Planted(lambda: WAVE[:ROWS])}
    outcome = outcome_of(tests=1, effects=effects, hidden={"wave": 0.1}, single=True)
    assert (outcome.verdict, outcome.effects) == ("ambiguous", ("wave",))
    assert said(outcome, tests=1) == "Possible cause: wave. One test alone cannot confirm a cause."
    assert outcome_of(tests=1, effects=effects, single=True).verdict in ("no-missing-effect", "ambiguous")


def test_a_search_that_gives_up_is_a_failure():
    """Everything above x0 = 0.5 cannot be computed, while the data want 2: nothing is said about what is missing."""
    outcome = outcome_of(hidden={"rate": 0.2}, fails=lambda model: model.x[0] > 0.5)
    assert outcome.verdict == "failed" and outcome.effects == ()
    assert "A failed fit does not show what the model lacks." in said(outcome)


def test_a_baseline_that_cannot_be_computed_is_an_error():
    with pytest.raises(RunError):
        outcome_of(fails=lambda model: True)


def test_a_constant_at_its_bound_is_no_effect():
    """The data are softer at the end than the bound allows. An effect that only stiffens would do, were the constant free to
    follow it down: nothing is found, and nothing is "at the floor".
    """
    effects = {"stiffer": Planted(lambda: D**5, {"size": UPWARD})}
    outcome = outcome_of(effects=effects, extra=-2.0 * D**3 + 0.5 * D**5, bounds=[(-1e6, 1e6), (0.0, 1e6)])
    assert (outcome.verdict, outcome.effects, outcome.remainder) == ("unexplained", (), "unexplained")


def test_numerics_are_a_floor():
    """A mesh that changes the answer by what is there, wave 0.05: then that may be the mesh. Half the noise is its share
    beyond the constants, by rows: |(1 - P) 0.05 wave| / sd / sqrt(n), whitened.
    """
    outcome = outcome_of(hidden={"wave": 0.05}, checked={"a finer mesh": 0.05 * WAVE})
    assert outcome.verdict == "limited-by-numerics"
    first = outcome.rounds[0]
    share = numerical_shares(first.covariance, first.fit, ["a finer mesh"])["a finer mesh"]
    rows = first.covariance.by_rows(np.column_stack([0.05 * WAVE, D, D**3]))
    left = rows[:, 0] - rows[:, 1:] @ np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0]
    assert share == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-3) and share > 0.5


def test_against_a_gross_misfit_an_effect_must_bring_more_than_numerics_change():
    """Something that no candidate knows leaves 4 noises of 0.01 a row, so that chi2 is one of rows alone. A wave D of 0.03
    explains 0.03^2 / 2 / 1e-4 = 4.5 a row. Numerics d that change 0.02 along it may change that by 2 d D = 6 a row; those that
    change 0.05 across it, although they are worth more, by next to nothing.
    """
    unknown, across = 0.06 * np.cos(9.0 * np.pi * D), np.cos(11.0 * np.pi * D)
    checks = {"": {}, "along": {"mesh": 0.02 * (WAVE + across)}, "across": {"mesh": 0.05 * across}}
    rounds = {name: outcome_of(hidden={"wave": 0.03}, extra=unknown, checked=c).rounds[0] for name, c in checks.items()}
    assert all(one.fit.by_rows is not None for one in rounds.values())
    assert {name: one.chosen for name, one in rounds.items()} == {"": "wave", "along": None, "across": "wave"}


def test_what_is_assumed_is_a_floor():
    assert outcome_of(hidden={"wave": 0.05}, assumed={"height_mm": 0.05 * WAVE}).verdict == "no-missing-effect"


def test_scatter_between_tests_is_no_rate():
    """Tests that differ by 3 % in size with 5 % stated, with a candidate that is such a difference."""
    system = elastic(np.random.default_rng(3), tests=TESTS, effects=EFFECTS, extra=0.03 * TEST * (2.0 * D + D**3))
    unstated = search(system, max_effects=3)
    system.series = [replace(one, scatter=0.05) for one in system.series]
    assert search(system, max_effects=3).verdict == "no-missing-effect"
    assert unstated.verdict != "no-missing-effect"


def test_what_is_significant_may_be_of_no_consequence():
    """A bump of 0.02 in one test of four lowers chi2 by 15 for two parameters, so p < 0.01, and foretells no other test; one of
    0.008 in all of them does.
    """
    seed, effects = 7, {name: EFFECTS[name] for name in ("bump", "wave")}
    once, always = (np.repeat(sizes, ROWS) * BUMP for sizes in ([0.02, 0.0, 0.0, 0.0], [0.008] * TESTS))
    slight, real = (outcome_of(seed, effects=effects, extra=extra) for extra in (once, always))
    assert (slight.verdict, slight.remainder, slight.no_consequence) == ("no-missing-effect", "at-floor", ("bump",))
    assert not slight.rounds[0].at_floor and slight.rounds[0].scores[0].status == "significant"
    assert "statistically significant, but" in slight.rounds[0].why_not["bump"]
    assert "does not improve the prediction of held-out tests" in said(slight)
    assert real.verdict != "no-missing-effect" and real.rounds[0].best == "bump" and real.no_consequence == ()


def test_no_model_makes_scatter_as_large_as_it_likes():
    """Tests that drift by 5 % each, a scatter of 0.6 % and an assumed length that is worth 20 %. With constants of twice the size
    the scatter would be worth twice as much, and the assumed length would take the rest.
    """
    force = 2.0 * D + D**3
    drift = 0.05 * TEST * force
    system = elastic(np.random.default_rng(4), tests=TESTS, sd=0.05, extra=drift, assumed={"radius_mm": 0.2 * force})
    system.series = [replace(one, scatter=0.006) for one in system.series]
    top = system.rows(search(system, max_effects=0).rounds[0].fit.model).max()
    assert top == pytest.approx(3.0, rel=0.15)


def test_two_tests_do_not_veto_what_explains_all():
    """An effect that makes one of two tests stiffer than the other, by a share that depends on a time. What is left when one of
    them is left out fits any strength and any time, so its prediction of the other says nothing, and the effect is found.
    """
    place = np.repeat([0.2, 1.0], ROWS)
    d = programme(2)
    shape = {"size": UPWARD, "tau": Sought((0.3, 1.0, 3.0), 0.1, 10.0, kind="log")}
    effects = {"shape": Planted(lambda tau: (d + 0.1 * d**2) * np.exp(-place / tau), shape)}
    extra = 0.1 * effects["shape"].column(0.7)
    systems = [elastic(np.random.default_rng(seed), tests=2, effects=effects, extra=extra) for seed in range(20)]
    assert [search(system, max_effects=1).effects for system in systems] == [("shape",)] * 20


def test_the_same_twice():
    """The bootstrap has a seed."""
    one, other = outcome_of(hidden={"rate": 0.05}), outcome_of(hidden={"rate": 0.05})
    assert [s.p for s in one.rounds] == [s.p for s in other.rounds]
    assert [c.p_holm for c in one.rounds[0].scores] == [c.p_holm for c in other.rounds[0].scores]
    np.testing.assert_array_equal(one.rounds[-1].fit.model.x, other.rounds[-1].fit.model.x)


def test_nothing_is_tried_where_nothing_may_be_added():
    """--max-effects 0 traces the residual and adds nothing."""
    outcome = outcome_of(hidden={"rate": 0.2}, max_effects=0)
    assert outcome.verdict == "unexplained" and len(outcome.rounds) == 1 and outcome.rounds[0].refits == {}


def test_the_system_is_what_it_says():
    """The fake itself: an answer of the baseline and an effect, by series."""
    system = elastic(np.random.default_rng(1), tests=TESTS, effects=EFFECTS)
    assert isinstance(system, Linear)
    model = system.start().at(np.array([2.0, 1.0])).plus(system.candidates(system.start())[0].term, (0.5,))
    (answer,) = system.answers([model])
    np.testing.assert_allclose(np.concatenate(answer), 2.0 * D + D**3 + 0.5 * D * TEST, atol=1e-12)
    assert [len(part) for part in answer] == [ROWS] * TESTS


def test_what_numerics_may_explain_is_said_to_be_limited_by_them():
    """A misfit of the shape of a numerical error, as large as the noise of a row: neither something is missing nor nothing.
    Where the same error is a tenth of that, nothing is.
    """
    wrong = 0.02 * WAVE
    limited = outcome_of(effects={}, extra=wrong, checked={"the mesh": wrong})
    assert (limited.verdict, limited.effects) == ("limited-by-numerics", ())
    assert "too large to decide whether an effect is missing" in said(limited)
    quiet = outcome_of(effects={}, extra=0.1 * wrong, checked={"the mesh": 0.1 * wrong})
    assert quiet.verdict == "no-missing-effect"


def test_an_error_below_its_floor_is_nothing_missing():
    """Numerics that may do more elsewhere make the floor of each curve larger than its error, though it is significant."""
    outcome = outcome_of(effects={}, extra=0.02 * WAVE, checked={"the mesh": 0.2 * BUMP})
    assert outcome.rounds[0].p < THRESHOLDS.significance_p and outcome.verdict == "limited-by-numerics"


def test_what_an_assumed_length_imitates_may_still_be_what_explains_a_gross_misfit():
    """A wave of 0.6, sixty noises, and an assumed length that is worth 0.05 of it, so that it would be wrong by twelve standard
    deviations. Whitened by Sigma the wave's trial gains less than that of a bump, which is in the data to a tenth of it.
    """
    effects = {name: EFFECTS[name] for name in ("wave", "bump")}
    truth = {"hidden": {"wave": 0.6}, "extra": 0.06 * BUMP}
    first = outcome_of(effects=effects, assumed={"height_mm": 0.05 * WAVE}, **truth).rounds[0]
    scores = {s.candidate.effect: s for s in first.scores}
    assert first.fit.by_rows is not None
    assert scores["bump"].drop > scores["wave"].drop and scores["wave"].promise > scores["bump"].promise
    assert first.chosen == "wave"


def test_data_may_exclude_a_rival_that_they_would_rarely_tell_apart():
    """Two waves that differ by d with |d|^2 = 9: as a rule such data do not tell them apart. Noise that lies along d by half of
    it makes chi2 of the rival (1.5^2 - 0.5^2) 9 = 18 worse than that of the wave, which leaves nothing. Other noise has no part
    in what the models can do.
    """
    effects = {"wave": Planted(lambda: WAVE), "twin": Planted(lambda: WAVE + 0.1 * BUMP)}
    system = elastic(np.random.default_rng(1), tests=TESTS, effects=effects)
    columns = np.column_stack([D, D**3, WAVE + 0.1 * BUMP, WAVE])
    d = outside(columns[:, :3], columns[:, 3])
    size = 0.03 / np.linalg.norm(d)
    noise = outside(columns, 0.01 * np.random.default_rng(2).standard_normal(len(D)))
    wave = system.X @ [2.0, 1.0] + size * WAVE + noise
    usual, lucky = (search(system.measuring(wave + push * size * d), max_effects=1).rounds[0] for push in (0.0, 0.5))
    assert usual.separations[0][2] == pytest.approx(9.0, rel=0.02) and usual.ambiguous_with == ("twin",)
    assert lucky.chosen == "wave" and lucky.ambiguous_with == ()


def test_why_a_candidate_was_not_fitted():
    """One that is far from the best; another form of one that was fitted and leaves nothing."""
    other = replace(candidate("power-law", 1, {"size": UPWARD}, Scales()), variant_of="wave")
    wave, far = (candidate(name, 1, {"size": UPWARD}, Scales()) for name in ("wave", "far"))
    best, twin, hopeless = (
        Score(one, "significant", 1.0, 0.0, 0.0, (1.0,), "", promise=promise)
        for one, promise in ((wave, 100.0), (other, 101.0), (far, 5.0))
    )
    assert why_not_fitted(twin, [best]) == "not fitted: wave, the usual form of this mechanism, leaves no residual to explain"
    assert "reduces chi2 by 5, that of wave by 100" in why_not_fitted(hopeless, [best])
