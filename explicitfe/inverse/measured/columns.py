"""Columns of a table by the quantity that they have."""

from __future__ import annotations

from dataclasses import dataclass

from explicitfe.inverse.measured.export import Export, ExportColumn
from explicitfe.inverse.measured.quantities import QUANTITIES, Quantity, is_unit, measure_of, unit_of
from explicitfe.platform.errors import InputError, nearest, shortened


def guessed(export: Export, quantity: Quantity) -> ExportColumn | None:
    """Return the column of a quantity by its name, or by its unit if only one column has such a unit; None if there is none."""
    # "Time at load (s)" is no force.
    possible = [c for c in export.columns if not is_unit(c.unit) or c.unit == "-" or unit_of(quantity, c.unit) is not None]
    named = [column for column in possible if QUANTITIES[quantity].names.search(column.name)]
    # An engineering strain needs no conversion; "Time" comes before "Time at load".
    words = QUANTITIES[quantity].names
    named.sort(key=lambda column: (measure_of(quantity, column.name) is not None, not words.fullmatch(column.name)))
    fitting = [column for column in named if unit_of(quantity, column.unit) is not None]
    if fitting or named:
        return (fitting or named)[0]
    with_unit = [column for column in possible if unit_of(quantity, column.unit) is not None]
    return with_unit[0] if len(with_unit) == 1 else None


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
        valid = QUANTITIES[quantity].units
        raise InputError(f'{export.path}: "{shortened(stated)}" is no unit of the {quantity}; {nearest(stated, valid)}')
    return column, known
