"""Text tables exported by other programs: header lines, column names and units, then rows of numbers.

Cells are separated by commas, semicolons, tabs or blanks. Decimals have a point or, where commas are not separators, a comma.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS, lines_of
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.text import text_of

# Machines record for hours at a kilohertz; long tables are thinned out later.
LARGEST_EXPORT_BYTES = 64 * 2**20
# A longer line is no row of a table. The limit is below that of the csv module for a cell, 131 072.
LONGEST_ROW_CHARACTERS = 100_000
LINES_THAT_SHOW_THE_LAYOUT = 2000
SEPARATORS = (";", "\t", ",", None)  # None: blanks
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_MISSING = {"", "-", "--", "nan", "n/a", "na", "null"}
# "Load (N)", "Load [N]", "Load / N", "Load, N", "load_N": a name and a unit.
_NAMED_UNIT = (
    re.compile(r"(?P<name>.*?)\s*[(\[]\s*(?P<unit>[^()\[\]]*?)\s*[)\]]\s*"),
    re.compile(r"(?P<name>.*?)\s*(?:/|,\s)\s*(?P<unit>\S+)"),
    re.compile(r"(?P<name>.+)_(?P<unit>s|ms|min|mm|cm|m|um|N|mN|kN|Pa|kPa|MPa)"),
)
_BRACKETED = re.compile(r"\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]\s*")


@dataclass(frozen=True, eq=False)
class ExportColumn:
    """A column of numbers.

    Attributes
    ----------
    name : as the file has it, without the unit.
    unit : as the file has it; empty where it has none.
    values : (k,), nan where a cell is empty.
    """

    name: str
    unit: str
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Export:
    """The columns of a file, the lines above them, and the line in which the first number stands."""

    path: Path
    columns: tuple[ExportColumn, ...]
    head: tuple[str, ...]
    first_line: int

    def column(self, choice: str) -> ExportColumn:
        """A column by its name, or by its number from 1 on.

        Raises
        ------
        InputError : there is none, or there are several of that name.
        """
        names = [column.name for column in self.columns]
        chosen = [k for k, name in enumerate(names) if name == choice] or [
            k for k, name in enumerate(names) if name.lower() == choice.lower()
        ]
        if not chosen and choice.isascii() and choice.isdecimal() and 1 <= int(choice) <= len(names):
            chosen = [int(choice) - 1]
        if len(chosen) > 1:
            numbers = " or ".join(str(k + 1) for k in chosen)
            raise InputError(f'{self.path}: {len(chosen)} columns are called "{shortened(choice)}"; give the number, {numbers}.')
        if not chosen:
            raise InputError(f'{self.path}: there is no column "{shortened(choice)}"; {nearest(choice, names)}')
        return self.columns[chosen[0]]


def read_export(path: Path) -> Export:
    """Read the longest block of numeric rows of a text file, with the column names and units above it.

    Raises
    ------
    InputError : the file cannot be read, is too large, or has no table of numbers in its first 2 000 lines.
    """
    advice = "export the table as plain text (.csv, .txt), with fewer rows"
    lines = lines_of(text_of(path, advice, largest_bytes=LARGEST_EXPORT_BYTES, of_other_programs=True))
    longest = max(range(len(lines)), key=lambda number: len(lines[number]))
    if len(lines[longest]) > LONGEST_ROW_CHARACTERS:
        raise InputError(
            f"{path}, line {longest + 1}: the line has {len(lines[longest])} characters, and a row of a table has at most "
            f"{LONGEST_ROW_CHARACTERS}; export the table again, with one row per line."
        )
    best: tuple[int, int, str | None, bool] = (0, 0, None, False)
    for separator in SEPARATORS:
        for decimal_comma in (False, True):
            begin, end = _longest_block(lines[:LINES_THAT_SHOW_THE_LAYOUT], separator, decimal_comma)
            # Of two readings that give as many rows the one with more columns is right: "1,5;2,5" has two, not one.
            if (end - begin, _width(lines, begin, end, separator)) > (best[1] - best[0], _width(lines, *best[:3])):
                best = begin, end, separator, decimal_comma
    begin, end, separator, decimal_comma = best
    if end - begin < SMALLEST_CURVE_ROWS:
        raise InputError(
            f"{path}: no table of numbers found in the first {LINES_THAT_SHOW_THE_LAYOUT} lines; export one as text, with a "
            f"column for each quantity and at least {SMALLEST_CURVE_ROWS} rows."
        )
    values = _block_to_the_end(lines[begin:], separator, decimal_comma)
    if values is None:
        begin, end = _longest_block(lines, separator, decimal_comma)
        values = np.array([[_value(cell, decimal_comma) for cell in _cells(line, separator)] for line in lines[begin:end]])
    names, units, head_end = _names(lines, begin, separator, values.shape[1])
    filled = [k for k in range(values.shape[1]) if not np.isnan(values[:, k]).all()]
    columns = tuple(ExportColumn(names[k], units[k], values[:, k]) for k in filled)
    head = tuple(line.strip() for line in lines[:head_end] if line.strip())
    return Export(path, columns, head, begin + 1)


def _block_to_the_end(lines: list[str], separator: str | None, decimal_comma: bool) -> np.ndarray | None:
    """All lines as numbers (rows, columns), about five times faster than cell by cell; None where they are anything else."""
    text = "\n".join(lines).rstrip()
    try:
        values = np.loadtxt((text.replace(",", ".") if decimal_comma else text).split("\n"), delimiter=separator, ndmin=2)
    except ValueError:
        return None
    blank = "\n\n" in text or values.shape[1] < 2
    return None if blank or not np.isfinite(values).all() else values


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))] if line.strip() else []


def _value(cell: str, decimal_comma: bool) -> float:
    """A number; nan for an empty cell."""
    text = cell.replace(",", ".") if decimal_comma else cell
    return float(text) if _NUMBER.fullmatch(text) else math.nan


def _is_row(cells: list[str], decimal_comma: bool) -> bool:
    """Whether there are two cells or more: numbers, one at least, and empty ones."""
    if decimal_comma:
        cells = [cell.replace(",", ".") for cell in cells]
    numbers = sum(_NUMBER.fullmatch(cell) is not None for cell in cells)
    return numbers >= 1 and len(cells) >= 2 and all(cell.lower() in _MISSING or _NUMBER.fullmatch(cell) for cell in cells)


def _longest_block(lines: list[str], separator: str | None, decimal_comma: bool) -> tuple[int, int]:
    """First row, and that behind the last, of the longest run of rows of numbers with as many cells."""
    best, begin, width = (0, 0), 0, 0
    for number, line in enumerate([*lines, ""]):
        cells = _cells(line, separator)
        columns = len(cells) if _is_row(cells, decimal_comma) else 0
        if columns != width:
            if width and number - begin > best[1] - best[0]:
                best = begin, number
            begin, width = number, columns
    return best


def _width(lines: list[str], begin: int, end: int, separator: str | None) -> int:
    return len(_cells(lines[begin], separator)) if end > begin else 0


def _names(lines: list[str], begin: int, separator: str | None, width: int) -> tuple[list[str], list[str], int]:
    """Names and units of the columns, from the one or two lines above them; and where these lines begin."""
    above = []
    for number in range(begin - 1, max(begin - 3, -1), -1):
        cells = _cells(lines[number], separator)
        if len(cells) != width or not any(cells):
            break
        above.append(cells)
    if not above:
        return [f"column {k + 1}" for k in range(width)], [""] * width, begin
    units = [match[1] if (match := _BRACKETED.fullmatch(cell)) else None for cell in above[0]]
    if len(above) == 2 and all(unit is not None or not cell for unit, cell in zip(units, above[0], strict=True)):
        return above[1], [unit or "" for unit in units], begin - 2
    pairs = [_name_and_unit(cell) for cell in above[0]]
    return [name or f"column {k + 1}" for k, (name, _) in enumerate(pairs)], [unit for _, unit in pairs], begin - 1


def _name_and_unit(cell: str) -> tuple[str, str]:
    for pattern in _NAMED_UNIT:
        match = pattern.fullmatch(cell.strip())
        if match:
            return match["name"].strip(), match["unit"]
    return cell.strip(), ""
