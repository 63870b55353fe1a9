"""Arguments and options of commands are made of signatures and docstrings."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import typer
from support import ROOT

from explicitfe.app.cli.app import app
from explicitfe.app.cli.command import command as command_of
from explicitfe.platform.host.shipped import MARKER_SUFFIXES, TABLE_SUFFIXES


def commands(group: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    for word, inner in group.commands.items():
        full = f"{name} {word}".strip()
        yield from commands(inner, full) if hasattr(inner, "commands") else [(full, inner)]


COMMANDS = dict(commands(typer.main.get_command(app)))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_parameter_is_described(name: str) -> None:
    """The text is a sentence in plain words: no markup of docstrings, and no seconds where the option takes ms."""
    for parameter in COMMANDS[name].params:
        assert parameter.help[0].isupper() and parameter.help.endswith("."), parameter.name
        assert "``" not in parameter.help and ":func:" not in parameter.help and len(parameter.help) > 9, parameter.name
        assert not ("--at-ms" in parameter.opts and ", s" in parameter.help)
    assert "Parameters" not in COMMANDS[name].help and f"explicitfe {name}" in COMMANDS[name].help


def test_the_help_of_compare_has_every_kind_of_recording() -> None:
    (other,) = (parameter for parameter in COMMANDS["compare"].params if parameter.name == "other")
    assert ", ".join([*TABLE_SUFFIXES, *MARKER_SUFFIXES]) in other.help


def computed(file: Path | str, *, times: Sequence[float] = (), time_s: float | None = None, progress: object = None) -> None:
    """Compute something.

    Parameters
    ----------
    file : not shown, because the command describes it itself.
    times : times in ms.
    time_s : time, s; by default
        the last one.
    progress : called with the share that is done.
    """


def test_a_command_has_its_own_parameters_and_those_of_a_function() -> None:
    given: dict[str, object] = {}

    @command_of(computed, times="--time MS")
    def compute(file: Path, *, as_json: bool = False, **options: object) -> None:
        """Compute something in a terminal.

        Parameters
        ----------
        file : input of :func:`computed`.
        """
        given.update(options, file=file, as_json=as_json)

    one = typer.Typer()
    one.command()(compute)
    made = typer.main.get_command(one)
    shown = {parameter.name: parameter for parameter in made.params}  # type: ignore[attr-defined]
    assert made.help == "Compute something in a terminal."  # type: ignore[attr-defined]
    assert {name: parameter.opts for name, parameter in shown.items() if name in ("file", "times", "time_s", "as_json")} == {
        "file": ["file"],
        "times": ["--time"],
        "time_s": ["--at-ms"],
        "as_json": ["--json"],
    }
    assert shown["file"].help == "Input of computed." and shown["times"].help == "Times in ms. Can be repeated."
    assert shown["time_s"].help == "Time, ms." and shown["time_s"].show_default == "the last one"
    assert "progress" not in shown
    for words, wanted in (
        (["a"], {"file": Path("a"), "as_json": False}),
        (["a", "--time", "1", "--time", "2", "--at-ms", "3", "--json"],
         {"file": Path("a"), "as_json": True, "times": [1.0, 2.0], "time_s": 1e-3 * 3}),
    ):  # fmt: skip
        given.clear()
        made(words, standalone_mode=False)
        assert given == wanted


def test_commands_work_without_docstrings() -> None:
    done = subprocess.run(
        [sys.executable, "-OO", "-m", "explicitfe", "list", "datasets"], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0 and "gel" in done.stdout, done.stderr
