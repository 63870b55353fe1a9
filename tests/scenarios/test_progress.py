"""Progress bars: every stage that the package reports has words, and one that has none does no harm."""

from __future__ import annotations

import ast
import io
from typing import get_args

from rich.console import Console
from support import ROOT

from explicitfe.errors import Stage
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


def test_words_are_shown():
    stream = io.StringIO()
    with following(Console(file=stream, force_terminal=True, width=100)) as progress:
        progress("run", 0.25)
        progress("run", 1.0)
    assert STAGES["run"] in stream.getvalue() and "100 %" in stream.getvalue()


def test_a_stage_without_words_is_shown_by_its_name():
    stream = io.StringIO()
    with following(Console(file=stream, force_terminal=True, width=100)) as progress:
        progress("weighing", 0.5)
    assert "weighing" in stream.getvalue()


def test_nothing_is_shown_before_there_is_something_to_show():
    stream = io.StringIO()
    with following(Console(file=stream, force_terminal=True, width=100)):
        pass
    assert stream.getvalue() == ""
