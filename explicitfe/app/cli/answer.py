"""What a command prints: one JSON object for programs on stdout, or a table there and sentences on stderr for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import typer
from rich.console import RenderableType
from rich.markup import escape

from explicitfe.app.cli.ending import CommandFailure, FailureKind, command_failure
from explicitfe.app.cli.help import with_flags
from explicitfe.app.cli.streams import Screen, stderr, stdout
from explicitfe.app.view.json_text import json_text

console = Screen(stderr)
"""Where words for people go, and bars of progress."""

# What stands before the sentence on a failure.
_HEADS: dict[FailureKind, str] = {
    "input": "error",
    "simulation": "failed",
    "machine": "failed",
    "fault": "fault",
    "stopped": "ended",
    "check": "no",
}


def print_answer(
    value: Mapping[str, object],
    as_json: bool,
    table: Callable[[], RenderableType],
    notes: Sequence[str] = (),
    failure: tuple[FailureKind, str] | None = None,
) -> None:
    """Print what a command came to: as JSON for programs, or as a table with notes for people.

    Parameters
    ----------
    failure : what is to blame that not all was done, and a sentence on it; the command then ends here with its exit code.

    Raises
    ------
    typer.Exit : ``failure`` is given.
    """
    failed = None if failure is None else command_failure(*failure)
    if as_json:
        print_json(value if failed is None else {**value, "failure": failed})
    else:
        Screen(stdout).print(table(), crop=False)  # names of files are longer than a line of a terminal
        for sentence in notes:
            print_note(with_flags(sentence))
    if failed is not None:
        print_failure(failed)
        raise typer.Exit(failed["exit_code"])


def print_json(value: object) -> None:
    """Print a JSON value on stdout."""
    stdout.write(json_text(value) + "\n")
    stdout.flush()


def print_note(sentence: str) -> None:
    """Tell a person something beside the answer."""
    console.print(f"[yellow]note:[/yellow] {escape(sentence)}", soft_wrap=True, highlight=False)


def print_failure(failure: CommandFailure) -> None:
    """Tell a person why a command did not do what was asked."""
    console.print(f"[red]{_HEADS[failure['kind']]}:[/red] {escape(failure['message'])}", soft_wrap=True, highlight=False)
