"""``explicitfe close-loop``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import DatasetArgument, JsonOption
from explicitfe.view.progress import following


def close_loop(
    dataset: DatasetArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Folder of the report; outputs/close-loop-NAME if left out.", show_default=False
        ),
    ] = None,
    add: Annotated[
        list[Path] | None,
        typer.Option("--add", metavar="DATASET", help="Fit the curves of this dataset too, such as of a proposed test; repeat."),
    ] = None,
    holdout: Annotated[
        list[str] | None, typer.Option("--holdout", metavar="ID", help="Only predict this curve; repeat for more.")
    ] = None,
    constants_by: Annotated[
        str | None,
        typer.Option("--constants-by", metavar="KEY", help="Curves that agree in this condition share their constants."),
    ] = None,
    effects: Annotated[
        list[str] | None, typer.Option("--effects", metavar="NAME", help="Consider only this effect; repeat for more.")
    ] = None,
    max_effects: Annotated[int, typer.Option("--max-effects", help="Add no more effects, or terms of one, than this.")] = 3,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier report.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what a model lacks, given measured curves: trace the residual, add the effect, report the error before and after.

    Example: [bold]explicitfe close-loop my-dataset --out report[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.close_loop.close import close_loop as close
        from explicitfe.measured.files import folder_name
        from explicitfe.view.terminal.close_loop import loop_tables

        report = close(
            dataset,
            out=out or Path("outputs") / f"close-loop-{folder_name(dataset)}",
            add=add or (),
            holdout=holdout or (),
            constants_by=constants_by,
            effects=effects or (),
            max_effects=max_effects,
            overwrite=overwrite,
            progress=progress,
        )
    print_answer(
        report.document,
        as_json,
        lambda: loop_tables(report),
        report.warnings,
        failure=("simulation", report.message or report.sentence) if report.verdict == "failed" else None,
    )
