"""Shell completion: names of shipped scenarios and data and of results, then files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from typer.completion import shell_complete

from explicitfe.platform.host import result_files, shipped

PROGRAM = "explicitfe"
VARIABLE = f"_{PROGRAM.upper()}_COMPLETE"
"""By it the script that a shell has of ``explicitfe --install-completion`` asks for the words that fit."""


def answer_to_shell(command: Any) -> int | None:
    """Print the words that fit, where a shell asks for them; give the exit code, or None where nobody asks.

    ``command`` is what ``typer.main.get_command`` gives, whose class differs among the versions of typer.
    """
    instruction = os.environ.get(VARIABLE)
    return shell_complete(command, {}, PROGRAM, VARIABLE, instruction) if instruction else None


def complete_scenario(incomplete: str) -> list[str]:
    """Scenarios."""
    return _fitting(incomplete, shipped.scenarios(), ".toml")


def complete_shipped(incomplete: str) -> list[str]:
    """Scenarios that come with the program."""
    return [name for name in shipped.scenarios() if name.startswith(incomplete)]


def complete_dataset(incomplete: str) -> list[str]:
    """Datasets."""
    return _fitting(incomplete, shipped.datasets(), ".toml")


def complete_scenario_or_dataset(incomplete: str) -> list[str]:
    """Scenarios and datasets."""
    return _fitting(incomplete, [*shipped.scenarios(), *shipped.datasets()], ".toml")


def complete_protocol(incomplete: str) -> list[str]:
    """Protocols of planned tests."""
    return _fitting(incomplete, shipped.protocols(), ".toml")


def complete_table(incomplete: str) -> list[str]:
    """Tables of testing machines, and recordings."""
    return _fitting(incomplete, shipped.exports(), (*shipped.TABLE_SUFFIXES, *shipped.MARKER_SUFFIXES))


def complete_result(incomplete: str) -> list[str]:
    """Results: names in the output folder, and files."""
    return _fitting(incomplete, result_files.result_names(), result_files.SUFFIX)


def complete_unfinished_result(incomplete: str) -> list[str]:
    """Interrupted results: names in the output folder, and files."""
    ending = result_files.RUNNING_SUFFIX
    names = [name.removesuffix(ending) for name in result_files.result_names() if name.endswith(ending)]
    return _fitting(incomplete, names, f"{ending}{result_files.SUFFIX}")


def complete_words(words: Sequence[str]) -> Callable[[str], list[str]]:
    """What completes one of a few words."""

    def complete(incomplete: str) -> list[str]:
        return [word for word in words if word.startswith(incomplete)]

    return complete


def _fitting(incomplete: str, names: Iterable[str], endings: str | tuple[str, ...]) -> list[str]:
    """Names that begin so, and files of these endings and folders that do."""
    begin = incomplete.rpartition(os.sep)[2]
    folder = incomplete.removesuffix(begin)
    try:
        entries = sorted(Path(folder or ".").iterdir())
    except OSError:
        entries = []
    at_hand = [
        f"{folder}{entry.name}{os.sep if entry.is_dir() else ''}"
        for entry in entries
        if entry.name.startswith(begin)
        and (begin or not entry.name.startswith("."))
        and (entry.is_dir() or entry.name.lower().endswith(endings))
    ]
    return [*(name for name in sorted(names) if name.startswith(incomplete)), *at_hand]
