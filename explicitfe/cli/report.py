"""``explicitfe report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.view.progress import following


def report(
    results: Annotated[
        list[Path], typer.Argument(help="Result files (.vtkhdf); several stand side by side.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="The page; RESULT-report.html beside the first result if left out."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a page that exists.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Make one HTML page of results: they move, and it says what was run and whether its numbers may be quoted.

    Example: [bold]explicitfe report outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf --out vowels.html[/bold]
    """
    with following(console, f"reading {results[0]}") as progress:
        from explicitfe.view.run_page.write import write_report
        from explicitfe.view.terminal.report import report_table

        answer = write_report(results, out, overwrite=overwrite, progress=progress)
    print_answer(answer, as_json, lambda: report_table(answer))
