"""``explicitfe.report``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.api.source import Source, folder_of, is_sweep, path_of
from explicitfe.platform.errors import InputError, Progress, silent

if TYPE_CHECKING:
    from explicitfe.app.view.page.run.write import ReportAnswer
    from explicitfe.results.documents.sweep_summary import SweepReport


def report(*results: Source, out: Path | str | None = None, overwrite: bool = False, progress: Progress = silent) -> Path:
    """Write an HTML report page of one or several results, or of a sweep.

    Parameters
    ----------
    results : path, name in ``outputs/``, open result, or summary of a run; up to eight are shown side by side. Or the folder of
        one sweep.
    out : HTML file; by default RESULT-report.html, or report.html in the folder of a sweep.
    overwrite : replace an existing page.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    Path of the page, one file that needs no network.

    Raises
    ------
    InputError : no such result, no step that can be drawn, or the page exists or cannot be written.
    """
    if not results:
        raise InputError("report: results is empty; give at least one result.")
    paths = [path_of(result, "results") for result in results]
    target = None if out is None else folder_of(out, "report: out")
    return Path(write_report_of(paths, target, overwrite=overwrite, progress=progress)["report"])


def write_report_of(
    paths: Sequence[Path], out: Path | None = None, *, overwrite: bool = False, progress: Progress = silent
) -> ReportAnswer | SweepReport:
    """Write the report of results or of one sweep; return the answer of ``explicitfe report``."""
    sweeps = [path for path in paths if is_sweep(path)]
    if not sweeps:
        from explicitfe.app.view.page.run.write import write_report

        return write_report(paths, out, overwrite=overwrite, progress=progress)
    if len(paths) > 1:
        raise InputError(f"{sweeps[0]} is a sweep, which has a report of its own; name only this folder.")
    from explicitfe.app.view.page.sweep.report import write_sweep_report  # sweeps need the compiler, results do not
    from explicitfe.simulate.sweep.page_data import sweep_to_draw

    return write_sweep_report(sweep_to_draw, sweeps[0], out, overwrite=overwrite, progress=progress)
