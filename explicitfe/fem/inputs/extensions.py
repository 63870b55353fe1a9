"""Laws and effects of users: they join the tables of the package, so that models, scenarios and close-loop take them.

A class is registered by a decorator at the top of a script, or in a module that an installed package names in its pyproject.toml:

    [project.entry-points."explicitfe.extensions"]
    my_tissues = "my_tissues.laws"
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import cache
from importlib.metadata import entry_points
from typing import Literal, TypeVar

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.fem.materials import LAWS, Law
from explicitfe.platform.errors import InputError, shortened

GROUP = "explicitfe.extensions"
# "laws" and "effects" once the tables of scenarios have been made from them.
_complete: set[str] = set()

LawT = TypeVar("LawT", bound=Law)
EffectT = TypeVar("EffectT", bound=Effect)


def register_law(law: type[LawT]) -> type[LawT]:
    """Decorate a material law, so that elements and scenarios take it.

    The module of the class has the leaves ``isochoric`` and ``slope`` (or ``slopes`` for a law of two invariants), and the class
    has its name as the default of the key ``law``; see docs/reference/extending.md.

    Raises
    ------
    InputError : it is no law, another one has this name, or scenarios have been read already.
    """
    if not (isinstance(law, type) and issubclass(law, Law)):
        raise InputError(f"register_law decorates a class that is derived from Law, not {shortened(repr(law))}.")
    name = law.model_fields["law"].default
    _check(name, law, LAWS[name][0] if name in LAWS else None, "laws")
    LAWS[name] = law, sys.modules[law.__module__]
    return law


def register_effect(name: str) -> Callable[[type[EffectT]], type[EffectT]]:
    """Decorate an effect, so that models, scenarios, ``predict`` and ``close_loop`` take it under this name.

    Raises
    ------
    InputError : it is no effect, another one has this name, or scenarios have been read already.
    """

    def register(effect: type[EffectT]) -> type[EffectT]:
        if not (isinstance(effect, type) and issubclass(effect, Effect)):
            raise InputError(f"register_effect decorates a class that is derived from Effect, not {shortened(repr(effect))}.")
        _check(name, effect, EFFECTS.get(name), "effects")
        EFFECTS[name] = effect
        return effect

    return register


def _check(name: object, new: type, present: type | None, kind: str) -> None:
    if not isinstance(name, str) or not name:
        raise InputError(f"{new.__name__} has no name; a law has its name as the default of its key law.")
    same = present is not None and (present.__module__, present.__qualname__) == (new.__module__, new.__qualname__)
    if present is not None and not same:
        raise InputError(f"{new.__name__}: {shortened(name)} is the name of {present.__name__}; choose another one.")
    if kind in _complete and not same:
        raise InputError(f"{new.__name__}: register it at the top of the script, before the first scenario is read.")


@cache
def load_installed() -> None:
    """Import the extensions of installed packages.

    Raises
    ------
    InputError : an extension cannot be imported.
    """
    for entry in entry_points(group=GROUP):
        try:
            with redirect_stdout(sys.stderr):  # a program reads the output
                entry.load()
        except InputError:
            raise
        except (Exception, SystemExit) as error:  # a module that exits must not end every command
            reason = repr(error) if isinstance(error, SystemExit) else str(error)
            raise InputError(f"the extension {entry.name} ({entry.value}) cannot be imported: {reason}.") from error


def complete(kind: Literal["laws", "effects"]) -> None:
    """Note that the table of scenarios for this kind exists; later registrations are refused."""
    _complete.add(kind)
