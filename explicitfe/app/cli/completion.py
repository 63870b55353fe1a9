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


def complete_words(words: Sequence[str]) -> Callable[[str], list[str]]:
    """What completes one of a few words."""
    return lambda incomplete: [word for word in words if word.startswith(incomplete)]


def complete_shipped(incomplete: str) -> list[str]:
    """Scenarios that come with the program."""
    return complete_words(list(shipped.scenarios()))(incomplete)


def _complete(names: Callable[[], Iterable[str]], endings: str | tuple[str, ...]) -> Callable[[str], list[str]]:
    """What completes a name, or a file of these endings."""
    return lambda incomplete: _fitting(incomplete, names(), endings)


def _names_of_unfinished() -> list[str]:
    """Interrupted results in the output folder."""
    ending = result_files.RUNNING_SUFFIX
    return [name.removesuffix(ending) for name in result_files.result_names() if name.endswith(ending)]


complete_scenario = _complete(shipped.scenarios, ".toml")
complete_dataset = _complete(shipped.datasets, ".toml")
complete_scenario_or_dataset = _complete(lambda: [*shipped.scenarios(), *shipped.datasets()], ".toml")
complete_protocol = _complete(shipped.protocols, ".toml")
complete_table = _complete(shipped.exports, (*shipped.TABLE_SUFFIXES, *shipped.MARKER_SUFFIXES))
complete_result = _complete(result_files.result_names, result_files.SUFFIX)
complete_unfinished_result = _complete(_names_of_unfinished, f"{result_files.RUNNING_SUFFIX}{result_files.SUFFIX}")


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
