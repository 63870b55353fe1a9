"""Compiled kernels of a run: loaded from the cache on disk, or compiled where they are missing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from pydantic import BaseModel

from explicitfe.platform.errors import Progress
from explicitfe.platform.host.compilation import announcing


class Compiled(Protocol):
    """A body whose steps are compiled kernels: a simulation in time, or a search for equilibria."""

    def compile(self, progress: Callable[[float], None]) -> float:
        """Load or compile the kernels, reporting the share that is done; give the seconds that it took."""


def make_ready(body: Compiled, progress: Progress, what: str) -> float:
    """Load or compile the kernels of a body; give the seconds that it took.

    Parameters
    ----------
    progress : called with the stage "load" and, from the first compilation on, with "compile".
    what : the kernels, for the report of a compilation, such as "tongue models".
    """
    compiles = False

    def compiler_begins() -> None:
        nonlocal compiles
        compiles = True
        progress("compile", 0.0)

    def report(share: float) -> None:
        progress("compile" if compiles else "load", share)

    with announcing(what, compiler_begins):
        return body.compile(report)


def kernels_of(model: str, element: str, effects: BaseModel) -> str:
    """Describe the kernels of a run, such as "tongue models of hex8 elements with viscoelastic".

    Parameters
    ----------
    effects : the table of effects of a scenario.
    """
    names = ", ".join(name for name in type(effects).model_fields if getattr(effects, name) is not None)
    return f"{model} models of {element} elements" + (f" with {names}" if names else "")
