"""From a scenario file to a result file: read, build, compile, run, record, summarise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from explicitfe.errors import Progress, silent
from explicitfe.results.run_summary import RunSummary
from explicitfe.run.prepare import prepare


def result_path(scenario_path: Path | str, out: Path | str = "outputs") -> Path:
    """Where the result of a scenario goes."""
    return Path(out) / f"{Path(scenario_path).stem}.vtkhdf"


def run(
    path: Path | str,
    out: Path | str = "outputs",
    *,
    settings: Sequence[str] = (),
    notes: Sequence[str] = (),
    overwrite: bool = False,
    progress: Progress = silent,
) -> RunSummary:
    """Run a scenario to its end and store its result.

    Parameters
    ----------
    path : scenario file.
    out : folder of the result, made if it does not exist.
    settings : ``key=value`` pairs that replace what the file says.
    notes : sentences for the user that the summary begins its warnings with.
    overwrite : replace a result that exists.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    The summary: what ``explicitfe run --json`` prints. ``status`` is "finished", or says why the run ended early; then
    ``message`` holds a sentence for the user, and what was computed until then is stored.

    Raises
    ------
    InputError : nothing was run and nothing written.
    """
    return prepare(path, settings, notes).run(result_path(path, out), overwrite=overwrite, progress=progress)
