"""Text tables exported by other programs: header lines, column names and units, then rows of numbers.

Cells are separated by semicolons, tabs, commas or blanks. Every row with the columns of the table is read, wherever it stands
below their names; text between rows is skipped, with a note. A table is refused if more than a few rows of numbers are outside.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from explicitfe.inverse.measured.cells import (
    BRACKETED,
    EMPTY_CELLS,
    cells_of,
    decimal_mark,
    is_number,
    is_unit_row,
    name_and_unit,
    numbers_of,
    plain_numbers,
    refuse_several,
    why_no_table,
)
from explicitfe.inverse.measured.files import MOST_ROWS_OUTSIDE, MOST_ROWS_OUTSIDE_SHARE, SMALLEST_CURVE_ROWS, lines_of
from explicitfe.inverse.measured.quantities import QUANTITIES, is_name, is_unit, unit_of
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.text import text_of

# Machines record for hours at a kilohertz; long tables are thinned out later.
LARGEST_EXPORT_BYTES = 64 * 2**20
# A longer line is no row of a table. The limit is below that of the csv module for a cell, 131 072.
LONGEST_ROW_CHARACTERS = 100_000
LINES_THAT_SHOW_THE_LAYOUT = 2000
MOST_ROWS_AT_ONCE = 4096
LINES_BELOW_NAMES = 3  # So many lines of text may stand between names and rows.
LINES_OF_A_CELL = 5  # A quoted cell of a header may go on over so many lines.
SEPARATORS = (";", "\t", ",", None)  # None: blanks
# A column is one of numbers if at least this share of its cells are: a force may be out of range in most rows.
FEWEST_NUMBERS_SHARE = 0.1
_NAMES_AND_BRACKETS = re.compile(r"[^\s(\[]+(?:\s?[(\[][^)\]]*[)\]])?")
_COMMENT = re.compile(r"^\s*(#+|%+|//|!)\s*")
_KEY = re.compile(r"^\w+:\s+")  # of a line of comment: "# columns: time height force"
TWO_UNITS = " or "  # between the units of a column that has two


@dataclass(frozen=True, eq=False)
class ExportColumn:
    """A column of numbers.

    Attributes
    ----------
    name : as the file has it, without the unit.
    unit : as the file has it; empty where it has none.
    values : (k,), nan where a cell is empty or has text.
    """

    name: str
    unit: str
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Export:
    """The columns of a file.

    Attributes
    ----------
    head : lines above the names of the columns.
    line_of : (k,) line of each row, from 1 on.
    notes : what was skipped, in sentences.
    texts : name of each column without numbers -> its first cell.
    """

    path: Path
    columns: tuple[ExportColumn, ...]
    head: tuple[str, ...]
    line_of: np.ndarray
    notes: tuple[str, ...]
    texts: dict[str, str]

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
        if not chosen and choice in self.texts:
            cell = shortened(self.texts[choice])
            raise InputError(f'{self.path}: the column "{shortened(choice)}" has text ("{cell}"); export it as numbers.')
        if not chosen:
            raise InputError(f'{self.path}: there is no column "{shortened(choice)}"; {nearest(choice, names)}')
        return self.columns[chosen[0]]


@dataclass(frozen=True)
class _Layout:
    """Separator of the cells of a table, number of its columns, and which of them have numbers."""

    separator: str | None
    width: int
    numeric: tuple[int, ...]

    def count(self, cells: Sequence[str]) -> tuple[int, int]:
        """Numbers of cells with a number and of cells with text in the columns of numbers."""
        filled = [cells[k] for k in self.numeric if k < len(cells) and cells[k].lower() not in EMPTY_CELLS]
        numbers = sum(map(is_number, filled))
        return numbers, len(filled) - numbers

    def is_row(self, cells: Sequence[str]) -> bool:
        """Whether a line reaches to the last column of numbers, and has only text beyond the last column."""
        return len(cells) > self.numeric[-1] and not any(map(is_number, cells[self.width :]))

    def may_be_names(self, cells: Sequence[str]) -> bool:
        """Whether a line has a text in most columns of numbers. Where blanks separate, one of them is a usual name or a unit."""
        if self.separator is None:
            known = any(is_unit(cell) or is_name(name_and_unit(cell)[0]) for cell in cells)
            return len(cells) == self.width and known
        return 2 * sum(bool(cells[k]) for k in self.numeric if k < len(cells)) > len(self.numeric)


@dataclass
class _RowBlock:
    """Rows below the same names.

    Attributes
    ----------
    names : the lines above the rows, as cells.
    begin : line of the first of them, or of the first row.
    lines : line of each row.
    columns : cells of each column; "" where a row ends before it.
    texts, repeated : lines of text between the rows, and lines that repeat the names.
    """

    names: set[tuple[str, ...]]
    begin: int
    columns: list[list[str]]
    lines: list[int] = field(default_factory=list)
    texts: list[int] = field(default_factory=list)
    repeated: list[int] = field(default_factory=list)

    def add(self, lines: Sequence[int], columns: Iterable[Sequence[str]]) -> None:
        """Add rows, by their lines and the cells of each column."""
        self.lines += lines
        for column, cells in zip(self.columns, columns, strict=True):
            column += cells


def read_export(path: Path, *, whole: bool = True) -> Export:
    """Read the table of numbers of a text file, with the column names and units above it.

    Parameters
    ----------
    whole : read all rows, not only the first 2 000 lines.

    Raises
    ------
    InputError : the file cannot be read, is too large, or has no table of numbers in its first 2 000 lines; rows of numbers are
        not part of the table; or the decimal mark is not clear.
    """
    advice = "export the table as plain text (.csv, .txt), with fewer rows"
    text = text_of(path, advice, largest_bytes=LARGEST_EXPORT_BYTES, of_other_programs=True).replace("\u2212", "-")
    lines = lines_of(text)
    lengths = list(map(len, lines))
    if (longest := max(lengths)) > LONGEST_ROW_CHARACTERS:
        raise InputError(
            f"{path}, line {lengths.index(longest) + 1}: the line has {longest} characters, and a row of a table has at most "
            f"{LONGEST_ROW_CHARACTERS}{why_no_table(lines)}; export the table again, with one row per line."
        )
    lines = lines if whole else lines[:LINES_THAT_SHOW_THE_LAYOUT]
    lines = _whole_cells(lines) if '"' in text else lines
    layout = _layout(path, lines[:LINES_THAT_SHOW_THE_LAYOUT])
    block, notes = _table(path, lines, layout)
    names, units, top = _names(path, lines, block.lines[0] - 1, layout)
    cells = [block.columns[k] for k in layout.numeric]
    for name, column in zip(names, block.columns, strict=True):
        refuse_several(path, name, column)
    if len(layout.numeric) > len(block.lines) and sum(is_name(name_and_unit(cell)[0]) for cell in block.columns[0]) > 1:
        raise InputError(f"{path}: each quantity stands in a row; transpose the table, so that each stands in a column.")
    decimal = decimal_mark(path, cells, block.lines)
    columns = []
    texts: list[tuple[int, str]] = []
    for k, column in zip(layout.numeric, cells, strict=True):
        values, with_text, unseparated = numbers_of(column, decimal)
        if unseparated is not None:
            raise InputError(
                f'{path}, line {block.lines[unseparated]}: "{column[unseparated]}" has no thousands separator, but other numbers '
                f'of the column "{names[k]}" have; export the table without thousands separators.'
            )
        texts += [(block.lines[number], column[number]) for number in with_text]
        if not np.isnan(values).all():
            columns.append(ExportColumn(names[k], "s" if ":" in column[0] else units[k], values))
    if texts:
        line, cell = min(texts)
        notes.append(
            f'{path}: {len(texts)} cells have text instead of a number, the first one in line {line}: "{shortened(cell)}".'
        )
    others = {name: block.columns[k][0] for k, name in enumerate(names) if k not in layout.numeric}
    head = tuple(line.strip() for line in lines[:top] if line.strip())
    return Export(path, tuple(columns), head, np.array(block.lines), tuple(notes), others)


def _whole_cells(lines: list[str]) -> list[str]:
    """The same lines; a quoted cell with line breaks stands in its first line, and the others are empty."""
    lines = list(lines)
    for number, line in enumerate(lines):
        if line.count('"') % 2:
            ends = (k for k in range(number + 1, min(number + LINES_OF_A_CELL, len(lines))) if lines[k].count('"') % 2)
            end = next(ends, number)
            lines[number : end + 1] = [" ".join(lines[number : end + 1]), *[""] * (end - number)]
    return lines


def _layout(path: Path, lines: Sequence[str]) -> _Layout:
    """The separator that gives most rows with two numbers and as many cells, and the columns of numbers."""
    best, largest = None, 0.0
    for separator in SEPARATORS:
        rows: dict[int, list[list[str]]] = {}
        for line in lines:
            cells = cells_of(line, separator)
            if separator == ",":  # Thousands are separated by blanks only where cells are not separated by commas.
                cells = [cell.replace(" ", "_") for cell in cells]
            if sum(map(is_number, cells)) > 1:
                rows.setdefault(len(cells), []).append(cells)
        if not rows:
            continue
        width = max(rows, key=lambda width: (len(rows[width]), width))
        filled = [[row[k] for row in rows[width] if row[k].lower() not in EMPTY_CELLS] for k in range(width)]
        numbers = [sum(map(is_number, column)) for column in filled]
        numeric = [k for k in range(width) if numbers[k] >= FEWEST_NUMBERS_SHARE * len(filled[k])]
        # Of two readings that give as many rows the one with less text is right: "0,5 1,5" has two cells, not "5 1".
        score = len(rows[width]) - (sum(map(len, filled)) - sum(numbers)) / width
        if len(numeric) > 1 and len(rows[width]) >= SMALLEST_CURVE_ROWS and score > largest:
            best, largest = _Layout(separator, width, tuple(numeric)), score
    if best is None:
        raise InputError(
            f"{path}: no table of numbers found in the first {LINES_THAT_SHOW_THE_LAYOUT} lines{why_no_table(lines)}; export one "
            f"as text, with a column for each quantity and at least {SMALLEST_CURVE_ROWS} rows."
        )
    return best


def _table(path: Path, lines: Sequence[str], layout: _Layout) -> tuple[_RowBlock, list[str]]:
    """The longest block of rows below the same names, and notes on lines that are not read.

    Raises
    ------
    InputError : too many rows of numbers are not part of it.
    """
    blocks: list[_RowBlock] = []
    outside: list[tuple[int, str]] = []  # lines and why they are no rows of the table
    above: list[tuple[int, list[str]]] = []  # lines that may be names
    texts: list[int] = []
    filled = [number for number, line in enumerate(lines, 1) if line.strip()]
    begin, count = 0, 1
    while begin < len(filled):
        numbers_of_lines = filled[begin : begin + count]
        if blocks and not above and not texts:
            columns = _columns([lines[number - 1] for number in numbers_of_lines], layout)
            if columns is not None:
                blocks[-1].add(numbers_of_lines, columns)
                begin, count = begin + count, min(2 * count, MOST_ROWS_AT_ONCE)
                continue
        if count > 1:
            count = (count + 1) // 2
            continue
        number, begin = filled[begin], begin + 1
        cells = cells_of(lines[number - 1], layout.separator)
        numbers, words = layout.count(cells)
        # Text may stand in a row below others, and in the first one below the names where most cells are numbers.
        with_text = bool(blocks and not above) or (bool(above) and numbers > words and len(cells) == layout.width)
        if not any(cells):
            continue
        if numbers and layout.is_row(cells) and (not words or with_text):
            names = {tuple(row) for _, row in above}
            if not blocks or not names <= blocks[-1].names:
                blocks.append(_RowBlock(names, above[0][0] if above else number, [[] for _ in range(layout.width)]))
            else:
                blocks[-1].texts += texts
                blocks[-1].repeated += [line for line, _ in above]
            blocks[-1].add([number], [[cell] for cell in (cells + [""] * layout.width)[: layout.width]])
            above, texts = [], []
        elif not words and sum(map(is_number, cells)) > 1:
            outside.append((number, f"has {len(cells)} cells"))
        elif not numbers and layout.may_be_names(cells):
            above.append((number, cells))
        else:
            texts.append(number)
    for block in blocks:  # Below the last row there may be means and largest values.
        while layout.count([column[-1] for column in block.columns[: layout.numeric[0] + 1]])[1]:
            for column in block.columns:
                column.pop()
            block.texts.append(block.lines.pop())
    table = max(blocks, key=lambda block: len(block.lines))
    for block in blocks:
        if block is not table:
            outside += [(line, f"belongs to another table, which begins in line {block.begin},") for line in block.lines]
    return table, list(_about_lines(path, table, sorted(outside), layout.width))


def _columns(lines: Sequence[str], layout: _Layout) -> list[list[str]] | None:
    """The cells of each column of lines that follow a row, if all of them are rows: at once, because tables are large."""
    separator, width, text = layout.separator, layout.width, "\n".join(lines)
    if separator is None or '"' in text:
        quoted = '"' in text
        rows = (
            list(csv.reader(lines, delimiter=separator or " ", skipinitialspace=True)) if quoted else list(map(str.split, lines))
        )
        same = len(rows) == len(lines) and all(len(cells) == width for cells in rows)
        flat = [cell.strip() for cells in rows for cell in cells] if same else []
    else:
        same = all(line.count(separator) == width - 1 for line in lines)
        flat = text.replace("\n", separator).split(separator) if same else []
        flat = [cell.strip() for cell in flat] if " " in text or not text.isascii() else flat
    columns = [flat[k::width] for k in range(width)]
    return columns if flat and any(plain_numbers(columns[k], mark) for k in layout.numeric for mark in ".,") else None


def _about_lines(path: Path, table: _RowBlock, outside: Sequence[tuple[int, str]], width: int) -> Iterator[str]:
    """Notes on lines that are not read.

    Raises
    ------
    InputError : too many of them have numbers.
    """
    if outside:
        line, why = outside[0]
        count = f"{len(outside)} row{'s' * (len(outside) > 1)} of numbers"
        # A few values with names of their own are no rows that the table lacks.
        lacking = sum("another table" not in why for _, why in outside)
        if len(outside) > MOST_ROWS_OUTSIDE or lacking > MOST_ROWS_OUTSIDE_SHARE * (len(outside) + len(table.lines)):
            raise InputError(
                f"{path}, line {line}: this row {why} and is not part of the table of {width} columns that begins in line "
                f"{table.lines[0]} ({count} in all); put each table into a file of its own, and export it with the same columns "
                "in every row and without thousands separators."
            )
        yield f"{path}: {count} outside the table omitted, the first one in line {line}: it {why.removesuffix(',')}."
    if table.texts:
        first = min(table.texts)
        yield f"{path}: {len(table.texts)} lines of text between or below the rows are skipped, the first one in line {first}."
    if table.repeated:
        yield f"{path}: the names are repeated, first in line {table.repeated[0]}; all rows below are read as one table."


def _names(path: Path, lines: Sequence[str], begin: int, layout: _Layout) -> tuple[list[str], list[str], int]:
    """Names and units of the columns, from the lines above the first row, and the index of the first of these lines."""
    width = layout.width
    above: list[tuple[int, list[str]]] = []
    for number in range(begin - 1, -1, -1):
        cells = _names_in(lines[number], layout)
        # A line such as "Segment 1: ramp" may stand between names and rows.
        if lines[number].strip() and (len(above) == 2 or (cells is None and (above or number < begin - LINES_BELOW_NAMES))):
            break
        above += [(number, cells)] if cells else []
    units = next((row for row in above if is_unit_row(row[1])), None)
    names = next((row for row in above if row is not units), None)
    if names is None and begin and layout.separator == ",":
        cells = cells_of(lines[begin - 1], ",")
        if width == 2 * len(cells) and not any(map(is_number, cells)):
            raise InputError(
                f"{path}, line {begin}: there are {len(cells)} names, but {width} cells in a row; commas are both separators and "
                "decimal marks: export the table with semicolons, or with decimal points."
            )
    words = [""] * width if units is None else units[1]
    words = [match["unit"] if (match := BRACKETED.fullmatch(cell)) and not match["name"] else cell for cell in words]
    pairs = [("", "")] * width if names is None else [name_and_unit(cell) for cell in names[1]]
    return (
        [name or f"column {k + 1}" for k, (name, _) in enumerate(pairs)],
        [_one_unit(unit, word) for (_, unit), word in zip(pairs, words, strict=True)],
        min([row[0] for row in (units, names) if row is not None], default=begin),
    )


def _one_unit(in_name: str, below: str) -> str:
    """The unit of a column; both where its name and the row of units state different ones."""
    differ = "-" not in (in_name, below) and is_unit(in_name) and is_unit(below)
    differ &= any(unit_of(quantity, in_name) != unit_of(quantity, below) for quantity in QUANTITIES)
    return f"{in_name}{TWO_UNITS}{below}" if differ else in_name or below


def _names_in(line: str, layout: _Layout) -> list[str] | None:
    """The cells of a line above the rows, one per column; None if it has others, or numbers."""
    plain = _COMMENT.sub("", line)
    readings = [cells_of(text, layout.separator) for text in (line, plain, *([_KEY.sub("", plain)] if plain != line else []))]
    if layout.separator is None:
        readings += [_NAMES_AND_BRACKETS.findall(plain), re.split(r"\s{2,}|\t", plain.strip())]
    for cells in readings:
        cells = cells + [""] * (layout.width - len(cells)) if len(cells) > layout.numeric[-1] else cells
        if len(cells) >= layout.width and any(cells) and not any(cells[layout.width :]):
            cells = cells[: layout.width]
            if len(cells[0]) > 1:
                cells[0] = _COMMENT.sub("", cells[0])
            if sum(map(is_number, cells)) < (2 if plain == line else 1):
                return cells
    return None
