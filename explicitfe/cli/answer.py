"""What a command prints: one JSON object for programs on stdout, or a table there and sentences on stderr for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.console import Console, RenderableType
from rich.markup import escape

from explicitfe.view.json_text import json_text

console = Console(stderr=True)
"""Where words for people go, and bars of progress."""


def print_answer(value: object, as_json: bool, table: Callable[[], RenderableType], notes: Sequence[str] = ()) -> None:
    """Print what a command came to: as JSON for programs, or as a table with notes for people."""
    if as_json:
        print(json_text(value))
        return
    Console().print(table())
    for sentence in notes:
        print_note(sentence)


def print_note(sentence: str) -> None:
    """Tell a person something beside the answer."""
    console.print(f"[yellow]note:[/yellow] {escape(sentence)}", soft_wrap=True, highlight=False)
