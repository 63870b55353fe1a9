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
from explicitfe.app.cli.streams import stderr
from explicitfe.app.cli.tissue_settings import tissue_settings_of
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import Progress
from explicitfe.platform.host import stopping
from explicitfe.platform.host.extras import require

if TYPE_CHECKING:
    from explicitfe.results.documents.run_summary import RunSummary


@command(api.run)
def run(
    scenario: Path,
    *,
    settings: Sequence[str] = (),
    tissue: Path | None = None,
    tissue_group: str | None = None,
    plots: bool = False,
    as_json: bool = False,
    **options: Any,
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
        from explicitfe.simulate.run.run import run as run_scenario

        tissue_settings, notes = tissue_settings_of(scenario, tissue, tissue_group)
        summary = run_scenario(scenario, settings=[*tissue_settings, *settings], notes=notes, **options, progress=progress)
        stopped = draw_run(summary, progress) if plots else None
    show_run(summary, stopped, as_json)


def show_run(summary: RunSummary, stopped: str | None, as_json: bool) -> None:
    """Print the summary of a run; exit with a code if it ended early or its drawing was interrupted."""
    failure: tuple[FailureKind, str] | None = None
    if summary["status"] != "finished":
        kind: FailureKind = "stopped" if summary["status"] == "interrupted" else "simulation"
        failure = kind, summary["message"] if kind == "stopped" else f"{summary['status']}: {summary['message']}"
    elif stopped:
        failure = "stopped", stopped
    from explicitfe.app.view.terminal.kinds import KINDS

    tables = KINDS["relaxation" if "loads" in summary else "transient"]
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
