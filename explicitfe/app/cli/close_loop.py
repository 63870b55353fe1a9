"""``explicitfe close-loop``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.help import with_flags
from explicitfe.app.cli.options import DatasetArgument, JsonOption
from explicitfe.app.view.progress import following

USUAL_MINUTES = 20.0  # a safety limit, several times what the usual number of simulations takes on one core


def close_loop(
    dataset: DatasetArgument,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Output folder.", show_default="outputs/close-loop-NAME"),
    ] = None,
    add: Annotated[
        list[Path] | None,
        typer.Option(
            "--add", metavar="DATASET", help="Also fit the curves of this dataset, such as a proposed test. Repeat for more."
        ),
    ] = None,
    holdout: Annotated[
        list[str] | None,
        typer.Option("--holdout", metavar="ID", help="Hold out this curve: predict it, do not fit it. Repeat for more."),
    ] = None,
    constants_by: Annotated[
        str | None,
        typer.Option("--constants-by", metavar="KEY", help="Condition by which curves share constants, such as direction."),
    ] = None,
    effects: Annotated[
        list[str] | None, typer.Option("--effects", metavar="NAME", help="Consider only this effect. Repeat for more.")
    ] = None,
    max_effects: Annotated[
        int, typer.Option("--max-effects", help="Largest number of effects to add; several terms of one effect count separately.")
    ] = 3,
    simulations: Annotated[
        int | None,
        typer.Option(
            "--simulations",
            help="Number of simulations after which the search ends.",
            show_default="4000 for homogeneous tests, 200 for others",
        ),
    ] = None,
    minutes: Annotated[
        float, typer.Option("--minutes", help="Safety limit on the time; a verdict that it cuts off depends on the machine.")
    ] = USUAL_MINUTES,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing report.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Find which effect a model lacks, from measured curves.

    Fit the elastic model, test which effects explain the residual, add them, and report the error on held-out curves.

    Example: [bold]explicitfe close-loop my-dataset --out report[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.app.api.inverse import close_loop as close
        from explicitfe.app.view.terminal.close_loop import loop_tables
        from explicitfe.inverse.measured.files import folder_name

        report = close(
            dataset,
            out=out or Path("outputs") / f"close-loop-{folder_name(dataset)}",
            add=add or (),
            holdout=holdout or (),
            constants_by=constants_by,
            effects=effects or (),
            max_effects=max_effects,
            simulations="usual" if simulations is None else simulations,
            minutes=minutes,
            overwrite=overwrite,
            progress=progress,
        )
    print_answer(
        report.document,
        as_json,
        lambda: loop_tables(report.model_copy(update={"sentence": with_flags(report.sentence)})),
        [with_flags(warning) for warning in report.warnings],
        failure=("simulation", with_flags(report.message or report.sentence)) if report.verdict == "failed" else None,
    )
