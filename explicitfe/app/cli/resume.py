"""``explicitfe resume``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console
from explicitfe.app.cli.completion import complete_unfinished_result
from explicitfe.app.cli.options import JsonOption
from explicitfe.app.cli.run import OverwriteOption, PlotsOption, draw_run, show_run
from explicitfe.app.view.progress import following
from explicitfe.platform.host.extras import require


def resume(
    context: typer.Context,
    result: Annotated[
        Path,
        typer.Argument(
            help="Interrupted result (NAME.running.vtkhdf), or its name in outputs/.",
            show_default=False,
            autocompletion=complete_unfinished_result,
        ),
    ],
    threads: Annotated[
        int | None,
        typer.Option("--threads", metavar="N", help="Number of threads.", show_default="as before"),
    ] = None,
    plots: PlotsOption = False,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Resume an interrupted run. The result is bitwise identical to that of an uninterrupted run.

    Example: [bold]explicitfe resume vowel-i[/bold]
    """
    if plots:
        require("plots", "drawing pictures")
    with following(console, f"reading {result}") as progress:
        from explicitfe.simulate.run.resume import resume_file

        run = resume_file(result, overwrite=overwrite, threads=threads, progress=progress)
        stopped = draw_run(run.summary, progress, context) if plots else None
    show_run(run.analysis, run.summary, stopped, as_json)
