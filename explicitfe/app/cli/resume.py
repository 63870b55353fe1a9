"""``explicitfe resume``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import run as api
from explicitfe.app.cli.answer import console
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_unfinished_result
from explicitfe.app.cli.run import draw_run, show_run
from explicitfe.app.view.progress import following
from explicitfe.platform.host.extras import require


@command(api.resume, completions={"result": complete_unfinished_result})
def resume(result: Path, *, plots: bool = False, as_json: bool = False, **options: Any) -> None:
    """Resume an interrupted run. The result is bitwise identical to that of an uninterrupted run.

    Example: [bold]explicitfe resume vowel-i[/bold]

    Parameters
    ----------
    result : interrupted result (NAME.running.vtkhdf), or its name in outputs/.
    plots : write PNG pictures of the run next to the result.
    """
    if plots:
        require("plots", "drawing pictures")
    with following(console, f"reading {result}") as progress:
        from explicitfe.simulate.run.resume import resume as resume_run

        summary = resume_run(result, **options, progress=progress)
        stopped = draw_run(summary, progress) if plots else None
    show_run(summary, stopped, as_json)
