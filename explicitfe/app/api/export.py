"""``explicitfe.export``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.api.source import Source, folder_of, path_of
from explicitfe.platform.errors import Progress, silent

if TYPE_CHECKING:
    from explicitfe.results.files.export.export import ExportedResult


def export(
    result: Source,
    to: str | Sequence[str],
    out: Path | str | None = None,
    *,
    time_s: float | None = None,
    positions: bool = False,
    history: bool = False,
    overwrite: bool = False,
    progress: Progress = silent,
) -> ExportedResult:
    """Export a result to formats of other programs.

    Parameters
    ----------
    result : path, name in ``outputs/``, open result, or summary of a run.
    to : format, or several: csv or parquet (tables of the points), vtu (mesh at one time), stl (surface at one time), mat or npz
        (all arrays).
    out : output folder; by default that of the result.
    time_s : time for vtu and stl, s; the nearest stored time is used; by default the last one.
    positions : write positions instead of displacements into tables.
    history : add energies and all other histories to tables.
    overwrite : replace existing files.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    A dictionary with the result and its ``files``: format, path and size of each.

    Raises
    ------
    InputError : no such result, format or time, or a file exists or cannot be written.
    MachineError : the disk is full; no file was written.
    """
    from explicitfe.fem.inputs.argument import finite_number
    from explicitfe.results.files.export.export import export as export_file

    folder = None if out is None else folder_of(out, "export: out")
    time_s = None if time_s is None else finite_number("export: time_s", time_s)
    return export_file(
        path_of(result),
        [to] if isinstance(to, str) else to,
        folder,
        time_s=time_s,
        positions=positions,
        history=history,
        overwrite=overwrite,
        progress=progress,
    )
