"""Recordings in text tables: of any program whose columns are named by sensor and axis, in one or in several header lines.

A program is recognised by its header (``LAYOUTS``), which says where unit, sampling rate and number of rows stand. The columns of
all of them are read alike. TRC, MOT and STO are documented by OpenSim, the other formats by Motive, Qualisys Track Manager and
DeepLabCut; that of NDI WaveFront is known from readers of its users.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from explicitfe.inverse.measured.cells import EMPTY_CELLS, cells_of, numbers_of, refuse_several, why_no_table
from explicitfe.inverse.measured.curve import TIME
from explicitfe.inverse.measured.files import MOST_ROWS_OUTSIDE, SMALLEST_CURVE_ROWS, lines_of
from explicitfe.inverse.measured.marker_file import LARGEST_RECORDING_MIB, Markers, mm_per_unit, plain_names
from explicitfe.inverse.measured.marker_header import ANY_TABLE, AXES, LAYOUTS, LIKELIHOOD, Layout, MarkerColumn, columns_of
from explicitfe.inverse.measured.quantities import QUANTITIES, unit_of
from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.text import text_of

LINES_THAT_SHOW_SEPARATORS = 400
# Below it DeepLabCut, too, leaves points out of its pictures and trajectories (pcutoff).
LEAST_LIKELIHOOD = 0.6
LARGEST_DIFFERENCE_OF_RATES_SHARE = 0.02
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_NO_VALUE = EMPTY_CELLS | {"missing", "inf", "-inf"}
_FRAME = re.compile(r"(frame|field)s?(_idx)?\W*|coords|fnum", re.IGNORECASE)
_STATUS = re.compile(r"(.+?)[_ .:-](status|state)", re.IGNORECASE)
_STATUS_OK = {"ok", "55", ""}  # the number of old programs of NDI


@dataclass(frozen=True, eq=False)
class _Sheet:
    """Cells of a table: those of the header, and of the rows with the lines they stand in."""

    path: Path
    layout: Layout
    text: str  # of the header
    head: list[list[str]]
    rows: list[list[str]]
    lines: list[int]
    decimal_comma: bool

    def value_of(self, key: str) -> str:
        """Value of a key of the header; empty if there is none."""
        if not key:
            return ""
        if self.layout.below:
            for names, values in zip(self.head, self.head[1:], strict=False):
                if key in names[: len(values)]:
                    return values[names.index(key)]
        match = re.search(rf"(?im)(?<![\w ])(?:{key})[ \t]*[=,;\t ][ \t]*\"?([^,;\t\r\n\"]+)", self.text)
        return match[1].strip() if match else ""

    def number(self, key: str) -> float:
        """Value of a key that is a number; nan if there is none."""
        text = self.value_of(key).replace(",", ".")
        return float(text) if _NUMBER.fullmatch(text) else np.nan

    def values(self, column: MarkerColumn) -> np.ndarray:
        """Numbers of a column; nan where a cell is empty."""
        cells = ["" if _is_missing(row[column.number]) else row[column.number] for row in self.rows]
        points = [cell.replace(",", ".") for cell in cells] if self.decimal_comma else cells
        values, texts, _ = numbers_of(points, ".")
        for k in texts:
            raise InputError(
                f'{self.path}, line {self.lines[k]}: "{shortened(cells[k])}" in the column "{column.words}" is no number; '
                f"leave the cell empty where a value is missing."
            )
        return values


def read_marker_table(path: Path, *, unit: str | None = None, rate_hz: float | None = None, trace: bool = False) -> Markers:
    """Read a recording from a text table.

    Parameters
    ----------
    unit : of coordinates; of those whose columns do not name one, if the program is not known.
    rate_hz : sampling rate, in place of the times in the file.
    trace : whether the rows are points of one line, without times; its columns may be axes without the name of a sensor.

    Raises
    ------
    InputError : the file cannot be read, a row is no row of numbers, or axes, units or times are missing or wrong.
    """
    notes: list[str] = []
    advice = "export the table as plain text (.csv, .txt), with fewer rows"
    sheet = _sheet(path, text_of(path, advice, largest_bytes=LARGEST_RECORDING_MIB * 2**20, of_other_programs=True))
    if sheet.layout.program == "Qualisys" and sheet.value_of("DATA_INCLUDED") == "6D":
        raise InputError(f"{path}: the file has positions and rotations of rigid bodies (6D); export the markers (3D).")
    columns = columns_of(path, sheet.head, len(sheet.rows[0]))
    if trace and not any(column.axis for column in columns):
        columns = [replace(c, name=path.stem, axis=c.name.lower()) if c.name.lower() in AXES else c for c in columns]
    sensors = _sensors(sheet, columns)
    coordinates = {name: {axis: _lengths(sheet, c, unit, notes) for axis, c in axes.items()} for name, axes in sensors.items()}
    read = [column for axes in sensors.values() for column in axes.values()]
    for name, column, usable in _quality(sheet, columns):
        read.append(column)
        if name in coordinates:
            lost = np.isfinite(list(coordinates[name].values())).all(axis=0) & ~usable
            if lost.any():
                notes.append(f'{path}: {name} is missing in {lost.sum()} rows, by the column "{column.words}".')
            coordinates[name] = {axis: np.where(usable, values, np.nan) for axis, values in coordinates[name].items()}
    if sheet.layout.image and all(set(axes) == {"x", "y"} for axes in coordinates.values()):
        notes.append(f"{path}: y of a picture points down; its sign is reversed.")
        coordinates = {name: {"x": axes["x"], "y": -axes["y"]} for name, axes in coordinates.items()}
    if trace:
        return Markers(np.arange(len(sheet.rows), dtype=float), coordinates, notes)
    others = [column for column in columns if column not in read]
    for column in others:
        refuse_several(path, column.name, [row[column.number] for row in sheet.rows])
    time_s, used = _times(sheet, others, rate_hz, notes)
    if extra := [column.words for column in others if column not in used]:
        notes.append(f"{path}: columns that are no coordinates are ignored: {some_names(extra)}.")
    return Markers(
        time_s, {plain: coordinates[name] for plain, name in zip(plain_names([*sensors]), sensors, strict=True)}, notes
    )


def _sheet(path: Path, text: str) -> _Sheet:
    """Split a text into cells, and find where its rows of numbers begin."""
    lines = lines_of(text.rstrip("\r\n "))
    if re.search(r"(?im)^DataType=Vec3\b", text):  # three numbers in a cell
        end = next((k for k, line in enumerate(lines) if line.strip().lower() == "endheader"), 0) + 2
        names = [f"{name} {axis}" for name in lines[end - 1].split("\t")[1:] for axis in "xyz"] if len(lines) > end else []
        lines[end - 1 :] = ["\t".join(["time", *names]), *(line.replace(",", "\t") for line in lines[end:])]
    best: tuple[tuple[int, int, int], str | None, bool] = ((0, 0, 0), None, False)
    for separator in ("\t", ";", ",", None):  # None: blanks
        for decimal_comma in (False, True):
            shown = [cells_of(line, separator) for line in lines[:LINES_THAT_SHOW_SEPARATORS]]
            counts = _counts(shown, decimal_comma)
            # Only lines with equal numbers of cells are rows of one table; others, such as events, stand above it.
            tables: dict[int, list[tuple[int, int]]] = {0: []}
            for row, (count, of) in zip(shown, counts, strict=True):
                if count > 1 and 2 * count > of:
                    tables.setdefault(len(row), []).append((count, of - count))
            rows_alike = max(tables.values(), key=len)
            numbers, texts = (sum(column) for column in zip(*rows_alike, strict=True)) if rows_alike else (0, 0)
            # Blanks may also separate words in a cell.
            score = len(rows_alike), -texts, numbers if separator else 0
            best = max(best, (score, separator, decimal_comma), key=lambda reading: reading[0])
    _, separator, decimal_comma = best
    cells = [cells_of(line, separator) for line in lines]
    widths = [len(row) for row in cells]
    for row in cells:  # exports to spreadsheets end all lines with separators
        while len(row) > 1 and not row[-1]:
            row.pop()
    counts = _counts(cells, decimal_comma)
    filled = [k for k, row in enumerate(cells) if any(row)]
    full = [2 * counts[k][0] > counts[k][1] for k in filled]  # two such rows follow the first row of the table
    begin = next((k for n, k in enumerate(filled[:-2]) if counts[k][0] > 1 and all(full[n : n + 3])), None)
    if begin is None:
        raise InputError(
            f"{path}: no table of numbers found{why_no_table(lines)}; export one as text, with a column for each coordinate and "
            f"at least {SMALLEST_CURVE_ROWS} rows."
        )
    head_text = "\n".join(lines[:begin]).lstrip()
    layout = next((layout for layout in LAYOUTS if re.search(layout.sign, head_text)), ANY_TABLE)
    head = [row for row in cells[:begin] if any(row)]
    rows = [k for k in range(begin, len(cells)) if lines[k].strip(" ")]
    for k in rows:
        if counts[k][1] > 2 * counts[k][0]:
            raise InputError(
                f'{path}, line {k + 1}: "{shortened(lines[k])}" is no row of the table that begins in line {begin + 1}; '
                f"remove it, or export the recording again."
            )
    width = max(len(cells[k]) for k in rows)
    if short := [k for k in rows if widths[k] < width]:
        sentence = f"{path}, line {short[0] + 1}: {widths[short[0]]} cells, and other rows have {width}"
        raise InputError(f"{sentence}; separate the cells by commas or tabs, also those that are empty.")
    width = max(width, len(head[-1]) if head else 0)
    padded = [cells[k] + [""] * (width - len(cells[k])) for k in rows]
    return _Sheet(path, layout, head_text, head, padded, [k + 1 for k in rows], decimal_comma)


def _counts(rows: Sequence[Sequence[str]], decimal_comma: bool) -> list[tuple[int, int]]:
    """Numbers of cells of each row with a number, and with anything."""
    commas = [[cell.replace(",", ".") for cell in row] for row in rows] if decimal_comma else rows
    return [(sum(_NUMBER.fullmatch(cell) is not None for cell in row), len(row) - sum(map(_is_missing, row))) for row in commas]


def _is_missing(cell: str) -> bool:
    return cell.lower() in _NO_VALUE


def _sensors(sheet: _Sheet, columns: Sequence[MarkerColumn]) -> dict[str, dict[str, MarkerColumn]]:
    """Sensor -> axis -> column; where some columns are lengths, those of another unit are left out."""
    sensors: dict[str, dict[str, MarkerColumn]] = {}
    coordinates = [column for column in columns if column.axis not in ("", LIKELIHOOD)]
    lengths = [column for column in coordinates if not column.unit or unit_of("displacement", column.unit)]
    for column in lengths or coordinates:
        axes = sensors.setdefault(column.name, {})
        if column.axis in axes:
            raise InputError(f'{sheet.path}: two columns are called "{column.words}"; give each sensor its own name.')
        axes[column.axis] = column
    if not sensors:
        trace = any(column.name.lower() in AXES for column in columns)
        advice = "name them SENSOR_AXIS_UNIT, such as T1_x_mm or TT_up_mm"
        if sheet.layout.program == "OpenSim":
            advice = "rotations are no positions: give positions (.trc), or those of a point or body kinematics analysis"
        raise InputError(
            f"{sheet.path}: no column is a coordinate of a sensor; {advice}. Columns: {some_names([c.name for c in columns])}."
            f"{' A trace of the palate is drawn by `compare --palate`.' if trace else ''}"
        )
    return sensors


def _quality(sheet: _Sheet, columns: Sequence[MarkerColumn]) -> Iterator[tuple[str, MarkerColumn, np.ndarray]]:
    """Sensor, column that says where its values are usable, and these rows."""
    for column in columns:
        if column.axis == LIKELIHOOD:
            yield column.name, column, ~(sheet.values(column) < LEAST_LIKELIHOOD)
        elif sheet.layout.program == "NDI Wave" and (match := _STATUS.fullmatch(column.name)):
            yield match[1], column, np.array([row[column.number].lower() in _STATUS_OK for row in sheet.rows])


def _lengths(sheet: _Sheet, column: MarkerColumn, unit: str | None, notes: list[str]) -> np.ndarray:
    """Coordinates in mm."""
    of_file = sheet.value_of(sheet.layout.unit_key) or sheet.layout.unit
    stated = column.unit or ("" if sheet.layout.program else unit or "")
    if not stated and not sheet.layout.program:
        raise InputError(
            f'{sheet.path}: the unit of "{column.words}" is not known; give `unit` mm or `unit` m, or name the column '
            f"{column.words}_mm."
        )
    if column.unit and unit_of("displacement", column.unit) is None:
        valid = ", ".join(QUANTITIES["displacement"].units)
        raise InputError(f'{sheet.path}: "{shortened(stated)}" of "{column.words}" is no unit of length; use {valid}.')
    on_unit: list[str] = []
    factor = mm_per_unit(sheet.path, stated or of_file, None if stated else unit, "", on_unit)
    notes += [note for note in on_unit if note not in notes]
    return factor * sheet.values(column)


def _times(
    sheet: _Sheet, others: Sequence[MarkerColumn], rate_hz: float | None, notes: list[str]
) -> tuple[np.ndarray, list[MarkerColumn]]:
    """Times (k,) s, and the columns that they are from."""
    path, count = sheet.path, len(sheet.rows)
    stated = sheet.number(sheet.layout.rows)
    if stated > count:
        raise InputError(
            f"{path}: the table ends after {count} of {stated:g} rows ({sheet.layout.rows.partition('|')[0]}); export the "
            f"recording again, or correct the number."
        )
    frame = next((column for column in others if _FRAME.fullmatch(column.name)), None)
    by_unit = [column for column in others if column.unit and unit_of("time", column.unit)]
    named = [column for column in others if QUANTITIES["time"].names.search(column.name)]
    time = next(iter([c for c in named if c in by_unit] or named or (by_unit if len(by_unit) == 1 else [])), None)
    of_file = sheet.number(sheet.layout.rate)
    if rate_hz is not None or (time is None and of_file > 0.0):
        numbers = np.arange(count, dtype=float) if frame is None else sheet.values(frame)
        steps = np.diff(numbers)
        if (again := int((steps <= 0.0).sum())) > MOST_ROWS_OUTSIDE:
            raise InputError(
                f"{path}: the number of the frame repeats or goes back in {again} rows; put each track or trial into a file of "
                "its own."
            )
        if not (np.median(steps) == 1.0 and (steps > 0.0).all()):
            notes.append(
                f"{path}: the numbers of the frames do not count the rows; {rate_hz or of_file:g} Hz is taken as their rate."
            )
            numbers = np.arange(count, dtype=float)
        return (numbers - numbers[0]) / (rate_hz or of_file), [frame] if frame else []
    if time is None:
        raise InputError(f"{path}: there is no time column; name one {TIME}, or give the sampling rate with `rate_hz`.")
    unit = unit_of("time", time.unit or ("s" if sheet.layout.program else ""))
    if unit is None:
        raise InputError(
            f'{path}: the unit of "{time.words}" is not known; name the column time_s or time_ms, or give the '
            f"sampling rate with `rate_hz`."
        )
    times = QUANTITIES["time"].units[unit] * sheet.values(time)
    rate = 1.0 / max(float(np.nanmedian(np.diff(times))), 1e-9)
    if abs(rate - of_file) > LARGEST_DIFFERENCE_OF_RATES_SHARE * of_file:
        notes.append(f"{path}: the times of the rows mean {rate:.5g} Hz and the header says {of_file:g} Hz; the times are used.")
    return times, [time, *([frame] if frame else [])]


def some_names(names: Sequence[str]) -> str:
    """Some names for a message, and the number of the others."""
    most = 5
    shown = ", ".join(map(shortened, names[:most]))
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
