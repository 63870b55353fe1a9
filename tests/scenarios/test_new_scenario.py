"""``explicitfe new scenario`` writes a scenario that can be run at once, and never over anything."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import pytest
from answers import check_answer
from command import command
from support import ROOT

from explicitfe.app.cli import asking
from explicitfe.simulate.scenario.read import read_scenario
from explicitfe.simulate.scenario.transient import TransientScenario


def test_muscles_pull_as_they_were_asked_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--muscle", "STY=1", "--muscle", "GGp=0.5", "--title", 'Up "and" back', "--duration-ms", "120", "--json"]
    assert command(["new", "scenario", str(tmp_path / "raise"), *words]) == 0
    answer = check_answer("new-scenario", capsys.readouterr().out)
    assert answer["scenario"] == str(tmp_path / "raise.toml")
    scenario, _ = read_scenario(tmp_path / "raise.toml")
    assert isinstance(scenario, TransientScenario)
    assert {muscle.name: muscle.force_N for muscle in scenario.muscle} == {"STY": 1.0, "GGp": 0.5}
    assert (scenario.title, scenario.analysis.duration_ms) == ('Up "and" back', 120.0)


@pytest.mark.parametrize("like", ["vowel-i", "indentation-rear"])
def test_a_copy_says_nothing_of_the_result_of_another_scenario(like: str, tmp_path: Path) -> None:
    assert command(["new", "scenario", str(tmp_path / "mine.toml"), "--like", like]) == 0
    scenario, text = read_scenario(tmp_path / "mine.toml")
    original, _ = read_scenario(ROOT / "scenarios" / f"{like}.toml")
    assert (scenario.title, scenario.question, scenario.expect) == ("mine", "", "")
    assert "#:schema" not in text
    assert (scenario.model, scenario.analysis) == (original.model, original.analysis)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["new.toml"], "--muscle is missing"),
        (["new.toml", "--muscle", "GGq=1"], 'did you mean "GGp"?'),
        (["new.toml", "--muscle", "GGp"], "write NAME=FORCE"),
        (["new.toml", "--muscle", "GGp=-1"], "muscle.GGp.force_N = -1"),
        (["new.toml", "--muscle", "GGp=1", "--duration-ms", "0"], "analysis.duration_ms"),
        (["new.json", "--muscle", "GGp=1"], 'let its name end in ".toml"'),
        (["new.toml", "--like", "vowel-y"], "did you mean"),
        (["new.toml", "--like", "vowel-i", "--muscle", "GGp=1"], "exclude each other"),
        (["there.toml", "--muscle", "GGp=1"], "this exists already"),
    ],
)
def test_nothing_is_written_where_something_is_wrong(
    words: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("mine", encoding="utf-8")
    assert command(["new", "scenario", *words]) == 2
    error = capsys.readouterr().err
    assert sentence in error and ".part" not in error
    assert [path.name for path in tmp_path.iterdir()] == ["there.toml"]
    assert (tmp_path / "there.toml").read_text(encoding="utf-8") == "mine"


def test_a_person_is_shown_the_muscles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(asking, "somebody_is_there", lambda: True)
    monkeypatch.setattr(sys, "stdin", io.StringIO("GGx=1\nGGp=2, GGa=0.2\n\n"))
    assert command(["new", "scenario", "mine"]) == 0
    assert "Genioglossus, posterior" in (error := capsys.readouterr().err) and 'no muscle "GGx"' in error
    assert read_scenario("mine.toml")[0].title == "mine"
