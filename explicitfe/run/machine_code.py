"""Machine code for a run: loaded from the disk, or compiled where it is not there yet."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from explicitfe.errors import Progress
from explicitfe.host.code_cache import compiler_watched


class Compiled(Protocol):
    """A body whose steps are machine code: a simulation, or a search for equilibria."""

    def compile(self, progress: Callable[[float], None]) -> float:
        """Make the machine code ready, telling the share that is done; give the seconds that it took."""


def make_ready(body: Compiled, progress: Progress) -> float:
    """Make the machine code of a body ready; give the seconds that it took.

    ``progress`` is called with the stage "load" and, from when the compiler begins, if it does, with "compile".
    """
    compiles = False

    def compiler_begins() -> None:
        nonlocal compiles
        if not compiles:
            compiles = True
            progress("compile", 0.0)

    def report(share: float) -> None:
        if compiles:
            progress("compile", share)
        else:
            progress("load", share)

    with compiler_watched(compiler_begins):
        return body.compile(report)
