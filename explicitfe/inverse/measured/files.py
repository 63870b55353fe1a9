"""Parse the files of a dataset, ``dataset.toml`` and its CSVs, with line numbers for error messages."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from explicitfe.fem.inputs.sentences import explain
from explicitfe.inverse.measured.curve import COLUMNS, TIME, Kind
from explicitfe.inverse.measured.tables import RawTable
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.shipped import DATASET_FILE, dataset_folder
from explicitfe.platform.host.text import text_of, toml_of

SMALLEST_CURVE_ROWS = 3  # Two rows are a straight line: no curve.
# A table is refused if more rows of numbers than this, or a larger share, are not part of it, or go back in time.
MOST_ROWS_OUTSIDE, MOST_ROWS_OUTSIDE_SHARE = 5, 0.02
# Time and memory of a fit are proportional to the number of rows; more rows than this hardly narrow an interval.
LARGEST_CURVE_ROWS = 10_000
LARGEST_CURVE_BYTES = 16 * 2**20

_CELL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_SENSOR = re.compile(r"(.+)_([xyz])_mm")
_HEADER = re.compile(r"""\s*(\[\[?)\s*([A-Za-z_"'][^\[\],]*?)\s*\]\]?\s*(#.*)?$""")


def folder_name(path: Path | str) -> str:
    """Return the name of the folder of a dataset."""
    path = dataset_folder(path).resolve()
    return path.parent.name if path.name == DATASET_FILE else path.name


class DatasetToml:
    """``dataset.toml``: its path, its parsed tables, and errors with line numbers."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = text_of(path, f"give the folder of a dataset, which has a {DATASET_FILE} and a CSV for each curve")
        self.lines = lines_of(text)
        self.data = toml_of(text, path)

    def fault(self, keys: Sequence[str | int], sentence: str) -> InputError:
        """Error with the line of a key, or of the table that should have it."""
        line = self._line(keys)
        return InputError(f"{self.path}{'' if line is None else f', line {line}'}: {sentence}")

    def misfit(
        self,
        error: ValidationError,
        data: RawTable,
        table: type[BaseModel],
        place: Callable[[Sequence[str | int]], Sequence[str | int]] = tuple,
        prefix: str = "",
    ) -> InputError:
        """Error for a schema violation; ``place`` converts the path of a key in the data into that in the file."""
        # The sentence is about this problem: a misspelt key comes before the key that is missing because of it.
        problem = min(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        return self.fault(place(problem["loc"]), prefix + explain(error, data, table))

    def _line(self, keys: Sequence[str | int]) -> int | None:
        """Line of a key, or of the head of its table where the key is missing."""
        names = [key for key in keys if isinstance(key, str)] or [""]
        entry = next((key for key in keys[1:2] if isinstance(key, int)), 0)
        block: list[tuple[int, str]] = []
        section, seen = "", -1
        for number, line in enumerate(self.lines, 1):
            head = _HEADER.match(line)
            if head:
                section = head[2].split(".")[0].strip("\"' ")
                seen += head[1] == "[[" and head[2] == section == names[0]
            if section == names[0] and entry == max(seen, 0):
                block.append((number, line))
        if not block:  # The key stands above all tables, or in an inline table.
            top = next((k for k, line in enumerate(self.lines) if _HEADER.match(line)), len(self.lines))
            block = list(enumerate(self.lines[:top], 1))
        elif len(names) > 1:
            names = names[1:]
        for name in reversed(names):
            pattern = re.compile(rf"""(?:^|[{{,.\[])\s*["']?{re.escape(name)}["']?\s*[=.\]]""")
            for number, line in block:
                if pattern.search(line):
                    return number
        return block[0][0] if block and _HEADER.match(block[0][1]) else None


def _with_nan(row: str) -> str:
    """A row of a trajectory, in which an empty cell is a missing value."""
    return ",".join(cell if cell.strip() else "nan" for cell in row.split(","))


def lines_of(text: str) -> list[str]:
    """Lines of a text, whatever ends them on the system that wrote it."""
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def later_rows(path: Path, time_s: np.ndarray, line_of: np.ndarray | None = None) -> np.ndarray:
    """Rows (k,) of bool whose time (k,) is known and above that of all rows before; ``line_of``: their lines, for messages.

    Raises
    ------
    InputError : the time goes back in more than a few rows.
    """
    latest = np.maximum.accumulate(np.where(np.isnan(time_s), -np.inf, time_s))
    back = time_s < latest
    if back.sum() > min(MOST_ROWS_OUTSIDE, MOST_ROWS_OUTSIDE_SHARE * len(time_s)):
        first = int(back.argmax())
        line = "" if line_of is None else f", line {line_of[first]}"
        raise InputError(
            f"{path}{line}: the time goes back from {latest[first]:g} s to {time_s[first]:g} s; put tests that have their own "
            "time into files of their own, or export the time of the whole test."
        )
    return np.isfinite(time_s) & np.append(True, latest[1:] > latest[:-1])


class CurveCsv:
    """The columns of one file by name, as they stand there, with the lines they came from."""

    def __init__(self, path: Path, kind: Kind, sensors: Iterable[str]) -> None:
        self.path = path
        self.kind = kind
        lines = lines_of(text_of(path, "reduce the number of rows", largest_bytes=LARGEST_CURVE_BYTES))
        self.line_of = [number for number, line in enumerate(lines, 1) if line.strip()]
        filled = [lines[number - 1] for number in self.line_of]
        if not filled:
            raise InputError(f"{path}: the file is empty; write a header and at least {SMALLEST_CURVE_ROWS} rows.")
        names = self._names(filled[0], sensors)
        del self.line_of[0]
        rows = self._numbers(filled[1:], names)
        self.data = {name: np.ascontiguousarray(rows[:, k]) for k, name in enumerate(names)}
        self._check_time()

    def fault(self, row: int, sentence: str) -> InputError:
        """An error in a row, by its line."""
        return InputError(f"{self.path}, line {self.line_of[row]}: {sentence}")

    def sensors(self) -> dict[str, np.ndarray]:
        """Name -> positions (k, 3) [mm], in the order of the file; empty unless a trajectory."""
        if self.kind in COLUMNS:
            return {}
        names = dict.fromkeys(match[1] for match in map(_SENSOR.fullmatch, self.data) if match)
        return {name: np.column_stack([self.data[f"{name}_{axis}_mm"] for axis in "xyz"]) for name in names}

    def _names(self, header: str, sensors: Iterable[str]) -> list[str]:
        names = [name.strip().strip('"') for name in header.split(",")]
        where = f"{self.path}, line {self.line_of[0]}:"
        if len(names) == 1 and set(header) & set(";\t"):
            raise InputError(f"{where} the columns must be separated by commas, with a point in decimal numbers.")
        if self.kind not in COLUMNS:
            named = dict.fromkeys(match[1] for match in map(_SENSOR.fullmatch, names) if match)
            valid = [TIME, *(f"{sensor}_{axis}_mm" for sensor in dict.fromkeys([*named, *sensors]) for axis in "xyz")]
            should = f"a trajectory has {TIME} and, for each sensor, <sensor>_x_mm, <sensor>_y_mm and <sensor>_z_mm"
        else:
            valid = [TIME, *COLUMNS[self.kind]]
            other = f"of a test of kind {self.kind}"
            what = {"force-displacement": "with a [tool]", "uniaxial": "without a [tool]"}.get(self.kind, other)
            should = f"a curve {what} has {','.join(valid)}"
        for name in names:
            if name not in valid:
                raise InputError(f'{where} unknown column "{shortened(name)}" ({should}); {nearest(name, valid)}')
            if names.count(name) > 1:
                raise InputError(f'{where} the column "{shortened(name)}" occurs twice; remove one of them.')
        for name in valid:
            if name not in names:
                raise InputError(f'{where} the column "{shortened(name)}" is missing ({should}); add it.')
        if len(valid) == 1:
            raise InputError(f"{where} there is no sensor ({should}); add its columns.")
        return names

    def _numbers(self, rows: list[str], names: list[str]) -> np.ndarray:
        """All cells (k, columns)."""
        if len(rows) < SMALLEST_CURVE_ROWS:
            last = self.line_of[-1] if rows else 1
            count = f"{len(rows)} row{'' if len(rows) == 1 else 's'}"
            raise InputError(f"{self.path}, line {last}: the curve ends after {count}; it needs at least {SMALLEST_CURVE_ROWS}.")
        if len(rows) > LARGEST_CURVE_ROWS:
            every = -(-len(rows) // LARGEST_CURVE_ROWS)
            sentence = f"the curve has {len(rows)} rows, and at most {LARGEST_CURVE_ROWS} are allowed"
            raise InputError(f"{self.path}: {sentence}; keep one row in {every}.")
        try:
            gaps = self.kind not in COLUMNS
            numbers = np.loadtxt(map(_with_nan, rows) if gaps else rows, delimiter=",", comments=None, ndmin=2)
            known = np.isfinite(numbers) | (np.isnan(numbers) & np.array([gaps and name != TIME for name in names]))
            if numbers.shape[1] == len(names) and known.all():
                return numbers
            reason = "the cells are not finite numbers"
        except ValueError as error:
            reason = str(error)
        for row, line in enumerate(rows):
            cells = [cell.strip() for cell in line.split(",")]
            if len(cells) != len(names):
                raise self.fault(row, f"{len(cells)} cells, but {len(names)} columns; each row needs a number in each column.")
            for cell, name in zip(cells, names, strict=True):
                if not cell and self.kind not in COLUMNS and name != TIME:
                    continue
                if not _CELL.fullmatch(cell) or not math.isfinite(float(cell)):
                    raise self.fault(
                        row, f'{shortened(name)} = "{shortened(cell)}" is not a finite number; correct it or omit the row.'
                    )
        raise InputError(f"{self.path}: this cannot be read as a table of numbers: {reason}.")

    def _check_time(self) -> None:
        time = self.data[TIME]
        if time[0] != 0.0:
            raise self.fault(0, f"{TIME} starts at {time[0]:g}; it must start at 0.")
        late = np.flatnonzero(np.diff(time) <= 0.0)
        if len(late):
            before, now = time[late[0]], time[late[0] + 1]
            what = "occurs twice" if now == before else f"runs backwards, from {before:.9g}"
            raise self.fault(late[0] + 1, f"{TIME} = {now:.9g} {what}; it must increase from row to row.")
