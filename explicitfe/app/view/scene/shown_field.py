"""The field that colours a body: its values, unit and colour scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.platform.errors import InputError, nearest
from explicitfe.results.files import Result

# Name that selects a picture without a field.
NO_FIELD = "none"
# Unit in a result -> unit in a picture and the factor between them.
SHOWN_UNITS = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "Pa": ("kPa", 1e-3), "J": ("µJ", 1e6), "1": ("", 1.0)}
# Of these fields a value means "as at rest": it stands in the middle of two colours.
NEUTRAL_VALUES = {"J": 1.0}
NEUTRAL_COLOURS, RISING_COLOURS = "coolwarm", "viridis"
ON_MARK_SHARE = 1e-9
# What fields are called whose names say too little.
NAMES = {"J": "volume ratio J", "velocity": "speed", "von_mises": "von Mises stress", "nodal_von_mises": "von Mises stress"}


@dataclass(frozen=True)
class ShownField:
    """A stored field as it is drawn.

    Attributes
    ----------
    name : in the result.
    kind : "point" or "cell".
    label : for people, with the unit.
    factor : from the stored to the drawn unit.
    limits : of the scale, in the drawn unit.
    colours : name of the scale.
    """

    name: str
    kind: str
    label: str
    factor: float
    limits: tuple[float, float]
    colours: str

    def values(self, result: Result, step: int) -> np.ndarray:
        """Values at a sample, one per node or element, in the drawn unit; the length of a vector."""
        return self.factor * _lengths(result.field(self.name, step))


def check_field(result: Result, name: str) -> None:
    """InputError unless a result has a field of that name, or the name is that of none."""
    if name != NO_FIELD and name not in result.fields:
        raise InputError(f'{result.path} has no field "{name}"; {nearest(name, [*result.fields, NO_FIELD])}')
    if name != NO_FIELD and result.fields[name].quantity.components > 3:
        raise InputError(f'field "{name}" is a tensor; colour by a number, such as von_mises or pressure of record.fields.')


def shown_field(result: Result, name: str, steps: Sequence[int]) -> ShownField | None:
    """A field with a scale that holds for all ``steps``; None for ``NO_FIELD``.

    Raises
    ------
    InputError : the result has no such field.
    """
    check_field(result, name)
    if name == NO_FIELD:
        return None
    kind, quantity = result.fields[name]
    unit, factor = SHOWN_UNITS.get(quantity.unit, (quantity.unit, 1.0))
    label = NAMES.get(name, name.replace("_", " "))
    ends = np.array([(np.nanmin(values), np.nanmax(values)) for values in (_lengths(result.field(name, step)) for step in steps)])
    low, high = rounded_down(factor * float(ends[:, 0].min())), -rounded_down(-factor * float(ends[:, 1].max()))
    colours = RISING_COLOURS
    if name in NEUTRAL_VALUES:
        neutral = factor * NEUTRAL_VALUES[name]
        reach = -rounded_down(
            -max(factor * float(ends[:, 1].max()) - neutral, neutral - factor * float(ends[:, 0].min())), digits=1
        )
        reach = reach or abs(neutral)
        low, high, colours = neutral - reach, neutral + reach, NEUTRAL_COLOURS
    elif low >= 0.0:
        low = 0.0
    if not high > low:
        high = low + 1.0
    return ShownField(name, kind, f"{label} ({unit})" if unit else label, factor, (low, high), colours)


def rounded_down(value: float, digits: int = 2) -> float:
    """The next number below with so many significant digits: scales end in numbers that can be read."""
    if value == 0.0 or not math.isfinite(value):
        return value
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    return float(f"{math.floor(value / unit + ON_MARK_SHARE) * unit:.12g}")


def _lengths(values: np.ndarray) -> np.ndarray:
    return values if values.ndim == 1 else np.linalg.norm(values, axis=1)
