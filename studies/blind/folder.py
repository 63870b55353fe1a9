"""The folder of a blind study: what was asked for, one command at a time, and no half-read files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from typing_extensions import TypedDict

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.files import lock
from explicitfe.platform.host.text import json_of, text_of
from explicitfe.results.files.folder import remove_unfinished

MANIFEST = "made.json"
LARGEST_REPORT_BYTES = 256 * 2**20


class Manifest(TypedDict):
    """What was asked for: the file ``made.json``, without anything of the truth; ``order`` is a sum of all requests."""

    seed: int
    family: str
    count: int
    order: str


def manifest_of(study: Path) -> Manifest | None:
    """What was asked for in a folder; None if it holds no cases.

    Raises
    ------
    InputError : the file is damaged.
    """
    path = study / MANIFEST
    return cast(Manifest, table_of(path, set(Manifest.__annotations__))) if path.is_file() else None


def table_of(path: Path, keys: set[str] | frozenset[str]) -> dict[str, Any]:
    """A table of a JSON file with these keys at least.

    Raises
    ------
    InputError : it cannot be read, is no JSON, or lacks a key.
    """
    table = json_of(text_of(path, "make the cases again in a new folder", largest_bytes=LARGEST_REPORT_BYTES), path)
    missing = sorted(keys - table.keys()) if isinstance(table, dict) else sorted(keys)
    if missing or not isinstance(table, dict):
        raise InputError(f'{path}: the key "{missing[0] if missing else ""}" is missing; create the cases again in a new folder.')
    return table


@contextmanager
def alone_in(study: Path) -> Iterator[None]:
    """Work in a folder of a study as the only command; what killed ones left half-written in it is removed first.

    Raises
    ------
    InputError : another command works in it.
    """
    if os.name == "nt":  # Windows does not open folders.
        yield
        return
    number = os.open(study, os.O_RDONLY)
    try:
        if not lock(number):
            raise InputError(f"{study}: another command is using this folder; wait until it has finished.")
        for folder in (study, study / "cases", study / "sealed", study / "reports"):
            remove_unfinished(folder)
        yield
    finally:
        os.close(number)
