"""Rows as they finish, on the disk: appended, synced, and read again after any kill.

A journal is lines of JSON: now and then the names of columns, a list of texts under "columns"; else a row, a list of cells in
that order, with the columns that it has. A line that a kill tore is dropped by whoever reads it, and cut off by whoever goes on.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from explicitfe.errors import InputError, MachineError
from explicitfe.host.files import lock, reason
from explicitfe.results import FINISHED
from explicitfe.sweep.rows import STATUS, Row, number_of

COLUMNS_KEY = "columns"


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
        self._columns: list[str] = []
        try:
            self._number = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        except OSError as error:
            raise InputError(f"{path}: this cannot be written ({reason(error)}).") from None
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

    def append(self, rows: Sequence[Row]) -> None:
        """Add rows; they are safe when this returns.

        Raises
        ------
        MachineError : the disk refuses; the journal is as it was.
        """
        lines = []
        columns = self._columns
        for row in rows:
            if list(row) != columns:
                columns = list(row)
                lines.append(json.dumps({COLUMNS_KEY: columns}))
            lines.append(json.dumps(list(row.values()), allow_nan=False))
        text = "".join(f"{line}\n" for line in lines).encode()
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


def rows_in(path: Path) -> Iterable[Row]:
    """The rows of a journal, in the order in which they were computed."""
    columns: list[str] = []
    with path.open("rb") as file:
        for line in file:
            if not line.endswith(b"\n"):
                return
            try:
                entry = json.loads(line)
            except ValueError:
                raise InputError(
                    f"{path}: a line of it is damaged; move this file away, and its members are computed again."
                ) from None
            if isinstance(entry, dict):
                columns = entry[COLUMNS_KEY]
            else:
                yield dict(zip(columns, entry, strict=True))


def rows_of_all(folder: Path) -> dict[int, Row]:
    """The rows of all journals of a folder, by the number of the member; of two of a member one that finished, else the later."""
    rows: dict[int, Row] = {}
    for path in sorted(folder.glob("*.jsonl")):
        for row in rows_in(path):
            number = number_of(row)
            if number not in rows or rows[number][STATUS] != FINISHED:
                rows[number] = row
    return rows


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
