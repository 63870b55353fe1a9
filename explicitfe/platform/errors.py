"""Progress reports and exceptions that all parts of the program use."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from typing import Literal, Self

Stage = Literal[
    "load",
    "compile",
    "run",
    "load-step",
    "draw",
    "compare",
    "export",
    "identify",
    "predict",
    "trace",
    "design",
    "close-loop",
    "make",
    "warm",
    "bench",
    "verify",
    "sweep",
]
"""What a long task is doing; ``view/progress.py`` has words for each."""

Progress = Callable[[Stage, float], None]
"""What a long task calls from time to time with its stage and the share of it that is done, 0 to 1; it may be a ``Share``."""


class Share(float):
    """A share of a task that is done, 0 to 1, with words that say what is being computed, such as "effect 12 of 24"."""

    words: str

    def __new__(cls, share: float, words: str) -> Self:
        self = super().__new__(cls, share)
        self.words = words
        return self


def counted(done: int, count: int, unit: str) -> Share:
    """The share of ``count`` equal parts after ``done`` of them; its words name the part that is computed next."""
    return Share(done / count, f"{unit} {min(done + 1, count)} of {count}")


def silent(stage: Stage, share: float) -> None:
    """Progress that is discarded."""


class InputError(ValueError):
    """Invalid input: a scenario, model, mesh or option. The command line prints the message and exits with code 2."""


class RunWarning(UserWarning):
    """A sentence for the user during a run. The command line prints it; it does not print warnings of libraries."""


class RunError(RuntimeError):
    """A run that could not be finished. The command line prints the message and exits with code 3."""


class MachineError(RunError):
    """An operation that the machine or its operating system refuses: disk full, no permission, not enough memory. Exit code 3."""


LONGEST_ECHO_CHARACTERS = 60  # of what a user wrote, in a sentence about it
MOST_NAMES_LISTED = 20


def shortened(text: str) -> str:
    """User text for a message: on one line, without control characters, and shortened if it is long."""
    echo = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text[:LONGEST_ECHO_CHARACTERS])
    return echo if len(text) <= LONGEST_ECHO_CHARACTERS else f"{echo}... ({len(text)} characters)"


def nearest(word: str, valid: Iterable[str]) -> str:
    """End of a sentence on an unknown name: 'did you mean "x"?', or 'valid names: a, b.' if none is similar."""
    valid = sorted(valid)
    if not valid:
        return "there is none."
    by_lower = {name.lower(): name for name in valid}
    match = get_close_matches(shortened(word).lower(), by_lower, n=1, cutoff=0.5)
    if match:
        return f'did you mean "{by_lower[match[0]]}"?'
    more = f" and {len(valid) - MOST_NAMES_LISTED} more" if len(valid) > MOST_NAMES_LISTED else ""
    return f"valid are: {', '.join(shortened(name) for name in valid[:MOST_NAMES_LISTED])}{more}."
