"""What a sweep varies: keys of a scenario, each with values or a range."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date, time

from explicitfe.errors import InputError, shortened
from explicitfe.host.toml_text import toml_value

MOST_LEVELS_OF_A_FACTOR = 1_000_000
_BRACKETS = {"[": "]", "{": "}"}


@dataclass(frozen=True)
class Factor:
    """One key of a scenario that is varied.

    Attributes
    ----------
    key : as ``--set`` has it.
    levels : its values, if they are a list; empty for a range.
    low, high : of a range.
    """

    key: str
    levels: tuple[object, ...] = ()
    low: float = math.nan
    high: float = math.nan

    @property
    def is_range(self) -> bool:
        """Whether it has a range and no values."""
        return not self.levels


def factors_of(texts: Iterable[str]) -> tuple[Factor, ...]:
    """The factors of ``--vary``, in the order given.

    Raises
    ------
    InputError : one cannot be read, or a key is varied twice.
    """
    factors = tuple(factor_of(text) for text in texts)
    keys = [factor.key for factor in factors]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"--vary {shortened(key)}: this key is varied {keys.count(key)} times; give all its values at once.")
    return factors


def factor_of(text: str) -> Factor:
    """A factor from its text.

    ``KEY=LOW:HIGH:N`` are N values from LOW to HIGH, ends included; ``KEY=LOW:HIGH`` is a range; ``KEY=a,b,c`` are values.

    Raises
    ------
    InputError : it is none of these, or holds no value.
    """
    option = f"--vary {shortened(text)}"
    key, equals, values = text.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")):
        raise InputError(f"{option}: write KEY=LOW:HIGH:N, KEY=LOW:HIGH or KEY=a,b,c, such as muscle.GGp.force_N=0:4:9.")
    parts = _split(values, ",")
    ends = [] if len(parts) > 1 else _split(values, ":")
    if len(ends) in (2, 3) and all(_is_number(end) for end in ends[:2]):
        low, high = (float(end) for end in ends[:2])
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(f"{option}: a range needs two finite numbers, such as 0:4.")
        if not low < high:
            raise InputError(f"{option}: the range is empty; give a lower and then a higher number.")
        return Factor(key, low=low, high=high) if len(ends) == 2 else Factor(key, _levels(low, high, ends[2], option))
    if not values.strip() or not all(part.strip() for part in parts):
        raise InputError(f"{option}: a value is missing; write KEY=a,b,c.")
    try:
        levels = tuple(value_in(part) for part in parts)
    except InputError as error:
        raise InputError(f"{option}: {error}") from None
    if len({toml_value(level) for level in levels}) < len(levels):
        raise InputError(f"{option}: a value stands there twice.")
    return Factor(key, levels)


def value_in(text: str) -> object:
    """What the text of a value says: TOML, a number as other programs write it, or else a bare word.

    Raises
    ------
    InputError : a number that is none.
    """
    word = text.strip()
    try:
        table = tomllib.loads(f"value = {word}")
        value = table["value"] if table.keys() == {"value"} else word
    except (tomllib.TOMLDecodeError, ValueError, RecursionError):
        value = float(word) if _is_number(word) else word  # such as .5, which TOML has not
    if isinstance(value, (date, time)):  # no key of a scenario is one
        return word
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{shortened(word)} is no value for a member; give finite numbers.")
    return value


def setting_of(key: str, value: object) -> str:
    """A value of a factor as ``--set`` takes it."""
    return f"{key}={toml_value(value)}"


def _levels(low: float, high: float, count: str, option: str) -> tuple[object, ...]:
    number = int(count) if count.strip().isdecimal() and len(count.strip()) < 10 else 0
    if not 2 <= number <= MOST_LEVELS_OF_A_FACTOR:
        raise InputError(f"{option}: {shortened(count)} is no number of values; give 2 or more, such as {low:g}:{high:g}:9.")
    # Each from both ends, so that the last is exactly the higher end.
    return tuple((low * (number - 1 - k) + high * k) / (number - 1) for k in range(number))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _split(text: str, separator: str) -> list[str]:
    """Parts between separators that stand in no quotation marks and no brackets."""
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
