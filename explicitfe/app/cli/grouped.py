"""Options of a command as one object: a dataclass whose fields are the options."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from typing import Any, TypeVar, get_type_hints

OptionsT = TypeVar("OptionsT")


def with_options(kind: type[OptionsT]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a command whose last parameter is an object of a dataclass; its fields become options of the command.

    Parameters
    ----------
    kind : the dataclass; each field is annotated as typer asks for, and has a default.
    """

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        *own, last = inspect.signature(function).parameters.values()
        hints = get_type_hints(function, include_extras=True) | get_type_hints(kind, include_extras=True)
        options = fields(kind)  # type: ignore[arg-type]

        @wraps(function)
        def command(**given: Any) -> None:
            function(**{last.name: kind(**{option.name: given.pop(option.name) for option in options})}, **given)

        parameters = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[one.name]) for one in own]
        parameters += [
            inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=hints[one.name])
            for one in options
        ]
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {one.name: one.annotation for one in parameters}
        del command.__wrapped__
        return command

    return decorate
