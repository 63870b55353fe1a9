"""Progress bars: every stage that the package reports has words, and one that has none does no harm."""

from __future__ import annotations

import ast
import io
from typing import get_args

from rich.console import Console
from support import ROOT

from explicitfe.errors import Stage
from explicitfe.view import progress as progress_bars
from explicitfe.view.progress import STAGES, following

REPORTS = ("progress", "_progress", "_enter", "_show")  # what a module calls with a stage


def reported_stages() -> set[str]:
    """Stages that stand in a call anywhere in the package."""
    stages = set()
    for path in sorted((ROOT / "explicitfe").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or not node.args:
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            first = node.args[0]
            if name in REPORTS and isinstance(first, ast.Constant) and isinstance(first.value, str):
                stages.add(first.value)
    return stages


def test_every_stage_has_words():
    assert reported_stages() == set(STAGES) == set(get_args(Stage))
    assert all(STAGES.values())


def screen(terminal: bool) -> tuple[io.StringIO, Console]:
    stream = io.StringIO()
    return stream, Console(file=stream, force_terminal=terminal, width=100)


def test_words_are_shown():
    stream, console = screen(terminal=True)
    with following(console, "reading a.toml") as progress:
        assert "reading a.toml" in stream.getvalue()  # at once
        progress("run", 0.25)
        progress("run", 1.0)
    last = stream.getvalue().rpartition("\x1b[2K")[2]
    assert STAGES["run"] in last and "100 %" in last.replace("100%", "100 %") and "reading" not in last


def test_a_stage_without_words_is_shown_by_its_name():
    stream, console = screen(terminal=True)
    with following(console, "reading a.toml") as progress:
        progress("weighing", 0.5)
    assert "weighing" in stream.getvalue()


def test_where_nothing_was_to_be_followed_nothing_is_left():
    """The spinner is wiped off the line that it stood on."""
    stream, console = screen(terminal=True)
    with following(console, "reading a.toml"):
        pass
    assert stream.getvalue().endswith("\x1b[1A\x1b[2K")


def test_a_log_gets_a_line_for_each_stage_and_then_how_long_it_takes(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress_bars.time, "monotonic", lambda: now[0])
    stream, console = screen(terminal=False)
    with following(console, "reading [a].toml") as progress:
        for second in range(0, 101):
            now[0] = float(second)
            progress("run", second / 100.0)
    said = stream.getvalue().splitlines()
    assert said[:3] == ["reading [a].toml", "running", "running: 11 %, 0:01:29 left"]
    assert len(said) == 2 + 9 and said[-1] == "running: 99 %, 0:00:01 left"
