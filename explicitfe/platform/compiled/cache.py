"""Cache of compiled kernels on disk: files with checksums, in a folder that can be written."""

from __future__ import annotations

import hashlib
import io
import os
import stat
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import numba
from llvmlite import binding as llvm
from numba.core.caching import FunctionCache, IndexDataCacheFile

from explicitfe.platform.errors import InputError, RunWarning

VARIABLE = "NUMBA_CACHE_DIR"
_DIGEST_BYTES = hashlib.sha256().digest_size


def store_compiled_code(dispatcher: Any) -> None:
    """Store the compiled code of a kernel on disk, and load it from there in the next process.

    Raises
    ------
    InputError : Numba's compiler is switched off by NUMBA_DISABLE_JIT.
    """
    if numba.config.DISABLE_JIT:
        raise InputError("NUMBA_DISABLE_JIT is set, but explicitfe needs Numba's compiler; unset this environment variable.")
    try:
        dispatcher._cache = _KernelCache(dispatcher)
    except RuntimeError:  # neither the package nor the home folder can be written
        folder = temporary_folder()
        _warn(
            "neither the package folder nor the home folder can be written, so compiled kernels are "
            + ("compiled again by each command" if folder is None else f"stored in {folder}")
            + f"; set {VARIABLE} to a folder that you can write."
        )
        if folder is not None:
            numba.config.CACHE_DIR = os.environ[VARIABLE] = str(folder)  # the variable is for worker processes
            with suppress(RuntimeError):
                dispatcher._cache = _KernelCache(dispatcher)


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


class _CheckedFiles(IndexDataCacheFile):
    """Numba's index and data files with a SHA-256 digest at their end.

    A damaged file counts as missing, and the kernel is compiled again: LLVM would end the process on changed machine code, and
    Python's pickle executes what it reads. A file that cannot be written costs only the time of the next compilation.
    """

    def save(self, key: object, data: tuple[Any, ...]) -> None:
        try:
            super().save(key, _without_bitcode(data))
        except OSError as error:
            _warn(
                f"compiled kernels cannot be stored in {self._cache_path} ({error.strerror}) and are compiled again by the next "
                f"command; free disk space, or set {VARIABLE} to a folder that you can write."
            )

    def _load_index(self) -> dict[object, str]:
        return super()._load_index() if _is_intact(self._index_path) else {}

    def _load_data(self, name: str) -> object:
        path = self._data_path(name)
        if not _is_intact(path):
            raise OSError(f"{path} is damaged")  # Numba then compiles again
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BinaryIO]:
        with super()._open_for_write(filepath) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue())
            file.write(hashlib.sha256(content.getvalue()).digest())


class CheckedCache(FunctionCache):
    """Numba's cache of a function, with checked files."""

    _cache_file: Any

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        plain = self._cache_file
        self._cache_file = _CheckedFiles.__new__(_CheckedFiles)
        self._cache_file.__dict__.update(plain.__dict__)

    def load_overload(self, sig: object, target_context: Any) -> Any:
        """Load compiled code without what Numba prepares before, for a tenth of a second."""
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _KernelCache(CheckedCache):
    """Cache of a kernel."""

    def __init__(self, dispatcher: Any) -> None:
        super().__init__(dispatcher.py_func)
        self._makes_arrays = dispatcher.targetoptions["_nrt"]

    def load_overload(self, sig: object, target_context: Any) -> Any:
        """Load machine code; only a kernel that makes arrays needs what Numba prepares."""
        if self._makes_arrays:
            target_context.refresh()
        loaded = super().load_overload(sig, target_context)
        if loaded is not None:
            loaded.library._shared_module = None  # a kernel that called this one would link what _without_bitcode left
        return loaded


def _without_bitcode(data: tuple[Any, ...]) -> tuple[Any, ...]:
    """A compilation as Numba stores it, with the names of its functions instead of LLVM's code of them.

    That code is for other kernels that inline this one. There are none, and reading it takes longer than reading machine code.
    """
    (name, kind, code), *others = data
    if kind != "object":
        return data
    machine_code, bitcode = code
    functions = [function.name for function in llvm.parse_bitcode(bitcode).functions if not function.is_declaration]
    stubs = llvm.parse_assembly("".join(f'define void @"{function}"() {{ ret void }}\n' for function in functions))
    return (name, kind, (machine_code, stubs.as_bitcode())), *others


def _is_intact(path: str) -> bool:
    """Whether a file of the cache can be read and ends with the digest of its content."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-_DIGEST_BYTES]).digest() == content[-_DIGEST_BYTES:]


@cache
def _warn(sentence: str) -> None:
    """Warn once in a process."""
    warnings.warn(sentence, RunWarning, stacklevel=2)
