"""Tables in the terminal: directions have units, names of files are whole, and a busy machine is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command import command
from support import ROOT

from explicitfe.app.tools import speed
from explicitfe.app.view.terminal.rows import moved
from explicitfe.platform.host import load

SMALL = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=2"]


@pytest.mark.parametrize(
    ("forward_up_right", "words"),
    [
        ((4.27, 1.55, 0.0), "forward 4.27, up 1.55 mm"),
        ((-0.5, -2.0, 0.3), "back 0.50, down 2.00, right 0.30 mm"),
        ((1.0, 0.0, -1.0), "forward 1.00, up 0.00, left 1.00 mm"),
    ],
)
def test_every_direction_has_a_unit(forward_up_right: tuple[float, float, float], words: str) -> None:
    assert moved(*forward_up_right) == words


def test_a_body_that_is_no_tongue_moves_along_axes() -> None:
    assert moved(-7.99, -0.001, 0.43, anatomical=False) == "x 7.99, y 0.43, z 0.00 mm"


def test_names_of_files_stand_on_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Longer than a terminal is wide, they are not folded: a person copies them."""
    folder = tmp_path / ("a-long-name-of-a-folder-" * 8)
    folder.mkdir()
    scenario = folder / "vowel-i.toml"
    scenario.write_bytes((ROOT / "scenarios/vowel-i.toml").read_bytes())
    assert command(["run", str(scenario), "--out", str(folder), *SMALL]) == 0
    result = folder / "vowel-i.vtkhdf"
    assert f"result  {result}" in capsys.readouterr().out.splitlines()
    assert command(["inspect", str(result)]) == 0
    assert f"result  {result}" in capsys.readouterr().out.splitlines()
    assert command(["check", str(scenario), *SMALL]) == 0
    assert f"scenario  {scenario}" in capsys.readouterr().out.splitlines()


def test_a_summary_says_which_way_a_point_went(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["run", str(ROOT / "scenarios/vowel-i.toml"), "--out", str(tmp_path), "--json", *SMALL]) == 0
    tip = json.loads(capsys.readouterr().out)["probes"]["tip"]
    assert [-tip["forward_mm"], tip["right_mm"], tip["up_mm"]] == tip["displacement_mm"] != [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("processes", "told"), [(100.0, True), (0.0, False), (None, False)])
def test_times_of_a_busy_machine_are_not_taken_for_its_speed(
    processes: float | None, told: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spoken = {"name": "vowel-i", "hexes": 1200, "steps": 6540, "loop_s": 0.5, "real_time_factor": 0.4}
    report = {"lanes": 8, "cores": 2, "load": processes, "rows": [], "scenario": spoken}
    monkeypatch.setattr(speed, "bench", lambda *given: report)
    assert command(["bench"]) == 0
    assert ("the machine was busy: load average 100.0" in capsys.readouterr().err) == told
    assert load.is_busy(processes) == told


@pytest.mark.parametrize("what", ["effects", "scenarios", "muscles", "materials", "datasets"])
def test_a_list_can_be_read_in_80_columns(what: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """At most a few lines per entry, and no word is split: `list effects` had seven lines of twelve letters each."""
    monkeypatch.setenv("COLUMNS", "80")
    assert command(["list", what, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)[what]
    assert command(["list", what]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 8 * len(rows) + 6
    shown = {word for line in lines for word in line.replace("\u2502", " ").split()}
    names = [next(iter(row.values())) for row in rows]
    words = {word for row in rows for key in ("title", "needs") for word in str(row.get(key, "")).split() if word.isalpha()}
    assert words | set(names) <= shown
