"""Which members a sweep has: factors are read from text, and designs put them together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from explicitfe.platform.errors import InputError
from explicitfe.simulate.scenario.read import read_scenario
from explicitfe.simulate.sweep import members
from explicitfe.simulate.sweep.factors import Factor, factor_of, factors_of

FORCE, OTHER = "muscle.GGp.force_N", "muscle.GGa.force_N"


def test_values_of_a_factor():
    assert factor_of(f"{FORCE}=0:4:9").levels == tuple(np.linspace(0.0, 4.0, 9))
    assert factor_of(f"{FORCE}=0.1:0.3:3").levels[-1] == 0.3
    assert factor_of(f"{FORCE}=-1:2.5") == Factor(FORCE, low=-1.0, high=2.5)
    assert factor_of("model.material=gerard-2005,buchaillard-2009").levels == ("gerard-2005", "buchaillard-2009")
    assert factor_of('model.material="a,b",c').levels == ("a,b", "c")
    assert factor_of("model.cells=[8,4,4],[10,6,6]").levels == ([8, 4, 4], [10, 6, 6])
    assert factor_of("model.barrier=true,false").levels == (True, False)
    assert factor_of("model.damping={alpha_per_s=40.0},{alpha_per_s=10.0}").levels == (
        {"alpha_per_s": 40.0},
        {"alpha_per_s": 10.0},
    )


def test_factors_of_a_dictionary():
    """Arrays and lists mean the same as their texts."""
    given = {FORCE: np.linspace(0.0, 4.0, 9), "model.resolution": ["coarse", "medium"], "model.cells": [[8, 4, 4], (10, 6, 6)]}
    assert factors_of(given) == factors_of([f"{FORCE}=0:4:9", "model.resolution=coarse,medium", "model.cells=[8,4,4],[10,6,6]"])
    for levels in ("1,2", 1.0):
        with pytest.raises(InputError, match=f"`vary` {FORCE}: give a list or an array of values"):
            factors_of({FORCE: levels})


def test_words_and_numbers_of_other_programs():
    assert factor_of(f"{FORCE}=.5,1.,1E3").levels == (0.5, 1.0, 1000.0)
    assert factor_of("model.resolution=coarse,2020-01-02").levels == ("coarse", "2020-01-02")  # no key is a date


@pytest.mark.parametrize("text", ['muscle.GGp.force_N\n"1\n' + "2\n" * 100_000, "muscle.GGp.force_N\r1\r2\r", f"{FORCE}\nnan\n"])
def test_a_table_that_csv_cannot_be(text):
    with pytest.raises(InputError, match=r"^t.csv: (invalid CSV|line 2: nan is not finite)"):
        members.members_in(text, Path("t.csv"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("muscle.GGp.force_N", "Write KEY=LOW:HIGH:N"),
        ("muscle..force_N=1,2", "Write KEY=LOW:HIGH:N"),
        (f"{FORCE}=4:0:9", "the range is empty"),
        (f"{FORCE}=2:2", "the range is empty"),
        (f"{FORCE}=0:inf", "limits of a range must be finite"),
        (f"{FORCE}=0:nan:3", "limits of a range must be finite"),
        (f"{FORCE}=0:4:1", "no valid number of values"),
        (f"{FORCE}=0:4:x", "no valid number of values"),
        (f"{FORCE}=0:4:99999999999999", "no valid number of values"),
        (f"{FORCE}=", "a value is missing"),
        (f"{FORCE}=1,,2", "a value is missing"),
        (f"{FORCE}=1,2,1", "a value is given twice"),
        (f"{FORCE}=1,nan", "Use finite numbers"),
    ],
)
def test_what_is_no_factor(text, words):
    with pytest.raises(InputError, match=words):
        factor_of(text)


def test_a_key_is_varied_once():
    with pytest.raises(InputError, match="varied 2 times"):
        factors_of([f"{FORCE}=1,2", f"{FORCE}=0:1"])


def test_a_grid_has_every_combination():
    chosen = members.grid(factors_of([f"{FORCE}=1,2,3", "model.resolution=coarse,medium"]))
    assert len(chosen) == 6
    assert chosen.values[1] == (1, "medium")
    assert chosen.settings(1) == (f"{FORCE}=1", 'model.resolution="medium"')
    with pytest.raises(InputError, match="needs a number of values"):
        members.grid(factors_of([f"{FORCE}=0:1"]))
    with pytest.raises(InputError, match="1 to 10000000"):
        members.grid(factors_of([f"{key}=0:1:1000" for key in "abc"]))


def test_a_setting_means_the_same_in_a_scenario(tmp_path: Path):
    values = {"model.cells": [8, 4, 4], "analysis.duration_ms": 0.1 + 0.2, "title": 'quote " and \\'}
    chosen = members.Members(tuple(values), [tuple(values.values())])
    scenario, _ = read_scenario(Path("scenarios/vowel-i.toml").resolve(), chosen.settings(0))
    assert scenario.analysis.duration_ms == 0.1 + 0.2
    assert (scenario.model.cells, scenario.title) == ((8, 4, 4), 'quote " and \\')
    path = tmp_path / "members.csv"
    path.write_text(chosen.table(), encoding="utf-8")
    assert members.from_table(path).settings(0) == chosen.settings(0)


def test_random_members_depend_on_the_seed_and_their_number():
    factors = factors_of([f"{FORCE}=0:2", f"{OTHER}=0,1"])
    few, many = members.random(factors, 5, seed=3), members.random(factors, 400, seed=3)
    assert many.values[:5] == few.values
    assert members.random(factors, 5, seed=4).values != few.values
    forces = np.array([force for force, _ in many.values])
    # the mean of 400 numbers even over 2 scatters by 2 / sqrt(12 * 400) = 0.029; four times that
    assert forces.min() >= 0.0 and forces.max() < 2.0 and abs(forces.mean() - 1.0) < 0.115
    assert {other for _, other in many.values} == {0, 1}


def test_designs_for_a_sensitivity_analysis():
    factors = factors_of([f"{FORCE}=0:2", f"{OTHER}=1:3", "model.damping.alpha_per_s=10:40"])
    assert len(members.sobol(factors, 8, seed=1)) == 8 * 5
    assert len(members.morris(factors, 6, seed=1)) == 6 * 4
    for chosen in (members.sobol(factors, 8, seed=1), members.morris(factors, 6, seed=1)):
        values = np.array(chosen.values)
        assert (values >= [0.0, 1.0, 10.0]).all() and (values <= [2.0, 3.0, 40.0]).all()
    # a trajectory of Morris changes one factor at a time
    steps = np.diff(np.array(members.morris(factors, 6, seed=1).values).reshape(6, 4, 3), axis=1)
    assert (np.count_nonzero(steps, axis=2) == 1).all()
    for wrong in (0, 3, 12):
        with pytest.raises(InputError, match="power of 2"):
            members.sobol(factors, wrong, seed=1)
    with pytest.raises(InputError, match="smallest number of trajectories is 2"):
        members.morris(factors, 1, seed=1)
    with pytest.raises(InputError, match="needs a range"):
        members.morris(factors_of([f"{FORCE}=1,2"]), 4, seed=1)
    with pytest.raises(InputError, match="`seed` -1"):
        members.random(factors, 2, seed=-1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the table has no columns"),
        ("member\n1\n", "the table has no columns"),
        (f"{FORCE},{FORCE}\n1,2\n", "names each key once"),
        (f"{FORCE},\n1,2\n", "no key of a scenario"),
        (f"{FORCE},{OTHER}\n1\n", "line 2 must have one value"),
        (f"{FORCE}\n1\n\n \n", "line 4 must have one value"),
        (f"{FORCE}\n", "the table has no rows"),
    ],
)
def test_a_table_that_is_none(tmp_path, text, words):
    path = tmp_path / "members.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        members.from_table(path)


def test_shares_together_are_all():
    chosen = members.grid(factors_of([f"{FORCE}=0:1:10"]))
    shares = [members.share_of(chosen, f"{k}/4") for k in (1, 2, 3, 4)]
    assert sorted(number for share in shares for number in share) == list(range(10))
    for wrong in ("0/4", "5/4", "1", "1/0", "a/b", "-1/4"):
        with pytest.raises(InputError, match="Write K/N"):
            members.share_of(chosen, wrong)
