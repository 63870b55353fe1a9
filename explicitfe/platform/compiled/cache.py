"""Folder of compiled kernels on disk: one that can be written."""

from __future__ import annotations

import os
import stat
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba

from explicitfe.platform.errors import InputError, RunWarning

VARIABLE = "NUMBA_CACHE_DIR"


def store_compiled_code(dispatcher: Any, store: Callable[[Any], None]) -> None:
    """Store the compiled code of a kernel on disk, and load it from there in the next process.

    ``store`` does so, and raises RuntimeError if neither the package nor the home folder can be written.

    Raises
    ------
    InputError : Numba's compiler is switched off by NUMBA_DISABLE_JIT.
    """
    if numba.config.DISABLE_JIT:
        raise InputError("NUMBA_DISABLE_JIT is set, but explicitfe needs Numba's compiler; unset this environment variable.")
    try:
        store(dispatcher)
    except RuntimeError:
        folder = temporary_folder()
        _warn(
            "neither the package folder nor the home folder can be written, so compiled kernels are "
            + ("compiled again by each command" if folder is None else f"stored in {folder}")
            + f"; set {VARIABLE} to a folder that you can write."
        )
        if folder is not None:
            numba.config.CACHE_DIR = os.environ[VARIABLE] = str(folder)  # the variable is for worker processes
            with suppress(RuntimeError):
                store(dispatcher)


@cache
def temporary_folder() -> Path | None:
    """Folder for compiled kernels if no other folder can be written; None if there is no temporary folder either.

    It is the same one for all processes of a user. Its owner and permissions are checked, because its files are executed.
    """
    try:
        user = os.getuid() if hasattr(os, "getuid") else 0
        folder = Path(tempfile.gettempdir()) / f"explicitfe-kernels-{user}"
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        status = folder.lstat()
        is_own = stat.S_ISDIR(status.st_mode) and (os.name == "nt" or (status.st_uid == user and not status.st_mode & 0o022))
        return folder if is_own else Path(tempfile.mkdtemp(prefix="explicitfe-kernels-"))
    except OSError:
        return None


def warn_of_storing(folder: str, error: OSError) -> None:
    """Warn that compiled code cannot be stored in a folder."""
    _warn(
        f"compiled kernels cannot be stored in {folder} ({error.strerror}) and are compiled again by the next "
        f"command; free disk space, or set {VARIABLE} to a folder that you can write."
    )


@cache
def _warn(sentence: str) -> None:
    warnings.warn(sentence, RunWarning, stacklevel=2)
