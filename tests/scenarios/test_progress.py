"""Progress bars: every stage that the package reports has words, and one that has none does no harm."""

from __future__ import annotations

import ast
import io
from typing import get_args

import pytest
from rich.console import Console
from support import ROOT

from explicitfe.app.view import progress as progress_bars
from explicitfe.app.view.progress import STAGES, following
from explicitfe.platform.errors import Share, Stage, counted
from explicitfe.platform.host.compilation import announce

REPORTS = ("progress", "_progress", "enter", "_show")  # what a module calls with a stage


def reported_stages() -> set[str]:
    """Stages that stand in a call anywhere in the package."""
    stages = set()
    for path in [*sorted((ROOT / "explicitfe").rglob("*.py")), *sorted((ROOT / "studies").rglob("*.py"))]:
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


def lines_of_a_log(monkeypatch, stage: str, words: str = "") -> list[str]:
    """What a log says of a stage that takes 100 s."""
    now = [0.0]
    monkeypatch.setattr(progress_bars.time, "monotonic", lambda: now[0])
    stream, console = screen(terminal=False)
    with following(console, "reading [a].toml") as progress:
        for second in range(0, 101):
            now[0] = float(second)
            progress(stage, Share(second / 100.0, words) if words else second / 100.0)
    return stream.getvalue().splitlines()


def test_a_log_gets_a_line_for_each_stage_and_then_the_remaining_time(monkeypatch):
    said = lines_of_a_log(monkeypatch, "run")
    assert said[:3] == ["reading [a].toml", "running", "running: 11 %, 0:01:29 remaining"]
    assert len(said) == 2 + 9 and said[-1] == "running: 99 %, 0:00:01 remaining"


def test_parts_of_different_length_are_counted_without_an_estimate(monkeypatch):
    """Estimates of such stages grew: 23 s, 69 s, 160 s."""
    said = lines_of_a_log(monkeypatch, "trace", "effect 12 of 24")
    assert said[1:3] == ["tracing the residual: effect 12 of 24", "tracing the residual: effect 12 of 24, 11 %"]
    assert "remaining" not in "".join(said)


def test_a_terminal_shows_an_estimate_only_where_it_holds():
    for stage, estimates in (("run", True), ("trace", False), ("load-step", False), ("identify", False)):
        stream, console = screen(terminal=True)
        with following(console, "reading a.toml") as progress:
            progress(stage, 0.0)
            progress(stage, 0.5)
        assert ("remaining" in stream.getvalue()) == estimates, stage


def test_counted_parts():
    shares = [counted(done, 3, "effect") for done in range(4)]
    assert shares == [0.0, 1 / 3, 2 / 3, 1.0]
    assert [share.words for share in shares] == ["effect 1 of 3", "effect 2 of 3", "effect 3 of 3", "effect 3 of 3"]


@pytest.mark.parametrize("terminal", [True, False])
def test_a_compilation_is_shown_once_with_the_kernels_and_the_reason(terminal):
    stream, console = screen(terminal)
    with following(console, "reading a.toml"):
        announce("tongue models")
        announce("tongue models")
        announce("specimen models")
    shown = " ".join(stream.getvalue().split())
    assert shown.count("Compiling kernels for tongue models (JIT; cached for later runs; `explicitfe warmup`") == 1
    assert shown.count("Compiling kernels for specimen models") == 1
    announce("nothing, as the command has ended")
    assert "nothing" not in stream.getvalue()
