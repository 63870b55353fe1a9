"""``explicitfe report``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from explicitfe.app.api import report as api
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command(api.report, out="--out FILE")
def report(results: list[Path], *, as_json: bool = False, **options: Any) -> None:
    """Write an HTML report of results, with animation, charts and the outcome of the checks, or the report of a sweep.

    Example: [bold]explicitfe report outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf --out vowels.html[/bold]

    Parameters
    ----------
    results : result files (.vtkhdf) to compare side by side, their names in outputs/, or the folder of a sweep.
    """
    with following(console, f"reading {results[0]}") as progress:
        from explicitfe.app.view.terminal.report import report_table
        from explicitfe.app.view.terminal.sweep import sweep_report_table

        answer = api.write_report_of(results, **options, progress=progress)
    table: Callable[[Any], RenderableType] = sweep_report_table if "sweep" in answer else report_table
    print_answer(answer, as_json, lambda: table(answer))
