"""Rows as they finish, on the disk: appended, synced, and read again after any kill.

A journal is lines of JSON: now and then the names of columns, a list of texts under "columns"; else a row, a list of cells in
that order, with the columns that it has. A line that a kill tore is dropped by whoever reads it, and cut off by whoever goes on.
"""

from __future__ import annotations

import json
import os
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, NamedTuple, Self

from explicitfe.errors import InputError, MachineError
from explicitfe.host.files import WITHOUT_ROOM, lock, reason
from explicitfe.results import FINISHED
from explicitfe.sweep.rows import STATUS, Cell, Row, WrittenRow, number_of

COLUMNS_KEY = "columns"
MOST_OPEN_JOURNALS = 64


class Journal:
    """The rows that one command has computed, open for more.

    Parameters
    ----------
    path : of the journal; made where there is none.

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
            raise wrong(f"{path}: this cannot be written ({reason(error)}).") from None
        if not lock(self._number):
            os.close(self._number)
            raise InputError(f"{path}: another command computes these members; wait until it has ended.")
        whole = _whole_bytes(path)
        os.ftruncate(self._number, whole)
        os.lseek(self._number, whole, os.SEEK_SET)
        self._size = whole

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        os.close(self._number)

    def append(self, lines: Iterable[WrittenRow]) -> None:
        """Add rows; they are safe when this returns.

        Raises
        ------
        MachineError : the disk refuses; the journal is as it was.
        """
        parts = []
        columns = self._columns
        for line in lines:
            if line.columns != columns:
                columns = line.columns
                parts.append(f'{{"{COLUMNS_KEY}": {columns}}}\n')
            parts.append(f"{line.cells}\n")
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
                f"{self.path} cannot be written ({reason(error)}); all rows before are there: free space, and give the same "
                "command again to go on."
            ) from None
        self._size += len(text)
        self._columns = columns


class _StoredLine(NamedTuple):
    """A row in a journal: where its line begins, which columns it has, and the cells."""

    offset: int
    columns: int
    cells: list[Cell]


class RowPlace(NamedTuple):
    """Where the row of a member stands: which journal and where in it, which columns it has, and how the member ended."""

    journal: int
    offset: int
    columns: int
    status: str


class Stored:
    """The rows of all journals of a folder. Of two rows of a member that of one that finished counts, else the later one.

    Later is what stands in a journal that was written later, or further behind in the same.

    What is in memory is where rows stand: they are read when they are asked for, so that millions of them have room.

    Attributes
    ----------
    places : number of a member -> where its row stands.

    Raises
    ------
    InputError : a journal is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.places: dict[int, RowPlace] = {}
        self._paths = sorted(folder.glob("*.jsonl"), key=lambda path: (path.stat().st_mtime_ns, path.name))
        self._columns: list[list[str]] = []
        for journal, path in enumerate(self._paths):
            for line in _lines(path, self._columns):
                head = dict(zip(self._columns[line.columns], line.cells, strict=True))
                number, status = number_of(head), str(head[STATUS])
                if number not in self.places or self.places[number].status != FINISHED:
                    self.places[number] = RowPlace(journal, line.offset, line.columns, status)

    def __len__(self) -> int:
        """How many members have a row."""
        return len(self.places)

    def rows(self, numbers: Iterable[int] | None = None) -> Iterator[Row]:
        """Rows in the order of the members, or of some of them."""
        chosen = sorted(self.places) if numbers is None else numbers
        files: OrderedDict[int, BinaryIO] = OrderedDict()  # of jobs of an array there are more than may be open at a time
        try:
            for number in chosen:
                place = self.places[number]
                if place.journal not in files:
                    files[place.journal] = self._paths[place.journal].open("rb")
                    if len(files) > MOST_OPEN_JOURNALS:
                        files.popitem(last=False)[1].close()
                files.move_to_end(place.journal)
                file = files[place.journal]
                file.seek(place.offset)
                yield dict(zip(self._columns[place.columns], json.loads(file.readline()), strict=True))
        finally:
            for file in files.values():
                file.close()

    def names(self) -> list[str]:
        """The names of all cells, in the order in which they come, member after member."""
        used = dict.fromkeys(self.places[number].columns for number in sorted(self.places))
        return list(dict.fromkeys(name for columns in used for name in self._columns[columns]))


def _lines(path: Path, columns: list[list[str]]) -> Iterator[_StoredLine]:
    """The rows of a journal; lists of columns that are new are appended to ``columns``."""
    chosen, offset = -1, 0
    with path.open("rb") as file:
        for line in file:
            if not line.endswith(b"\n"):
                return
            try:
                entry = json.loads(line)
            except ValueError:
                raise InputError(f"{path}: a line is damaged; move this file away, and its members are computed again.") from None
            if isinstance(entry, list):
                yield _StoredLine(offset, chosen, entry)
            elif entry[COLUMNS_KEY] in columns:
                chosen = columns.index(entry[COLUMNS_KEY])
            else:
                columns.append(entry[COLUMNS_KEY])
                chosen = len(columns) - 1
            offset += len(line)


def _whole_bytes(path: Path) -> int:
    """How much of a journal is whole lines."""
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
