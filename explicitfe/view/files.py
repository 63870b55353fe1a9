"""Where pictures go: a new file, or one that may be replaced."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from explicitfe.errors import InputError


def new_files(targets: Iterable[Path], overwrite: bool) -> None:
    """See that files may be written, and make their folders.

    Raises
    ------
    InputError : one exists and may not be replaced, or is none, or its folder cannot be written.
    """
    for target in targets:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            if target.is_dir() or (target.exists() and not target.is_file()):
                raise InputError(f"{target} is no plain file; choose another --out folder")
            if target.is_file() and not overwrite:
                raise InputError(f"{target} exists; add --overwrite to replace it, or choose another --out folder")
        except OSError as error:
            raise InputError(f"{target} cannot be written ({error.strerror}); choose another --out folder") from None
