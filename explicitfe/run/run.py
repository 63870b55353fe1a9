"""From a scenario file to a result file: read, build, compile, run, record, summarise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from explicitfe.errors import InputError, Progress, shortened, silent
from explicitfe.host import stopping
from explicitfe.host.shipped import scenario_file
from explicitfe.results.run_summary import RunSummary
from explicitfe.run.prepare import prepare
from explicitfe.run.resume import begun_at, go_on


def result_path(scenario_path: Path | str, out: Path | str = "outputs", name: str | None = None) -> Path:
    """Where the result of a scenario goes: it is called as the scenario, or by a name of its own.

    Raises
    ------
    InputError : the name cannot be that of a file.
    """
    if name is None:
        name = scenario_file(scenario_path).stem
    elif not name or not name.isprintable() or name != Path(name).name or name.startswith("."):
        raise InputError(f'a result cannot be called "{shortened(name)}"; give a word, such as softer')
    return Path(out) / f"{name.removesuffix('.vtkhdf')}.vtkhdf"


def run(
    path: Path | str,
    out: Path | str = "outputs",
    *,
    name: str | None = None,
    settings: Sequence[str] = (),
    notes: Sequence[str] = (),
    overwrite: bool = False,
    resume: bool = False,
    progress: Progress = silent,
) -> RunSummary:
    """Run a scenario to its end and store its result.

    Parameters
    ----------
    path : scenario file, or the name of a scenario that comes with the program.
    out : folder of the result, made if it does not exist.
    name : of the result, so that variants of a scenario can be told apart; the scenario's if left out.
    settings : ``key=value`` pairs that replace what the file says.
    notes : sentences for the user that the summary begins its warnings with.
    overwrite : replace a result that exists.
    resume : go on with a run of this scenario that was stopped or killed, if there is one; see ``run/resume.py``.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    The summary: what ``explicitfe run --json`` prints. ``status`` is "finished", or says why the run ended early; then
    ``message`` holds a sentence for the user, and what was computed until then is stored. Ctrl-C ends a run after a sample, with
    the status "interrupted"; a second one raises KeyboardInterrupt at once.

    Raises
    ------
    InputError : nothing was run and nothing written.
    """
    analysis, target = prepare(path, settings, notes), result_path(path, out, name)
    begun = begun_at(target) if resume else None
    if begun is not None:
        return go_on(analysis, begun, overwrite=overwrite, progress=progress).summary
    with stopping.watching():
        return analysis.run(target, overwrite=overwrite, progress=progress)
