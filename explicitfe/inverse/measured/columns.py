"""Columns of a table by the quantity that they have."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from explicitfe.inverse.measured.export import Export, ExportColumn
from explicitfe.inverse.measured.quantities import QUANTITIES, Quantity, is_unit, measure_of, unit_of
from explicitfe.platform.errors import InputError, shortened

# "Weg Soll", "Disp set": what the machine should have done.
_SET_VALUE = re.compile(r"soll(wert)?\b|\bset\b|set.?(point|value)|target|command|demand|consigne", re.IGNORECASE)


def candidates(export: Export, quantity: Quantity) -> list[ExportColumn]:
    """Return the columns that a quantity may be by their names, or if there are none by their units.

    Another strain is none beside an engineering strain, a set value beside a measured one, and a time that goes back or stands
    still beside one that does not.
    """
    # "Time at load (s)" is no force.
    possible = [c for c in export.columns if not is_unit(c.unit) or c.unit == "-" or unit_of(quantity, c.unit) is not None]
    with_unit = [column for column in possible if unit_of(quantity, column.unit) is not None]
    named = [column for column in possible if QUANTITIES[quantity].names.search(column.name)]
    best = [column for column in named if column in with_unit] or named or with_unit
    for worse in (
        lambda column: measure_of(quantity, column.name) is not None,
        lambda column: _SET_VALUE.search(column.name) is not None,
        lambda column: quantity == "time" and ((np.diff(_numbers(column)) < 0.0).any() or not np.ptp(_numbers(column))),
    ):
        best = [column for column in best if not worse(column)] or best
    return best


def set_value(export: Export, choice: Choice) -> str:
    """Return the name of the column with the set values of a quantity, where another was chosen; empty if there is none."""
    words = QUANTITIES[choice.quantity].names
    names = [column.name for column in export.columns if _SET_VALUE.search(column.name) and words.search(column.name)]
    return names[0] if names and choice.column.name not in names else ""


def _numbers(column: ExportColumn) -> np.ndarray:
    return column.values[np.isfinite(column.values)]


@dataclass(frozen=True)
class Choice:
    """A column of a table, and its unit."""

    column: ExportColumn
    quantity: Quantity
    unit: str

    @property
    def factor(self) -> float:
        """Factor to the unit of a dataset."""
        return QUANTITIES[self.quantity].units[self.unit]


def chosen(export: Export, quantity: Quantity, words: str) -> tuple[ExportColumn, str | None]:
    """Return the column and the unit named by ``COLUMN`` or ``COLUMN:UNIT``; the unit is None if it is not given.

    Raises
    ------
    InputError : there is no such column, or the unit is not one of the quantity.
    """
    name, colon, unit = words.rpartition(":")
    names = {column.name.lower() for column in export.columns}
    column = export.column(words if not colon or words.lower() in names else name)
    stated = unit if colon and words.lower() not in names else column.unit
    if not stated:
        return column, None
    known = unit_of(quantity, stated)
    if known is None and colon:
        raise InputError(
            f'{export.path}: "{shortened(stated)}" is no known unit of the {quantity}; convert the column to one of '
            f"{', '.join(QUANTITIES[quantity].units)}."
        )
    return column, known
