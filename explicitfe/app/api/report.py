"""``explicitfe.report``."""

from __future__ import annotations

from pathlib import Path

from explicitfe.app.api.source import Source, folder_of, is_sweep, path_of
from explicitfe.app.view.page.run.write import write_report
from explicitfe.platform.errors import InputError, Progress, silent


def report(*results: Source, out: Path | str | None = None, overwrite: bool = False, progress: Progress = silent) -> Path:
    """Write an HTML report page of one or several results, or of a sweep.

    Parameters
    ----------
    results : path, name in ``outputs/``, open result, or summary of a run; up to eight are shown side by side. Or the folder of
        one sweep.
    out : the page; ``RESULT-report.html``, or ``report.html`` in the folder of a sweep, if left out.
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
    if any(map(is_sweep, paths)):
        if len(paths) > 1:
            raise InputError("report: results contains a sweep, which has a page of its own; give it alone.")
        from explicitfe.app.view.page.sweep.report import write_sweep_report  # sweeps need the compiler, results do not
        from explicitfe.simulate.sweep.page_data import sweep_to_draw

        return Path(write_sweep_report(sweep_to_draw, paths[0], target, overwrite=overwrite, progress=progress)["report"])
    return Path(write_report(paths, target, overwrite=overwrite, progress=progress)["report"])
