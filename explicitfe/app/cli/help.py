"""Commands as typer makes them, with two changes: the help shows no type beside flags, and messages name options as flags.

The library names its parameters, such as `constants_by`; the command line calls the same thing --constants-by.
"""

from __future__ import annotations

import re
from contextvars import ContextVar
from typing import Any

from typer.core import TyperCommand, TyperGroup

from explicitfe.platform.errors import InputError, RunError

# The context of the command that runs.
_context: ContextVar[Any] = ContextVar("_context", default=None)


def _without_types_of_flags(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters


class PlainCommand(TyperCommand):
    """A command."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_flags(super().get_params(ctx))

    def invoke(self, ctx: Any) -> Any:
        token = _context.set(ctx)
        try:
            return super().invoke(ctx)
        except (InputError, RunError) as error:
            error.args = (with_flags(str(error)),)
            raise
        finally:
            _context.reset(token)


def with_flags(message: str) -> str:
    """A message of the library in which the names of parameters, in backticks, are those of options and arguments."""
    context = _context.get()
    parameters = context.command.params if context else ()
    names = {p.name: p.name.upper() if p.param_type_name == "argument" else max(p.opts, key=len) for p in parameters}
    return re.sub(r"`(\w+)`", lambda match: names.get(match[1], match[0]), message)


def debugging() -> bool:
    """Whether the command has ``--debug``."""
    return bool(_context.get().find_root().params["debug"])


class PlainGroup(TyperGroup):
    """A command that has commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_flags(super().get_params(ctx))
