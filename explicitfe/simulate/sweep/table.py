"""The table of a sweep as CSV and Parquet: one row per run, one column per number."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from explicitfe.platform.errors import MachineError
from explicitfe.platform.host.extras import has_extra
from explicitfe.platform.host.files import one_at_a_time, reason
from explicitfe.results.files.folder import whole_stream
from explicitfe.simulate.sweep.journal import Stored
from explicitfe.simulate.sweep.members import Members
from explicitfe.simulate.sweep.rows import BESIDE_THE_TABLE, MESSAGE, NAME, NUMBER, STATUS, Cell, Row, number_of

TABLE_FILE, PARQUET_FILE, PARTIAL_FILE = "table.csv", "table.parquet", "table.partial.csv"
LOCK_FILE = "table.lock"
ROWS_OF_A_PIECE = 10_000
ABOUT_A_RUN = (NUMBER, NAME, STATUS, MESSAGE)


def columns_of(stored: Stored, keys: Iterable[str]) -> list[str]:
    """Columns in their order: the number of the run, the factors, its status, then all numbers."""
    head = [NUMBER, *keys, *(name for name in ABOUT_A_RUN if name != NUMBER)]
    return [*head, *(name for name in stored.names() if name not in (*head, *BESIDE_THE_TABLE))]


def write_table(out: Path, rows: Path, members: Members) -> tuple[Stored, list[str]]:
    """Write the tables of a sweep, each as a whole; give the stored rows and the names of the files.

    A table that lacks runs has another name. Concurrent commands wait for each other here, so that the last one sees all rows.

    Parameters
    ----------
    rows : the folder of the journals.

    Raises
    ------
    MachineError : a table cannot be written.
    """
    try:
        with one_at_a_time(rows / LOCK_FILE):
            stored = Stored(rows, len(members))
            return stored, _write_tables(out, members, stored)
    except OSError as error:
        raise MachineError(
            f"{out}: the table cannot be written ({reason(error)}). All rows are stored: free disk space, and rerun the command."
        ) from None


def _write_tables(out: Path, members: Members, stored: Stored) -> list[str]:
    columns = columns_of(stored, members.keys)
    if len(stored) < len(members):
        for name in (TABLE_FILE, PARQUET_FILE):
            (out / name).unlink(missing_ok=True)
        _write_csv(out / PARTIAL_FILE, columns, members, stored)
        return [str(out / PARTIAL_FILE)]
    written = [out / TABLE_FILE]
    kinds = _write_csv(out / TABLE_FILE, columns, members, stored)
    if has_extra("parquet"):
        _write_parquet(out / PARQUET_FILE, columns, members, stored, kinds)
        written.append(out / PARQUET_FILE)
    with suppress(OSError):
        (out / PARTIAL_FILE).unlink(missing_ok=True)
    return [str(path) for path in written]


def _line(columns: list[str], members: Members, row: Row) -> list[Cell]:
    number = number_of(row)
    varied = dict(zip(members.keys, members.values[number], strict=True))
    return [_cell(varied[name]) if name in varied else row.get(name) for name in columns]


def _cell(value: object) -> Cell:
    return value if isinstance(value, (bool, int, float, str)) else str(value)


def _write_csv(path: Path, columns: list[str], members: Members, stored: Stored) -> list[set[type]]:
    """Write a table row by row; give the types of the cells of each column."""
    kinds: list[set[type]] = [set() for _ in columns]
    with whole_stream(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        for row in stored.rows():
            line = _line(columns, members, row)
            writer.writerow(line)
            for kind, cell in zip(kinds, line, strict=True):
                if cell is not None:
                    kind.add(type(cell))
        text.detach()
    return kinds


def _write_parquet(path: Path, columns: list[str], members: Members, stored: Stored, kinds: list[set[type]]) -> None:
    """Write the same table as Parquet; a column of numbers and texts, such as a resolution, becomes a column of texts."""
    import pyarrow
    import pyarrow.parquet

    types = [_type_of(kind) for kind in kinds]
    schema = pyarrow.schema([(name, getattr(pyarrow, kind)()) for name, kind in zip(columns, types, strict=True)])
    with whole_stream(path) as file, pyarrow.parquet.ParquetWriter(file, schema) as writer:
        lines = (_line(columns, members, row) for row in stored.rows())
        while some := list(itertools.islice(lines, ROWS_OF_A_PIECE)):
            arrays = [
                [None if cell is None else str(cell) for cell in cells] if kind == "string" else list(cells)
                for kind, cells in zip(types, zip(*some, strict=True), strict=True)
            ]
            pieces = [pyarrow.array(cells, field.type) for cells, field in zip(arrays, schema, strict=True)]
            writer.write_table(pyarrow.Table.from_arrays(pieces, schema=schema))


def _type_of(kinds: set[type]) -> str:
    if kinds == {bool}:
        return "bool_"
    if kinds == {int}:
        return "int64"
    return "float64" if kinds and kinds <= {int, float} else "string"
