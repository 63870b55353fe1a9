"""Questions to a person at a terminal. A script is never asked: it is told which option is missing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import TypeVar

from rich.markup import escape

from explicitfe.app.cli.answer import console
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host import stopping

_Answer = TypeVar("_Answer")


def somebody_is_there() -> bool:
    """Whether a person can answer: what is typed comes from a terminal, and words go to one."""
    return sys.stdin is not None and sys.stdin.isatty() and console.is_terminal


def ask(question: str, read: Callable[[str], _Answer], usual: str | None = None) -> _Answer:
    """Ask until the answer can be read.

    Parameters
    ----------
    read : what makes an answer of a line; InputError says what is wrong with it.
    usual : what an empty line means; without it there has to be an answer.

    Raises
    ------
    InputError : what is typed has ended.
    KeyboardInterrupt : Ctrl-C.
    """
    while True:
        hint = "" if usual is None else f" [dim]\\[{escape(usual) or 'none'}][/dim]"
        console.print(f"{escape(question)}{hint}: ", end="", highlight=False, soft_wrap=True)
        with stopping.interruptible():
            line = sys.stdin.readline()
        if not line:
            raise InputError("the answers ended before the last question; answer all, or give them as options (--help).")
        try:
            return read(line.strip() or (usual or ""))
        except InputError as error:
            console.print(f"  [red]{escape(str(error))}[/red]", highlight=False, soft_wrap=True)


def one_of(words: Sequence[str]) -> Callable[[str], str]:
    """An answer that is one of some words, or the beginning of one."""

    def read(line: str) -> str:
        begun = [word for word in words if line and word.startswith(line.lower())]
        if line.lower() in words:
            return line.lower()
        if len(begun) == 1:
            return begun[0]
        raise InputError(nearest(line, words) if line else f"please answer: {', '.join(words)}.")

    return read


def a_number(line: str) -> float:
    """An answer that is a number above 0."""
    try:
        number = float(line.replace(",", "."))
    except ValueError:
        number = float("nan")
    if not 0.0 < number < float("inf"):
        raise InputError("please type a number above 0.")
    return number


def yes_or_no(line: str) -> bool:
    """An answer that is yes or no."""
    return one_of(("yes", "no"))(line) == "yes"


def some_text(line: str) -> str:
    """An answer that is not empty."""
    if not line:
        raise InputError("please type something.")
    return line
