"""Checks of results that are shown together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from explicitfe.platform.errors import InputError
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result

MOST_RESULTS = 8  # more lines or pictures cannot be distinguished
KINDS_IN_WORDS = {"transient": "a run in time", "relaxation": "an indentation"}


def check_count(paths: Sequence[Path], most: int = MOST_RESULTS) -> None:
    """InputError if there are more results than a picture can show."""
    if len(paths) > most:
        raise InputError(f"at most {most} results can be shown together, not {len(paths)}; leave out some of them.")


def same_kind(results: Sequence[Result]) -> str:
    """The kind of analysis that all results have.

    Raises
    ------
    InputError : they have different kinds.
    """
    kinds = [kind_of(result.model) for result in results]
    for result, kind in zip(results, kinds, strict=True):
        if kind != kinds[0]:
            raise InputError(
                f"{results[0].path} is {KINDS_IN_WORDS[kinds[0]]} and {result.path} is {KINDS_IN_WORDS[kind]}; "
                "they cannot be shown together."
            )
    return kinds[0]
