"""Writes the page of a sweep: one HTML file beside its table, which needs no network."""

from __future__ import annotations

from pathlib import Path

from explicitfe.errors import Progress, silent
from explicitfe.results.sweep_summary import SweepReport
from explicitfe.sweep.page_data import sweep_to_draw
from explicitfe.view.page.page_file import page_file, write_page
from explicitfe.view.page.sweep import sweep_page

REPORT_FILE = "report.html"


def write_sweep_report(
    folder: Path, out: Path | None = None, *, overwrite: bool = False, progress: Progress = silent
) -> SweepReport:
    """Write the page of a sweep, as far as it is computed.

    Parameters
    ----------
    folder : of the sweep.
    out : the page; ``report.html`` in the folder if left out.
    overwrite : replace a page that exists.
    progress : called with the stage and the share of it that is done.

    Raises
    ------
    InputError : the folder holds no sweep, a damaged one, or no row; the page exists or cannot be written.
    """
    target = page_file(folder / REPORT_FILE, out, overwrite)
    sweep = sweep_to_draw(folder, progress)
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
