"""Machine code that is kept on disk: who may write it, for it is executed, and whether it is compiled now or was there."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from explicitfe.errors import InputError

VARIABLE = "NUMBA_CACHE_DIR"


def refuse_foreign_code(environment: Mapping[str, str] = os.environ) -> None:
    """Check the folder that the environment names for machine code.

    Numba keeps pickles there, and unpickling runs what they say: whoever can write there can run programs in the name of the
    user. A group that shares the folder trusts each other; everybody is too many.

    Raises
    ------
    InputError : others can write in the folder, or it belongs to another user.
    """
    folder = environment.get(VARIABLE, "")
    if not folder or os.name == "nt":
        return
    try:
        status = Path(folder).stat()
    except (OSError, ValueError):
        return  # it is made when it is needed, and then belongs to this user
    if status.st_mode & stat.S_IWOTH:
        why = "everybody can write there"
    elif status.st_uid not in (0, os.getuid()):
        why = "it belongs to another user"
    else:
        return
    raise InputError(
        f"{VARIABLE} = {folder}: {why}, and machine code that is kept there is executed in your name; name a folder that only "
        "you can write (mkdir, chmod 700)."
    )


@contextmanager
def compiler_watched(compiles: Callable[[], None]) -> Iterator[None]:
    """Call ``compiles`` each time that Numba begins to compile a function in this block; loading one from the disk is none."""
    from numba.core import event

    class Compilations(event.Listener):
        def on_start(self, event: object) -> None:
            compiles()

        def on_end(self, event: object) -> None:
            """Of a single function; what it calls was compiled before."""

    with event.install_listener("numba:compile", Compilations()):
        yield
