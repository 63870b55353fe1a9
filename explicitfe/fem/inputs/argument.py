"""Check numbers of a Python caller against the limits that a scenario has for the same quantity."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from numbers import Integral, Real
from typing import get_args

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from explicitfe.fem.inputs.bounds import check_bounds, check_fields
from explicitfe.platform.errors import InputError, shortened

FLOAT_LIMIT = float(np.finfo(float).max)  # a number that overflows in another unit is out of bounds there
# Kind of limit -> its attribute, whether a number is within it, and what a message says.
_LIMITS: tuple[tuple[type, str, Callable[[float, float], bool], str], ...] = (
    (Gt, "gt", operator.gt, "above {}"),
    (Ge, "ge", operator.ge, "{} or more"),
    (Lt, "lt", operator.lt, "below {}"),
    (Le, "le", operator.le, "{} or less"),
)


def number_like(name: str, value: object, kind: object, key: str, scale: float = 1.0) -> float:
    """A finite number within the limits of a kind of numbers and of a unit.

    Parameters
    ----------
    name : the parameter, for the message, such as "Transient: duration_s".
    value : what the caller gave.
    kind : annotated type with limits, see ``limits.py``.
    key : the key of a scenario with the same meaning; the unit at its end has bounds.
    scale : factor from the unit of the parameter to that of the key, such as 1e3 from s to ms.

    Raises
    ------
    InputError : it is no finite number, or outside the limits.
    """
    number = finite_number(name, value)
    rules = FieldInfo.from_annotation(kind).metadata  # type: ignore[arg-type]
    for rule in rules:
        for kind, attribute, is_within, words in _LIMITS:
            if isinstance(rule, kind) and not is_within(scale * number, limit := float(getattr(rule, attribute))):
                raise InputError(f"{name} = {number:g} is not possible: it must be {words.format(f'{limit / scale:g}')}.")
    try:
        check_bounds(key, float(np.clip(scale * number, -FLOAT_LIMIT, FLOAT_LIMIT)), rules)
    except PydanticCustomError as error:
        raise InputError(f"{name} = {number:g} is not possible: {(error.context or {})['reason']}.") from None
    return number


def vector(name: str, value: object, largest: float) -> tuple[float, float, float]:
    """Three finite numbers, of at most this magnitude.

    Raises
    ------
    InputError : they are not.
    """
    parts = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(parts, list | tuple) or len(parts) != 3:
        raise InputError(f"{name} must be three numbers (x, y, z), not {shortened(repr(value))}.")
    x, y, z = (finite_number(f"{name}[{place}]", part) for place, part in enumerate(parts))
    if max(abs(x), abs(y), abs(z)) > largest:
        raise InputError(f"{name} = {shortened(repr(value))} is out of range: the largest magnitude is {largest:g}.")
    return x, y, z


def finite_number(name: str, value: object, smallest: float = -math.inf) -> float:
    """A finite number that is not below ``smallest``.

    Raises
    ------
    InputError : it is none.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{name} must be a number, not {shortened(repr(value))}.")
    try:
        number = float(value)
    except OverflowError:  # a whole number without a float
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{name} must be a finite number, not {shortened(repr(value))}.")
    if number < smallest:
        raise InputError(f"{name} = {number:g} is not possible: it must be {smallest:g} or more.")
    return number


def count_like(name: str, value: object, kind: object, key: str) -> int:
    """A whole number within the limits of a kind of numbers; see :func:`number_like`.

    Raises
    ------
    InputError : it is no whole number, or outside the limits.
    """
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise InputError(f"{name} must be a whole number, not {shortened(repr(value))}.")
    return int(number_like(name, int(value), kind, key))


def choice_like(name: str, value: object, kind: object) -> str:
    """One of the texts of a ``Literal``.

    Raises
    ------
    InputError : it is none of them; the message lists them.
    """
    valid = get_args(kind)
    if not isinstance(value, str) or value not in valid:
        raise InputError(f"{name} = {shortened(repr(value))} is not possible: it must be {' or '.join(map(repr, valid))}.")
    return value


def checked_fields(name: str, constants: BaseModel) -> None:
    """Refuse constants outside the limits that a scenario has for them.

    Raises
    ------
    InputError : names the constant.
    """
    try:
        check_fields(constants)
    except PydanticCustomError as error:
        context = error.context or {}
        raise InputError(f"{name}: {context['key']} = {context['number']:g} is not possible: {context['reason']}.") from None
