"""``explicitfe resume``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console
from explicitfe.cli.options import JsonOption
from explicitfe.cli.run import OverwriteOption, PlotsOption, draw_run, show_run
from explicitfe.host.extras import require
from explicitfe.view.progress import following


def resume(
    context: typer.Context,
    result: Annotated[
        Path, typer.Argument(help="Result file of a run that was stopped or killed (.vtkhdf).", show_default=False)
    ],
    threads: Annotated[int | None, typer.Option("--threads", help="That share a step from here on.", show_default=False)] = None,
    plots: PlotsOption = False,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Go on with a run that was stopped or killed; it ends as if nothing had been.

    Example: [bold]explicitfe resume outputs/vowel-i.running.vtkhdf[/bold]
    """
    if plots:
        require("plots", "drawing pictures")
    with following(console, f"reading {result}") as progress:
        from explicitfe.run.resume import resumed

        run = resumed(result, overwrite=overwrite, threads=threads, progress=progress)
        stopped = draw_run(run.analysis, run.summary, progress, context) if plots else None
    show_run(run.analysis, run.summary, stopped, as_json)
