"""``explicitfe run``."""

from __future__ import annotations

import shlex
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from explicitfe.app.api import run as api
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.ending import FailureKind, short_name
from explicitfe.app.cli.help import debugging
from explicitfe.app.cli.options import tissue_settings_of
from explicitfe.app.cli.streams import stderr
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import Progress
from explicitfe.platform.host import stopping
from explicitfe.platform.host.extras import require
from explicitfe.platform.host.result_files import OUTPUT_FOLDER

if TYPE_CHECKING:
    from explicitfe.results.documents.run_summary import RunSummary
    from explicitfe.simulate.run.analysis import Analysis


@command(api.run)
def run(
    scenario: Path,
    *,
    out: Path = OUTPUT_FOLDER,
    name: str | None = None,
    settings: Sequence[str] = (),
    tissue: Path | None = None,
    tissue_group: str | None = None,
    plots: bool = False,
    overwrite: bool = False,
    resume: bool = False,
    as_json: bool = False,
) -> None:
    """Run a scenario and store its result in one .vtkhdf file.

    Example: [bold]explicitfe run scenarios/vowel-i.toml --set muscle.GGp.force_N=1.5 --name softer --plots[/bold]

    Parameters
    ----------
    plots : write PNG pictures of the run next to the result.
    """
    if plots:
        require("plots", "drawing pictures")
    with following(console, f"reading {scenario}") as progress:
        from explicitfe.simulate.run.prepare import prepare
        from explicitfe.simulate.run.resume import resume_analysis, stored_before
        from explicitfe.simulate.run.run import result_path

        tissue_settings, notes = tissue_settings_of(scenario, tissue, tissue_group)
        analysis = prepare(scenario, [*tissue_settings, *settings], notes)
        target = result_path(scenario, out, name)
        stored = stored_before(target) if resume else None
        if stored is None:
            summary = analysis.run(target, overwrite=overwrite, progress=progress)
        else:
            analysis, summary = resume_analysis(analysis, stored, overwrite=overwrite, progress=progress)
        stopped = draw_run(summary, progress) if plots else None
    show_run(analysis, summary, stopped, as_json)


def show_run(analysis: Analysis[Any, Any], summary: RunSummary, stopped: str | None, as_json: bool) -> None:
    """Print the summary of a run; exit with a code if it ended early or its drawing was interrupted."""
    failure: tuple[FailureKind, str] | None = None
    if summary["status"] != "finished":
        kind: FailureKind = "stopped" if summary["status"] == "interrupted" else "simulation"
        failure = kind, summary["message"] if kind == "stopped" else f"{summary['status']}: {summary['message']}"
    elif stopped:
        failure = "stopped", stopped
    from explicitfe.app.view.terminal.kinds import KINDS

    tables = KINDS[analysis.scenario.analysis.type]
    print_answer(summary, as_json, lambda: tables.summary_table(summary), summary["warnings"], failure)


def draw_run(summary: RunSummary, progress: Progress) -> str | None:
    """Draw a stored result. An error here is only a warning in the summary, because the result is complete.

    Returns
    -------
    A sentence if a signal has interrupted the drawing.
    """
    result = summary["result"]
    again = f"the result is complete; draw it with 'explicitfe plot {shlex.quote(result)}'."
    try:
        from explicitfe.app.view.draw import draw

        drawn = draw(Path(result), progress=progress)
        summary["plots"] = drawn["files"]
        summary["warnings"] += drawn["warnings"]
    except stopping.Stopped as stopped:
        return f"{stopped} while drawing: {again}"
    except Exception as error:
        if debugging():
            stderr.write(traceback.format_exc())
        summary["warnings"].append(f"{result} could not be drawn ({short_name(error)}): {again}")
    return None
