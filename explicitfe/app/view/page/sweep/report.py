"""Writes the page of a sweep: one HTML file beside its table, which needs no network."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from explicitfe.app.view.page.page_file import page_file, write_page
from explicitfe.app.view.page.sweep.page import sweep_page
from explicitfe.platform.errors import Progress, silent
from explicitfe.results.documents.sweep_summary import SweepReport
from explicitfe.results.documents.sweep_to_draw import SweepToDraw

REPORT_FILE = "report.html"


def write_sweep_report(
    read: Callable[[Path, Progress], SweepToDraw],
    folder: Path,
    out: Path | None = None,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> SweepReport:
    """Write the page of a sweep, as far as it is computed.

    Parameters
    ----------
    read : reads the data of a sweep from its folder.
    folder : of the sweep.
    out : the page; ``report.html`` in the folder if left out.
    overwrite : replace a page that exists.
    progress : called with the stage and the share of it that is done.

    Raises
    ------
    InputError : the folder holds no sweep, a damaged one, or no row; the page exists or cannot be written.
    """
    target = page_file(folder / REPORT_FILE, out, overwrite)
    sweep = read(folder, progress)
    text, scattered = sweep_page(sweep)
    size_MB = write_page(target, text)
    progress("draw", 1.0)
    return {
        "report": str(target),
        "size_MB": size_MB,
        "sweep": str(folder),
        "members": sweep.members,
        "stored": sweep.stored,
        "finished": sweep.statuses.count(sweep.finished),
        "outlines": len(sweep.drawn),
        "scattered": scattered,
    }
