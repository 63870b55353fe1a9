"""The table of a sweep: a line for each member, a column for each number, as CSV and as Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from explicitfe.errors import MachineError
from explicitfe.host.extras import has_extra
from explicitfe.host.files import reason
from explicitfe.results.folder import whole_file
from explicitfe.sweep.members import Members
from explicitfe.sweep.rows import BESIDE_THE_TABLE, MESSAGE, NAME, NUMBER, STATUS, Cell, Row, number_of

TABLE_FILE, PARQUET_FILE, PARTIAL_FILE = "table.csv", "table.parquet", "table.partial.csv"
ABOUT_A_RUN = (NUMBER, NAME, STATUS, MESSAGE)


def columns_of(rows: Iterable[Row], keys: Iterable[str]) -> list[str]:
    """Columns in their order: the member, what was varied, then all numbers in the order in which they first come."""
    numbers = dict.fromkeys(name for row in rows for name in row)
    head = [NUMBER, *keys, *(name for name in ABOUT_A_RUN if name != NUMBER)]
    return [*head, *(name for name in numbers if name not in (*head, *BESIDE_THE_TABLE))]


def write_table(out: Path, members: Members, rows: Mapping[int, Row]) -> list[str]:
    """Write the tables of a sweep, each as a whole; the names of the files.

    A table that lacks members has another name, and takes none of the place of one that is complete.

    Raises
    ------
    MachineError : they cannot be written.
    """
    complete = len(rows) == len(members)
    columns = columns_of(rows.values(), members.keys)
    try:
        if not complete:
            for name in (TABLE_FILE, PARQUET_FILE):
                (out / name).unlink(missing_ok=True)
            whole_file(out / PARTIAL_FILE, _csv(columns, members, rows))
            return [str(out / PARTIAL_FILE)]
        written = [out / TABLE_FILE]
        whole_file(out / TABLE_FILE, _csv(columns, members, rows))
        if has_extra("parquet"):
            whole_file(out / PARQUET_FILE, _parquet(columns, members, rows))
            written.append(out / PARQUET_FILE)
        with suppress(OSError):
            (out / PARTIAL_FILE).unlink(missing_ok=True)
    except OSError as error:
        raise MachineError(
            f"{out}: the table cannot be written ({reason(error)}); all rows are there: free space, and give the command again."
        ) from None
    return [str(path) for path in written]


def _line(columns: list[str], members: Members, row: Row) -> list[Cell]:
    number = number_of(row)
    varied = dict(zip(members.keys, members.values[number], strict=True))
    return [_cell(varied[name]) if name in varied else row.get(name) for name in columns]


def _cell(value: object) -> Cell:
    return value if isinstance(value, (bool, int, float, str)) else str(value)


def _csv(columns: list[str], members: Members, rows: Mapping[int, Row]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(_line(columns, members, rows[number]) for number in sorted(rows))
    return text.getvalue()


def _parquet(columns: list[str], members: Members, rows: Mapping[int, Row]) -> bytes:
    import pyarrow
    import pyarrow.parquet

    lines = [_line(columns, members, rows[number]) for number in sorted(rows)]
    arrays = {}
    for name, values in zip(columns, zip(*lines, strict=True), strict=True):
        kinds = {type(value) for value in values if value is not None}
        # A column of numbers and words, such as a resolution or cells, is one of words.
        mixed = len(kinds - {int, float}) > 1 or (kinds & {int, float} and kinds - {int, float})
        arrays[name] = pyarrow.array([None if value is None else str(value) for value in values] if mixed else list(values))
    file = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(arrays), file)
    return file.getvalue()
