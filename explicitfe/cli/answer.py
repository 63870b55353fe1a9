"""What a command prints: one JSON object for programs on stdout, or a table there and sentences on stderr for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import typer
from rich.console import RenderableType
from rich.markup import escape

from explicitfe.cli.ending import CommandError, ErrorKind, command_error
from explicitfe.cli.streams import Screen, stderr, stdout
from explicitfe.view.json_text import json_text

console = Screen(stderr)
"""Where words for people go, and bars of progress."""

# What stands before a sentence on an error.
_HEADS: dict[ErrorKind, str] = {
    "input": "error",
    "simulation": "failed",
    "machine": "failed",
    "fault": "fault",
    "stopped": "stopped",
}


def print_answer(
    value: Mapping[str, object],
    as_json: bool,
    table: Callable[[], RenderableType],
    notes: Sequence[str] = (),
    error: tuple[ErrorKind, str] | None = None,
) -> None:
    """Print what a command came to: as JSON for programs, or as a table with notes for people.

    Parameters
    ----------
    error : what is to blame that not all was done, and a sentence on it; the command then ends here with its exit code.

    Raises
    ------
    typer.Exit : ``error`` is given.
    """
    failure = None if error is None else command_error(*error)
    if as_json:
        print_json(value if failure is None else {**value, "error": failure})
    else:
        Screen(stdout).print(table())
        for sentence in notes:
            print_note(sentence)
    if failure is not None:
        print_error(failure)
        raise typer.Exit(failure["exit_code"])


def print_json(value: object) -> None:
    """Print a JSON value on stdout."""
    stdout.write(json_text(value) + "\n")
    stdout.flush()


def print_note(sentence: str) -> None:
    """Tell a person something beside the answer."""
    console.print(f"[yellow]note:[/yellow] {escape(sentence)}", soft_wrap=True, highlight=False)


def print_error(error: CommandError) -> None:
    """Tell a person why a command did not do what was asked."""
    console.print(f"[red]{_HEADS[error['kind']]}:[/red] {escape(error['message'])}", soft_wrap=True, highlight=False)
