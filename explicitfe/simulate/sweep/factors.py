"""Factors of a sweep: keys of a scenario, each with values or a range."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date, time

import numpy as np

from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.toml_text import toml_value

MOST_LEVELS_OF_A_FACTOR = 1_000_000
_BRACKETS = {"[": "]", "{": "}"}


@dataclass(frozen=True)
class Factor:
    """A varied key of a scenario.

    Attributes
    ----------
    key : as in ``--set``.
    levels : its values; empty for a range.
    low, high : limits of a range.
    """

    key: str
    levels: tuple[object, ...] = ()
    low: float = math.nan
    high: float = math.nan

    @property
    def is_range(self) -> bool:
        """Whether it has a range instead of values."""
        return not self.levels


def factors_of(vary: Iterable[str] | Mapping[str, Iterable[object]]) -> tuple[Factor, ...]:
    """The factors in the order given: texts in the syntax of ``--vary``, or a dictionary of keys and their values.

    Raises
    ------
    InputError : a text is invalid, or a key is varied twice.
    """
    factors = tuple(factor_of(text) for text in (_texts_of(vary) if isinstance(vary, Mapping) else vary))
    keys = [factor.key for factor in factors]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(
                f"`vary` {shortened(key)}: this key is varied {keys.count(key)} times. Give all its values in one option."
            )
    return factors


def _texts_of(values: Mapping[str, Iterable[object]]) -> Iterator[str]:
    for key, levels in values.items():
        if isinstance(levels, str | bytes) or not isinstance(levels, Iterable):
            raise InputError(f"`vary` {shortened(key)}: give a list or an array of values, not {shortened(repr(levels))}.")
        plain = (level.item() if isinstance(level, np.generic) else level for level in levels)
        yield f"{key}={','.join(map(toml_value, plain))}"


def factor_of(text: str) -> Factor:
    """Parse a factor.

    ``KEY=LOW:HIGH:N`` means N values from LOW to HIGH inclusive; ``KEY=LOW:HIGH`` a range; ``KEY=a,b,c`` values.

    Raises
    ------
    InputError : the text has none of these forms, or no value.
    """
    option = f"`vary` {shortened(text)}"
    key, equals, values = text.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")):
        raise InputError(
            f"{option}: invalid syntax. Write KEY=LOW:HIGH:N, KEY=LOW:HIGH or KEY=a,b,c, such as muscle.GGp.force_N=0:4:9."
        )
    parts = _split(values, ",")
    ends = [] if len(parts) > 1 else _split(values, ":")
    if len(ends) in (2, 3) and all(_is_number(end) for end in ends[:2]):
        low, high = (float(end) for end in ends[:2])
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(f"{option}: the limits of a range must be finite numbers, such as 0:4.")
        if not low < high:
            raise InputError(f"{option}: the range is empty. The first number must be smaller than the second.")
        return Factor(key, low=low, high=high) if len(ends) == 2 else Factor(key, _levels(low, high, ends[2], option))
    if not values.strip() or not all(part.strip() for part in parts):
        raise InputError(f"{option}: a value is missing. Write KEY=a,b,c.")
    try:
        levels = tuple(value_in(part) for part in parts)
    except InputError as error:
        raise InputError(f"{option}: {error}") from None
    if len({toml_value(level) for level in levels}) < len(levels):
        raise InputError(f"{option}: a value is given twice. Remove the repetition.")
    return Factor(key, levels)


def value_in(text: str) -> object:
    """Parse a value: TOML, a number in another notation, or else a bare word.

    Raises
    ------
    InputError : the number is not finite.
    """
    word = text.strip()
    try:
        table = tomllib.loads(f"value = {word}")
        value = table["value"] if table.keys() == {"value"} else word
    except (tomllib.TOMLDecodeError, ValueError, RecursionError):
        value = float(word) if _is_number(word) else word  # such as .5, which is invalid in TOML
    if isinstance(value, (date, time)):  # no key of a scenario takes a date
        return word
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{shortened(word)} is not finite. Use finite numbers.")
    return value


def setting_of(key: str, value: object) -> str:
    """A value of a factor in the syntax of ``--set``."""
    return f"{key}={toml_value(value)}"


def _levels(low: float, high: float, count: str, option: str) -> tuple[object, ...]:
    number = int(count) if count.strip().isdecimal() and len(count.strip()) < 10 else 0
    if not 2 <= number <= MOST_LEVELS_OF_A_FACTOR:
        raise InputError(f"{option}: {shortened(count)} is no valid number of values. Use 2 or more, such as {low:g}:{high:g}:9.")
    # Interpolated from both ends, so that the last value is exactly the upper limit.
    return tuple((low * (number - 1 - k) + high * k) / (number - 1) for k in range(number))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _split(text: str, separator: str) -> list[str]:
    """Split at separators outside of quotation marks and brackets."""
    parts, begin, closing, quote = [], 0, [], ""
    for place, letter in enumerate(text):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in _BRACKETS:
            closing.append(_BRACKETS[letter])
        elif closing and letter == closing[-1]:
            closing.pop()
        elif letter == separator and not closing:
            parts.append(text[begin:place])
            begin = place + 1
    return [*parts, text[begin:]]
