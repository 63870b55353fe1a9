"""Rows on disk as runs finish: appended, synced, and read again after any kill.

A journal consists of lines of JSON. A line ``{"columns": [...]}`` names the columns of the rows that follow; a line
``{"crc32": "...", "cells": [...]}`` is a row, with the CRC-32 checksum of its columns and its cells as they are written. Rows of
earlier versions are lists without a checksum. A last line without a line break was torn by a kill: readers ignore it, and the
next writer removes it.
"""

from __future__ import annotations

import json
import math
import os
import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self
from zlib import crc32

from explicitfe.platform.errors import InputError, MachineError, RunWarning
from explicitfe.platform.host.files import WITHOUT_ROOM, lock, reason
from explicitfe.results.files import FINISHED
from explicitfe.simulate.sweep.rows import NUMBER, STATUS, Cell, Row, WrittenRow

COLUMNS_KEY = "columns"
LARGEST_INTEGER_OF_A_CELL = 2**63 - 1
_COLUMNS_LINE = re.compile(rb'\{"columns": (\[.*\])\}\n')
_ROW_LINE = re.compile(rb'\{"crc32": "([0-9a-f]{8})", "cells": (\[.*\])\}\n')


class Journal:
    """The rows of one command, open for appending.

    Parameters
    ----------
    path : of the journal; created if it does not exist.

    Raises
    ------
    InputError : another command writes it, or it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._columns = ""  # of the last row
        try:
            self._number = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        except OSError as error:
            wrong = MachineError if error.errno in WITHOUT_ROOM else InputError
            raise wrong(f"{path}: cannot be written ({reason(error)}).") from None
        if not lock(self._number):
            os.close(self._number)
            raise InputError(f"{path}: another command is computing these runs; wait until it has ended.")
        whole = _whole_bytes(path)
        os.ftruncate(self._number, whole)
        os.lseek(self._number, whole, os.SEEK_SET)
        self._size = whole

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        os.close(self._number)

    def append(self, lines: Iterable[WrittenRow]) -> None:
        """Add rows; they are on disk when this returns.

        Raises
        ------
        MachineError : the disk refuses; the journal is unchanged.
        """
        parts = []
        columns = self._columns
        for line in lines:
            if line.columns != columns:
                columns = line.columns
                parts.append(f'{{"{COLUMNS_KEY}": {columns}}}\n')
            checksum = crc32(f"{columns}{line.cells}".encode())
            parts.append(f'{{"crc32": "{checksum:08x}", "cells": {line.cells}}}\n')
        text = "".join(parts).encode()
        try:
            written = 0
            while written < len(text):
                written += os.write(self._number, text[written:])
            os.fsync(self._number)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._number, self._size)
                os.lseek(self._number, self._size, os.SEEK_SET)
            raise MachineError(
                f"{self.path}: cannot be written ({reason(error)}). All earlier rows are stored: free disk space, and rerun the "
                "command to resume."
            ) from None
        self._size += len(text)
        self._columns = columns


class _Columns(NamedTuple):
    """The columns of rows: their names, and the bytes of the journal that the checksum covers."""

    text: bytes
    names: tuple[str, ...]


class RowPlace(NamedTuple):
    """Where the row of a run is: its journal, offset and columns; the status of the run, and whether a checksum confirms it."""

    path: Path
    offset: int
    columns: _Columns
    status: str
    is_checked: bool


class Stored:
    """The rows of all journals of a folder. Of two rows of a run that of a finished one counts, else the later one.

    Later is the row in the journal that was modified later, or further down in the same journal. Memory holds only the places of
    the rows; they are read on demand, so that millions of them fit.

    Parameters
    ----------
    folder : of the journals.
    runs : number of runs of the sweep; a row of another run is damage. Not checked if left out.

    Attributes
    ----------
    places : number of a run -> where its row is.

    Raises
    ------
    InputError : a journal is damaged or cannot be read.
    """

    def __init__(self, folder: Path, runs: int | None = None) -> None:
        self.places: dict[int, RowPlace] = {}
        known: dict[bytes, _Columns] = {}
        unchecked = 0
        try:
            for path in sorted(folder.glob("*.jsonl"), key=lambda path: (path.stat().st_mtime_ns, path.name)):
                for number, place in _places(path, known, runs):
                    unchecked += not place.is_checked
                    if number not in self.places or self.places[number].status != FINISHED:
                        self.places[number] = place
        except OSError as error:
            raise InputError(
                f"{error.filename or folder}: cannot be read ({reason(error)}); move it out of the folder."
            ) from None
        if unchecked:
            warnings.warn(
                f"{folder}: {unchecked} rows were written by an earlier version without checksums, so changed digits in them "
                "cannot be detected.",
                RunWarning,
                stacklevel=2,
            )

    def __len__(self) -> int:
        """Number of runs that have a row."""
        return len(self.places)

    def rows(self, numbers: Iterable[int] | None = None) -> Iterator[Row]:
        """Rows of all runs in their order, or of some of them."""
        with ExitStack() as opened:
            path, file = None, None
            for number in sorted(self.places) if numbers is None else numbers:
                place = self.places[number]
                if file is None or path != place.path:  # an array of jobs has more journals than may be open at a time
                    opened.close()
                    path, file = place.path, opened.enter_context(place.path.open("rb"))
                file.seek(place.offset)
                yield dict(zip(place.columns.names, _cells(file.readline(), place.columns)[0], strict=True))

    def names(self) -> list[str]:
        """The names of all cells, in the order in which they occur, run after run."""
        used = {self.places[number].columns.text: self.places[number].columns.names for number in sorted(self.places)}
        return list(dict.fromkeys(name for names in used.values() for name in names))


def _places(path: Path, known: dict[bytes, _Columns], runs: int | None) -> Iterator[tuple[int, RowPlace]]:
    """The numbers of the runs in a journal, and where their rows are; new columns are added to ``known``."""
    columns, offset = None, 0
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            if not line.endswith(b"\n"):
                return
            try:
                if head := _COLUMNS_LINE.fullmatch(line):
                    columns = known[head[1]] = known.get(head[1]) or _columns_of(head[1])
                elif columns is None:
                    raise ValueError("it names no columns")
                else:
                    cells, is_checked = _cells(line, columns)
                    run, status = _run_of(dict(zip(columns.names, cells, strict=True)), runs)
                    yield run, RowPlace(path, offset, columns, status, is_checked)
            except (ValueError, RecursionError) as error:
                raise InputError(
                    f"{path}: line {number} is damaged ({error}). Delete the line, or move the file away if it names columns, "
                    "and rerun the sweep: it computes the missing runs."
                ) from None
            offset += len(line)


def _columns_of(text: bytes) -> _Columns:
    names = json.loads(text)
    if not all(isinstance(name, str) for name in names) or len(set(names)) < len(names) or not {NUMBER, STATUS} <= set(names):
        raise ValueError("these are no names of columns")
    return _Columns(text, tuple(names))


def _cells(line: bytes, columns: _Columns) -> tuple[list[Cell], bool]:
    """The cells of a line, and whether a checksum has confirmed them.

    Raises
    ------
    ValueError : the line is damaged.
    """
    row = _ROW_LINE.fullmatch(line)
    if row and crc32(columns.text + row[2]) != int(row[1], 16):
        raise ValueError("its checksum does not match")
    cells = json.loads(row[2] if row else line)
    if not isinstance(cells, list) or len(cells) != len(columns.names):
        raise ValueError(f"it has not one cell for each of {len(columns.names)} columns")
    if not row and not all(map(_is_cell, cells)):
        raise ValueError("a cell is no number and no text")
    return cells, row is not None


def _is_cell(value: Any) -> bool:
    """Whether a value of a row without a checksum can be a cell: a text, a finite number, None, or an outline."""
    if isinstance(value, list):
        return all(isinstance(part, int) and _is_cell(part) for part in value)
    if isinstance(value, int):
        return abs(value) <= LARGEST_INTEGER_OF_A_CELL
    return value is None or isinstance(value, str) or (isinstance(value, float) and math.isfinite(value))


def _run_of(head: Row, runs: int | None) -> tuple[int, str]:
    """The number and the status of a run; ValueError if the sweep does not have it."""
    number, status = head[NUMBER], head[STATUS]
    if type(number) is not int or number < 0 or (runs is not None and number >= runs):
        raise ValueError(f"the sweep has no run {number!r}")
    if not isinstance(status, str):
        raise ValueError("its status is no text")
    return number, status


def _whole_bytes(path: Path) -> int:
    """The size of the complete lines of a journal."""
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        end = file.tell()
        while end > 0:
            begin = max(0, end - 65536)
            file.seek(begin)
            place = file.read(end - begin).rfind(b"\n")
            if place >= 0:
                return begin + place + 1
            end = begin
    return 0
