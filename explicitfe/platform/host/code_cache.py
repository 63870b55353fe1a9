"""Environment of the compiler: variables, permissions of the folder of compiled kernels, and a listener for compilations."""

from __future__ import annotations

import os
import platform
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from explicitfe.platform.errors import InputError, shortened

VARIABLE = "NUMBA_CACHE_DIR"


def check_environment(environment: Mapping[str, str] = os.environ) -> None:
    """Check the environment variables of Numba before it is imported, which would fail without a clear message.

    Raises
    ------
    InputError : a variable has a value with which no kernel can be compiled, or see :func:`refuse_foreign_code`.
    """
    if environment.get("NUMBA_DISABLE_JIT", "") not in ("", "0"):
        raise InputError("NUMBA_DISABLE_JIT is set, but explicitfe needs Numba's compiler; unset this environment variable.")
    threads = environment.get("NUMBA_NUM_THREADS", "")
    if threads and not (threads.isascii() and threads.isdecimal() and int(threads[:7]) > 0):
        raise InputError(
            f'NUMBA_NUM_THREADS is "{shortened(threads)}", but must be a number of threads, such as 4; set or unset this '
            "environment variable."
        )
    refuse_foreign_code(environment)


def refuse_foreign_code(environment: Mapping[str, str] = os.environ) -> None:
    """Check the owner and permissions of the folder for compiled kernels that the environment names.

    Numba stores pickles there, and unpickling executes code: a user who can write there can run programs with the rights of the
    current user. Write permission of a group is accepted, write permission of all users is not.

    Raises
    ------
    InputError : all users can write in the folder, or it belongs to another user.
    """
    folder = environment.get(VARIABLE, "")
    if not folder or os.name == "nt":
        return
    try:
        status = Path(folder).stat()
    except (OSError, ValueError):
        return  # it is created when it is needed, and then belongs to this user
    if status.st_mode & stat.S_IWOTH:
        why = "all users can write there"
    elif status.st_uid not in (0, os.getuid()):
        why = "it belongs to another user"
    else:
        return
    raise InputError(
        f"{VARIABLE} = {folder} is not safe: {why}, and compiled kernels in it are executed with your rights. Use a folder that "
        "only you can write (mkdir, chmod 700)."
    )


def kernel_folder() -> Path | None:
    """Folder of the compiled kernels of this package; None if neither the package nor the home folder is writable."""
    stated = os.environ.get(VARIABLE)
    if stated:
        return Path(stated)
    package = Path(__file__).resolve().parents[2]
    if can_write(package):
        return package
    caches = {"Windows": "AppData/Local", "Darwin": "Library/Caches"}
    user = Path.home() / caches.get(platform.system(), ".cache")
    return user / "numba" if can_write(user) else None


def can_write(folder: Path) -> bool:
    """Whether files can be made in a folder."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@contextmanager
def compiler_watched(compiles: Callable[[], None]) -> Iterator[None]:
    """Call ``compiles`` whenever Numba starts to compile a function in this block; loading a cached one does not count."""
    from numba.core import event

    class Compilations(event.Listener):
        def on_start(self, event: object) -> None:
            compiles()

        def on_end(self, event: object) -> None:
            """Of a single function; what it calls was compiled before."""

    with event.install_listener("numba:compile", Compilations()):
        yield
