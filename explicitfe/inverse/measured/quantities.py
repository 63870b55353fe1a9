"""Measured quantities, their units, and common names of their columns."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from explicitfe.inverse.measured.export import Export, ExportColumn
from explicitfe.platform.errors import InputError, nearest, shortened

Quantity = Literal["time", "displacement", "force", "stretch", "stress", "shear-strain", "shear-stress"]


@dataclass(frozen=True)
class Measured:
    """Units and names of a quantity.

    Attributes
    ----------
    units : unit -> factor to the unit of a dataset, which comes first.
    names : parts of column names, in English, German, French, Spanish and Italian.
    column : name in a CSV of a dataset.
    """

    units: dict[str, float]
    names: re.Pattern[str]
    column: str


def _words(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern, re.IGNORECASE)


_POUND_FORCE_N, _GRAM_FORCE_N = 4.4482216152605, 9.80665e-3
_TIMES = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "µm": 1e-3, "um": 1e-3, "in": 25.4}
_FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "gf": _GRAM_FORCE_N, "kgf": 1e3 * _GRAM_FORCE_N, "lbf": _POUND_FORCE_N}
_STRESSES = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "psi": 6894.757293168}
_SHARES = {"1": 1.0, "%": 0.01}

QUANTITIES: dict[Quantity, Measured] = {
    "time": Measured(_TIMES, _words(r"^t$|time|zeit|temps|tiempo|tempo|sec|clock"), "time_s"),
    "displacement": Measured(
        _LENGTHS,
        _words(
            r"displ|depl|despl|sposta|exten|crosshead|traverse|weg$|^weg|compression|indent|depth|stroke|travel|position|^z$|^u$"
        ),
        "displacement_mm",
    ),
    "force": Measured(_FORCES, _words(r"force|kraft|load|last$|carico|fuerza|carga|^fz?$"), "force_N"),
    "stretch": Measured(_SHARES, _words(r"stretch|strain|dehnung|stauchung|lambda|deformation"), "stretch"),
    "stress": Measured(_STRESSES, _words(r"stress|spannung|contrainte|sforzo|tension|sigma"), "nominal_stress_Pa"),
    "shear-strain": Measured(_SHARES, _words(r"shear.?strain|gamma|scherung|strain"), "shear_strain"),
    "shear-stress": Measured(_STRESSES, _words(r"shear.?stress|tau|schub|stress"), "shear_stress_Pa"),
}
# Other ways to write a unit.
_SPELLINGS = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "minutes": "min", "newton": "N", "newtons": "N",
    "μm": "µm", "micron": "µm", "microns": "µm", "inch": "in", "gram": "gf", "g": "gf", "kg": "kgf", "lb": "lbf", "lbs": "lbf",
    "percent": "%", "mm/mm": "1", "-": "1", "pct": "%",
}  # fmt: skip


def unit_of(quantity: Quantity, word: str) -> str | None:
    """Return the unit that a word denotes, in the spelling of QUANTITIES; None if it is no unit of the quantity."""
    units = QUANTITIES[quantity].units
    word = word.strip()
    for candidate in (word, _SPELLINGS.get(word.lower(), word)):
        if candidate in units:
            return candidate
    by_lower = {unit.lower(): unit for unit in units}
    # "MPA" and "n" are unambiguous, but mN and MN differ.
    return by_lower.get(word.lower()) if word.lower() != "mn" else None


def guessed(export: Export, quantity: Quantity) -> ExportColumn | None:
    """Return the column of a quantity by its name, or by its unit if only one column has such a unit; None if there is none."""
    named = [column for column in export.columns if QUANTITIES[quantity].names.search(column.name)]
    fitting = [column for column in named if unit_of(quantity, column.unit) is not None]
    if fitting or named:
        return (fitting or named)[0]
    with_unit = [column for column in export.columns if column.unit and unit_of(quantity, column.unit) is not None]
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
