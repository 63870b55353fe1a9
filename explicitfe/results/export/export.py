"""Writes a result in formats of other programs, each file whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

from typing_extensions import TypedDict

from explicitfe.errors import InputError, Progress, nearest, silent
from explicitfe.host.extras import require
from explicitfe.host.files import reason
from explicitfe.results.export.arrays import mat_bytes, npz_bytes
from explicitfe.results.export.shape import stl_bytes, vtu_bytes
from explicitfe.results.export.table import csv_bytes, parquet_bytes, table_of
from explicitfe.results.folder import whole_file
from explicitfe.results.reader import Result, open_result

Format = Literal["csv", "parquet", "vtu", "stl", "mat", "npz"]
FORMATS: tuple[Format, ...] = get_args(Format)


class ExportedFile(TypedDict):
    """A file that was written: its format and size."""

    format: str
    file: str
    bytes: int


class ExportedResult(TypedDict):
    """A result, and the files that were made of it."""

    result: str
    files: list[ExportedFile]


def export(
    path: Path | str,
    to: Sequence[str],
    out: Path | str | None = None,
    *,
    time_s: float | None = None,
    positions: bool = False,
    history: bool = False,
    overwrite: bool = False,
    progress: Progress = silent,
) -> ExportedResult:
    """Write a result in formats of other programs.

    Parameters
    ----------
    to : one or more of ``FORMATS``: tables (csv, parquet), all arrays (mat, npz), a mesh (vtu) or a surface (stl) at one time.
    out : folder; that of the result if left out.
    time_s : for vtu and stl, the stored time nearest to it; the last one if left out.
    positions, history : for tables, see ``export/table.py``.
    overwrite : replace files that exist.
    progress : called with the stage and the share of it that is done.

    Raises
    ------
    InputError : the result cannot be read, there is no such format or time, or a file exists or cannot be written.
    """
    path = Path(path)
    for name in to:
        if name not in FORMATS:
            raise InputError(f"--to {name}: there is no such format; {nearest(name, FORMATS)}")
    if not to:
        raise InputError(f"give the format with --to: {', '.join(FORMATS)}.")
    if "parquet" in to:
        require("parquet", "writing Parquet")
    folder = path.parent if out is None else Path(out)
    with open_result(path) as result:
        targets = {name: _free(folder / f"{path.stem}.{name}", overwrite) for name in dict.fromkeys(to)}
        if not len(result.times):
            raise InputError(f"{path} holds no stored step; there is nothing to export.")
        files: list[ExportedFile] = []
        for name, target in targets.items():
            content = _content(result, name, time_s, positions, history, progress)
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                whole_file(target, content, overwrite=overwrite)
            except FileExistsError:
                raise InputError(f"{target} has appeared meanwhile; add --overwrite to replace it.") from None
            except OSError as error:
                raise InputError(f"{target} cannot be written ({reason(error)}); choose another --out folder.") from None
            files.append({"format": name, "file": str(target), "bytes": len(content)})
    return {"result": str(path), "files": files}


def _content(result: Result, name: str, time_s: float | None, positions: bool, history: bool, progress: Progress) -> bytes:
    if name in ("csv", "parquet"):
        columns = table_of(result, positions=positions, history=history)
        return csv_bytes(columns) if name == "csv" else parquet_bytes(columns)
    if name in ("mat", "npz"):
        return (mat_bytes if name == "mat" else npz_bytes)(result, progress)
    return (vtu_bytes if name == "vtu" else stl_bytes)(result, time_s)


def _free(target: Path, overwrite: bool) -> Path:
    """The name of a file that may be written.

    Raises
    ------
    InputError : something has it that is not replaced.
    """
    if target.is_symlink() or target.is_dir():
        kind = "link" if target.is_symlink() else "folder"
        raise InputError(f"{target} is a {kind}, which is not replaced; choose another --out folder.")
    if os.path.lexists(target) and not overwrite:
        raise InputError(f"{target} exists; add --overwrite to replace it, or choose another --out folder.")
    return target
