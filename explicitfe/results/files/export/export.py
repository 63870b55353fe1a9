"""Export of a result to formats of other programs: all files are written completely, or none."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Literal, get_args

from typing_extensions import TypedDict

from explicitfe.platform.errors import InputError, Progress, nearest, silent
from explicitfe.platform.host.extras import require
from explicitfe.platform.host.files import refusal
from explicitfe.platform.host.result_files import find_result
from explicitfe.results.files.export.arrays import mat_bytes, npz_bytes
from explicitfe.results.files.export.shape import stl_bytes, vtu_bytes
from explicitfe.results.files.export.table import csv_bytes, parquet_bytes, table_of
from explicitfe.results.files.folder import whole_stream
from explicitfe.results.files.reader import Result, open_result

Format = Literal["csv", "parquet", "vtu", "stl", "mat", "npz"]
FORMATS: tuple[Format, ...] = get_args(Format)


class ExportedFile(TypedDict):
    """A file that was written: its format and size."""

    format: str
    file: str
    bytes: int


class ExportedResult(TypedDict):
    """A result and its exported files."""

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
    """Export a result to formats of other programs; see :func:`explicitfe.export`."""
    path = find_result(Path(path))
    for name in to:
        if name not in FORMATS:
            raise InputError(f"`to` {name}: unknown format; {nearest(name, FORMATS)}")
    if not to:
        raise InputError(f"`to` is missing; give a format: {', '.join(FORMATS)}.")
    if "parquet" in to:
        require("parquet", "writing Parquet")
    folder = path.parent if out is None else Path(out)
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError(f"`out` {folder} is a file; give a folder, in which the files get the name of the result.")
    with open_result(path) as result:
        targets = {name: _free(folder / f"{path.stem}.{name}", overwrite) for name in dict.fromkeys(to)}
        if not len(result.times):
            raise InputError(f"{path} has no stored sample; there is nothing to export.")
        created = [parent for parent in (folder, *folder.parents) if not parent.exists()]
        target = folder
        try:
            files: list[ExportedFile] = []
            folder.mkdir(parents=True, exist_ok=True)
            with ExitStack() as streams:  # the files are renamed together when all of them are complete
                for name, target in targets.items():
                    content = _content(result, name, time_s, positions, history, progress)
                    stream = streams.enter_context(whole_stream(target, overwrite=overwrite))
                    stream.write(content)
                    stream.flush()
                    files.append({"format": name, "file": str(target), "bytes": len(content)})
        except BaseException as error:
            with suppress(OSError):
                for parent in created:
                    parent.rmdir()
            if isinstance(error, FileExistsError):
                raise InputError(f"{target} was created by another program meanwhile; add `overwrite` to replace it.") from None
            if isinstance(error, OSError):
                raise refusal(error, f"cannot write {target}", "choose another `out` folder") from None
            raise
    return {"result": str(path), "files": files}


def _content(result: Result, name: str, time_s: float | None, positions: bool, history: bool, progress: Progress) -> bytes:
    if name in ("csv", "parquet"):
        columns = table_of(result, positions=positions, history=history)
        return csv_bytes(columns) if name == "csv" else parquet_bytes(columns)
    if name in ("mat", "npz"):
        return (mat_bytes if name == "mat" else npz_bytes)(result, progress)
    return (vtu_bytes if name == "vtu" else stl_bytes)(result, time_s)


def _free(target: Path, overwrite: bool) -> Path:
    """The path of a file that may be written.

    Raises
    ------
    InputError : a file of this name exists that is not to be replaced.
    """
    if target.is_symlink() or target.is_dir():
        kind = "symbolic link" if target.is_symlink() else "folder"
        raise InputError(f"{target} is a {kind} and is not replaced; choose another `out` folder.")
    if os.path.lexists(target) and not overwrite:
        raise InputError(f"{target} exists; add `overwrite` to replace it, or choose another `out` folder.")
    return target
