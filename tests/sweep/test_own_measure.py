"""Functions of the user's as measures of a sweep."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor

import own_measures
import pytest
from support import ROOT

import explicitfe
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
from explicitfe.simulate.sweep.definition import definition_of
from explicitfe.simulate.sweep.own_measure import OwnMeasure
from explicitfe.simulate.sweep.repeating import begun_sweep, commands_of

SCENARIO = ROOT / "scenarios" / "vowel-i.toml"
SMALL = ["model.cells=[8,4,4]", "analysis.duration_ms=4"]
FORCES = ["muscle.GGp.force_N=1,2"]


def rows(out, measures, **more):
    with ThreadPoolExecutor(1) as executor:
        return list(explicitfe.sweep(SCENARIO, FORCES, out=out, settings=SMALL, executor=executor, measures=measures, **more))


def test_its_numbers_are_columns_beside_the_built_in_ones(tmp_path):
    got = rows(tmp_path, ["points", own_measures.rise], keep="all")
    assert [row["status"] for row in got] == ["finished", "finished"]
    for row in got:
        with open_result(tmp_path / "results" / f"member-{row['member']:07d}.vtkhdf") as result:
            expected = own_measures.rise(result, -1)
        # a file holds displacements in single precision
        assert row["rise.most_mm"] == pytest.approx(expected["most_mm"], rel=1e-6)
        assert row["rise.moved"] is True and row["rise.nothing"] is None
        assert row["rise.nodes.count"] == expected["nodes"]["count"]
        assert "points.tip.up_mm" in row and "contact.palate.area_mm2" not in row
    assert got[0]["rise.most_mm"] != got[1]["rise.most_mm"]
    assert definition_of(tmp_path)["measures"] == ["points", "own_measures.rise"]


def test_the_page_says_what_a_command_cannot_repeat(tmp_path):
    sweep = explicitfe.sweep(SCENARIO, FORCES, out=tmp_path, settings=SMALL, measures=["points", own_measures.rise])
    commands = commands_of(tmp_path, begun_sweep(tmp_path), sweep.definition.members, None)
    assert commands[0].startswith("# without the custom measures own_measures.rise")
    assert f"--out {tmp_path}-again" in commands[1]  # in its own folder it would be another sweep
    assert "--measure points" in commands[1] and "own_measures" not in commands[1]


@pytest.mark.parametrize(
    ("measure", "says"),
    [
        (own_measures.broken, "measure own_measures.broken raised InputError: .*gap"),
        (own_measures.in_words, 'measure own_measures.in_words returned "said" as str'),
    ],
)
def test_one_that_fails_fails_its_members_and_is_named(tmp_path, measure, says):
    got = rows(tmp_path, [measure])
    assert {row["status"] for row in got} == {"failed"}
    assert all(re.search(says, row["message"]) for row in got)


def test_one_that_cannot_be_is_refused(tmp_path):
    with pytest.raises(InputError, match="the name points is used by another measure"):
        explicitfe.sweep(SCENARIO, FORCES, out=tmp_path, measures=["points", own_measures.points])
    with pytest.raises(InputError, match="workers cannot import"):
        explicitfe.sweep(SCENARIO, FORCES, out=tmp_path, measures=[lambda result, step: {}])
    assert not list(tmp_path.iterdir())


def test_a_changed_one_makes_another_sweep(tmp_path, monkeypatch):
    explicitfe.sweep(SCENARIO, FORCES, out=tmp_path, settings=SMALL, measures=[own_measures.rise])
    monkeypatch.setattr(OwnMeasure, "sha256", "changed")
    with pytest.raises(InputError, match="contains another sweep"):
        explicitfe.sweep(SCENARIO, FORCES, out=tmp_path, settings=SMALL, measures=[own_measures.rise])
