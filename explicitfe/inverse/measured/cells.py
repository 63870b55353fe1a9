"""Cells of tables of other programs: numbers with a decimal point or comma and thousands, and names with units."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS
from explicitfe.inverse.measured.quantities import is_measure, is_name, is_unit
from explicitfe.platform.errors import InputError, shortened

EMPTY_CELLS = {"", "-", "--", "---", "nan", "n/a", "na", "null", "none", "#n/a", "#nv"}
# A column that says to which of several specimens or recordings a row belongs: "Specimen", "Probe Nr.", "trial", "track_id".
_NAME_OF_GROUPS = re.compile(
    r"(specimen|sample|probe|prüfling|test|trial|track|animal|individual|subject)s?[ _.#-]*(no|nr|id|name|number|label)?\.?",
    re.IGNORECASE,
)
_WITH_UNIT = r'"?[+-]?\d[\d.,]*\s?[^\W\d]{1,4}"?'
# Beginning of a file -> what it is.
_NO_TABLES = {
    r"\APK\x03\x04|\A\xd0\xcf|\A\u00d0\u00cf": "this is a workbook, as of Excel: save its sheet as CSV",
    r"\A\s*<(!doctype|html|\?xml|table)": "this is a page of HTML or XML: open it in a spreadsheet program and save it as CSV",
    r"\A(.\0){8}|\A(\0.){8}": "this is UTF-16 without a byte-order mark: save it as UTF-8",
    rf"(?m)^{_WITH_UNIT}[\t;,]\s*{_WITH_UNIT}": "units stand behind the numbers: write them into the names of the columns",
}
_SPACES = "\u00a0\u202f\u2009 "
# Decimal mark -> numbers with it; the first group is the separator of thousands.
_NUMBERS = {
    decimal: re.compile(
        rf"[+-]?(?:(?:[1-9]\d{{0,2}}(?:([{other}'’{_SPACES}])\d{{3}})(?:\1\d{{3}})*|\d+)(?:\{decimal}\d*)?|\{decimal}\d+)"
        r"(?:[eEdD][+-]?\d+)?",
        re.ASCII,
    )
    for decimal, other in (".,", ",.")
}
_CLOCK = re.compile(r"(\d+):([0-5]?\d):([0-5]?\d(?:[.,]\d*)?)", re.ASCII)
# "Load (N)", "Load [N]", "Load {N}": a name and a unit.
BRACKETED = re.compile(r"(?P<name>.*?)\s*[(\[{<]\s*(?P<unit>[^()\[\]{}<>]*?)\s*[)\]}>]\s*")
# "Load / oz": a name and what can only be a unit. Between a name and what is a unit: "Load in N", "Load, N", "load_N", "Load N".
_AFTER_A_SLASH = re.compile(r"(?P<name>.*?)\s+/\s*(?P<unit>\S+)")
_BEFORE_A_UNIT = re.compile(r"\s+in\s+|\s*[/,:]\s*|_|\s+")


def cells_of(line: str, separator: str | None) -> list[str]:
    """The cells of a line; blanks separate where the separator is None."""
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator or " ", skipinitialspace=True), [])]
    if separator is None or not line.strip():
        return line.split()
    cells = line.split(separator)
    return [cell.strip() for cell in cells] if " " in line or not line.isascii() else cells


def refuse_several(path: Path, name: str, cells: Sequence[str]) -> None:
    """Raise InputError if the cells of a column name several specimens, trials or tracks, whose rows are no single curve."""
    values = dict.fromkeys(cell for cell in cells if cell.lower() not in EMPTY_CELLS)
    # A column "Sample" that counts the rows names none.
    if _NAME_OF_GROUPS.fullmatch(name.strip()) and 1 < len(values) <= len(cells) // SMALLEST_CURVE_ROWS:
        shown = ", ".join(map(shortened, list(values)[:3])) + (", ..." if len(values) > 3 else "")
        raise InputError(
            f'{path}: the rows belong to {len(values)} different values of the column "{shortened(name)}" ({shown}); put the '
            "rows of each into a file of its own."
        )


def why_no_table(lines: Sequence[str]) -> str:
    """What a text without a table of numbers is instead, for a sentence; empty if that is not known."""
    start = "\n".join(lines[:20])
    return next((f" ({what})" for sign, what in _NO_TABLES.items() if re.search(sign, start, re.IGNORECASE)), "")


def is_number(cell: str) -> bool:
    """Whether a cell is a number with one of the decimal marks, or a time of day."""
    try:
        float(cell)
        return cell[-1] in "0123456789."  # no nan or infinity
    except ValueError:
        return any(pattern.fullmatch(cell) is not None for pattern in (*_NUMBERS.values(), _CLOCK))


def numbers_of(cells: Sequence[str], decimal: str) -> tuple[np.ndarray, list[int], int | None]:
    """Numbers of a column.

    Returns
    -------
    values : (k,), nan where a cell is empty or has text; a time of day in s.
    texts : rows whose cell has text.
    unseparated : a row whose number has no thousands separator where others have; None if there is none.
    """
    if (numbers := plain_numbers(cells, decimal)) is not None:
        return np.array(numbers), [], None
    values = np.full(len(cells), math.nan)
    texts: list[int] = []
    plain: list[int] = []
    separated = False
    for number, cell in enumerate(cells):
        if (one := plain_numbers([cell], decimal)) is not None:
            values[number] = one[0]
            plain += [number] if abs(one[0]) >= 1000.0 and "e" not in cell.lower() else []
        elif (match := _NUMBERS[decimal].fullmatch(cell)) is not None:
            unmarked = re.sub(rf"[{_SPACES}'’{'.' if decimal == ',' else ','}]", "", cell).replace(decimal, ".")
            values[number] = float(re.sub("[dD]", "e", unmarked))
            separated |= match[1] is not None
        elif (clock := _CLOCK.fullmatch(cell)) is not None:
            values[number] = 3600 * int(clock[1]) + 60 * int(clock[2]) + float(clock[3].replace(",", "."))
        elif cell.lower() not in EMPTY_CELLS:
            texts.append(number)
    return values, texts, plain[-1] if separated and plain else None


def plain_numbers(cells: Sequence[str], decimal: str) -> list[float] | None:
    """The numbers of a column if all cells have some, without separators of thousands: most columns, at once."""
    joined = "\n".join(cells)
    if decimal == "," and "." in joined:
        return None
    try:
        return list(map(float, joined.replace(",", ".").split("\n") if decimal == "," else cells))
    except ValueError:
        return None


def decimal_mark(path: Path, columns: Sequence[Sequence[str]], line_of: Sequence[int]) -> str:
    """The decimal mark of the columns of a table, "." or ",".

    Raises
    ------
    InputError : rows have different ones, or "1,234" may be 1.234 or 1234.
    """
    first: dict[str, tuple[int, str]] = {}
    for mark, other in (".,", ",."):
        with_mark = [cells for cells in columns if mark in "".join(cells)]
        marked = ((line, cell) for cells in with_mark for line, cell in zip(line_of, cells, strict=True) if mark in cell)
        only = (row for row in marked if _NUMBERS[mark].fullmatch(row[1]) and not _NUMBERS[other].fullmatch(row[1]))
        if (row := next(only, None)) is not None:
            first[mark] = row
    if len(first) == 2:
        (a, one), (b, two) = sorted(first.values())
        raise InputError(f'{path}: "{one}" in line {a} and "{two}" in line {b} have different decimal marks; use one of them.')
    if first:
        return next(iter(first))
    # "500", "750", "1,000": a column in which only numbers from 1000 on have a mark.
    unclear, whole = [], False
    for cells in columns:
        marked = ((line, cell) for line, cell in zip(line_of, cells, strict=True) if set(cell) & set(".,"))
        unclear += (both := [row for row in marked if _NUMBERS["."].fullmatch(row[1])])
        whole |= bool(both) and any(re.fullmatch(r"[+-]?[1-9]\d\d", cell) for cell in cells)
    seen = {mark for _, cell in unclear for mark in ".," if mark in cell}
    if whole and len(seen) == 1:
        return "," if seen == {"."} else "."
    if seen <= {"."}:
        return "."
    line, cell = unclear[0]
    raise InputError(
        f'{path}, line {line}: "{cell}" may have a decimal comma or a thousands separator; export the table with a decimal point '
        "and without thousands separators."
    )


def is_unit_row(cells: Sequence[str]) -> bool:
    """Whether a line above numbers has units, with or without brackets."""
    filled = [cell for cell in cells if cell]
    bracketed = [(match := BRACKETED.fullmatch(cell)) is not None and not match["name"] for cell in filled]
    return all(bracketed) or (any(map(is_unit, filled)) and 2 * sum(map(is_unit, filled)) >= len(filled))


def name_and_unit(cell: str) -> tuple[str, str]:
    """Name and unit in a cell: "Load (N)", "Load / oz", "Load in N", "load_N"; the unit is empty if there is none."""
    match = BRACKETED.fullmatch(cell)
    if match and not is_measure(match["unit"]):
        return match["name"], match["unit"]
    for separator in _BEFORE_A_UNIT.finditer(cell):
        name, unit = cell[: separator.start()], cell[separator.end() :]
        # "Force min" is the smallest one, and "Strain 1" the first one.
        if name and is_unit(unit) and unit not in ("1", "-") and (unit != "min" or is_name(name, "time")):
            return name, unit
    match = _AFTER_A_SLASH.fullmatch(cell)
    return (match["name"], match["unit"]) if match else (cell, "")
