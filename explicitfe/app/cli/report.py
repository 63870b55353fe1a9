"""``explicitfe report``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import JsonOption, is_sweep, result_argument
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError


def report(
    results: Annotated[
        list[Path],
        result_argument("Result files (.vtkhdf) to compare side by side, their names in outputs/, or the folder of a sweep."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="HTML file.",
            show_default="RESULT-report.html; sweep: report.html in its folder",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing page.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write an HTML report of results, with animation, charts and the outcome of the checks, or the report of a sweep.

    Example: [bold]explicitfe report outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf --out vowels.html[/bold]
    """
    with following(console, f"reading {results[0]}") as progress:
        folders = [path for path in results if is_sweep(path)]
        if folders:
            from explicitfe.app.view.page.sweep.report import write_sweep_report
            from explicitfe.app.view.terminal.sweep import sweep_report_table
            from explicitfe.simulate.sweep.page_data import sweep_to_draw

            if len(results) > 1:
                raise InputError(f"{folders[0]} is a sweep, which has a report of its own; name only this folder.")
            of_sweep = write_sweep_report(sweep_to_draw, folders[0], out, overwrite=overwrite, progress=progress)
            print_later = partial(print_answer, of_sweep, as_json, lambda: sweep_report_table(of_sweep))
        else:
            from explicitfe.app.view.page.run.write import write_report
            from explicitfe.app.view.terminal.report import report_table

            answer = write_report(results, out, overwrite=overwrite, progress=progress)
            print_later = partial(print_answer, answer, as_json, lambda: report_table(answer))
    print_later()
