"""``explicitfe identify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import DatasetArgument, JsonOption
from explicitfe.view.progress import following


def identify(
    dataset: DatasetArgument,
    method: Annotated[
        str, typer.Option("--method", help="least-squares | paper (the iteration of Gérard et al. 2005)")
    ] = "least-squares",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for a page, numbers, pictures and a scenario."),
    ] = None,
    fit: Annotated[
        list[str] | None,
        typer.Option(
            "--fit", metavar="KEY=VALUE", help="Fit only curves with this condition, predict the others; repeat for more."
        ),
    ] = None,
    constants_by: Annotated[
        str | None,
        typer.Option("--constants-by", metavar="KEY", help="Curves that agree in this condition share their constants."),
    ] = None,
    poisson: Annotated[float, typer.Option("--poisson", help="Poisson's ratio, supposed.")] = 0.499,
    refinement: Annotated[float, typer.Option("--refinement", help="Divides the element sizes of the forward model.")] = 1.5,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what an earlier identification wrote.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Find the Yeoh constants of tissue from measured force-displacement curves.

    Example: [bold]explicitfe identify my-dataset --out fit[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.identify.identify import identify as identify_constants
        from explicitfe.view.terminal.identify import identification_notes, identification_tables

        identification = identify_constants(
            dataset,
            method=method,
            out=out,
            fit_where=fit or (),
            constants_by=constants_by,
            poisson=poisson,
            refinement=refinement,
            overwrite=overwrite,
            progress=progress,
        )
    failed = [name for name, group in identification["groups"].items() if group.get("status") == "failed"]
    print_answer(
        identification,
        as_json,
        lambda: identification_tables(identification),
        list(identification_notes(identification)),
        failure=("simulation", f"the constants could not be identified of {', '.join(map(repr, failed))}") if failed else None,
    )
