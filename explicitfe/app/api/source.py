"""What names a result in Python: a path, a name in ``outputs/``, an open result, or what ``run`` returned."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.result_files import SWEEP_FILE, find_result

if TYPE_CHECKING:
    from explicitfe.results.files import Recorded

Source: TypeAlias = "Recorded | Mapping[str, object] | Path | str"
"""A result: its path, its name in ``outputs/``, an open result, or the summary of a run."""


def path_of(source: Source, name: str = "result") -> Path:
    """The file of a result, or the folder of a sweep.

    Parameters
    ----------
    source : the result.
    name : of the parameter, for the message.

    Raises
    ------
    InputError : there is no such result, or it is none of these types.
    """
    from explicitfe.results.files import Recorded  # takes half a second to import

    if isinstance(source, Recorded):
        return source.path
    given = source.get("result") if isinstance(source, Mapping) else source
    if not isinstance(given, str | os.PathLike):
        raise InputError(
            f"{name} must be a path, a name in outputs/, an open result or the summary of a run, not {shortened(repr(source))}."
        )
    return find_result(Path(given))


def folder_of(value: Path | str, name: str) -> Path:
    """A path that a parameter names, which need not exist.

    Raises
    ------
    InputError : it is no path.
    """
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"{name} must be a path, not {shortened(repr(value))}.")
    return Path(value)


def is_sweep(path: Path) -> bool:
    """Whether a path is the folder of a sweep."""
    return (path / SWEEP_FILE).is_file()
