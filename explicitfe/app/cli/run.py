"""``explicitfe run``."""

from __future__ import annotations

import shlex
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.ending import FailureKind, short_name
from explicitfe.app.cli.options import (
    JsonOption,
    OutOption,
    ScenarioArgument,
    SettingsOption,
    TissueGroupOption,
    TissueOption,
    tissue_settings_of,
)
from explicitfe.app.cli.streams import stderr
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import Progress
from explicitfe.platform.host import stopping
from explicitfe.platform.host.extras import require
from explicitfe.platform.host.result_files import OUTPUT_FOLDER

if TYPE_CHECKING:
    from explicitfe.results.documents.run_summary import RunSummary
    from explicitfe.simulate.run.analysis import Analysis


PlotsOption = Annotated[bool, typer.Option("--plots", help="Write PNG pictures of the run next to the result.")]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace an existing result.")]


def run(
    context: typer.Context,
    scenario: ScenarioArgument,
    out: OutOption = OUTPUT_FOLDER,
    settings: SettingsOption = None,
    tissue: TissueOption = None,
    tissue_group: TissueGroupOption = None,
    plots: PlotsOption = False,
    name: Annotated[
        str | None,
        typer.Option("--name", metavar="NAME", help="Name of the result.", show_default="name of the scenario"),
    ] = None,
    overwrite: OverwriteOption = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Resume an interrupted run of this scenario; start one if there is none.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run a scenario and store its result in one .vtkhdf file.

    Example: [bold]explicitfe run scenarios/vowel-i.toml --set muscle.GGp.force_N=1.5 --name softer --plots[/bold]
    """
    if plots:
        require("plots", "drawing pictures")
    with following(console, f"reading {scenario}") as progress:
        from explicitfe.simulate.run.prepare import prepare
        from explicitfe.simulate.run.resume import resume_analysis, stored_before
        from explicitfe.simulate.run.run import result_path

        tissue_settings, notes = tissue_settings_of(scenario, tissue, tissue_group)
        analysis = prepare(scenario, [*tissue_settings, *(settings or ())], notes)
        target = result_path(scenario, out, name)
        stored = stored_before(target) if resume else None
        if stored is None:
            summary = analysis.run(target, overwrite=overwrite, progress=progress)
        else:
            analysis, summary = resume_analysis(analysis, stored, overwrite=overwrite, progress=progress)
        stopped = draw_run(summary, progress, context) if plots else None
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


def draw_run(summary: RunSummary, progress: Progress, context: typer.Context) -> str | None:
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
        if context.find_root().params["debug"]:
            stderr.write(traceback.format_exc())
        summary["warnings"].append(f"{result} could not be drawn ({short_name(error)}): {again}")
    return None
