"""``explicitfe identify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import DatasetArgument, JsonOption
from explicitfe.app.view.progress import following


def identify(
    dataset: DatasetArgument,
    law: Annotated[
        str | None,
        typer.Option(
            "--law",
            help="Material law: yeoh | neo-hooke | mooney-rivlin | yeoh-3 | ogden-1 | ogden-2 | ogden-3 | all. "
            "With all, the law with the lowest AICc is reported.",
            show_default="yeoh, compared with all laws in homogeneous tests",
        ),
    ] = None,
    method: Annotated[
        str, typer.Option("--method", help="Fitting method: least-squares | paper (the iteration of Gérard et al. 2005).")
    ] = "least-squares",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the page, the numbers, pictures and a scenario."),
    ] = None,
    fit: Annotated[
        list[str] | None,
        typer.Option(
            "--fit",
            metavar="KEY=VALUE",
            help="Fit only curves with this condition and predict the others. Repeat the option for more conditions.",
        ),
    ] = None,
    constants_by: Annotated[
        str | None,
        typer.Option(
            "--constants-by", metavar="KEY", help="Share constants between curves that have the same value of this condition."
        ),
    ] = None,
    poisson: Annotated[
        float | None,
        typer.Option(
            "--poisson",
            help="Poisson's ratio. It is assumed, not fitted.",
            show_default="0.5 (incompressible) in closed forms, 0.499 in elements",
        ),
    ] = None,
    refinement: Annotated[
        float, typer.Option("--refinement", help="Mesh refinement of the simulations: divides the element size.")
    ] = 1.5,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the files of an earlier identification in --out.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Fit the constants of a material law to measured force-displacement or stress-stretch curves.

    The default law is Yeoh with two constants; for homogeneous tests all laws are compared with it. --law fits one law alone.

    Example: [bold]explicitfe identify my-dataset --law all --out fit[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.app.api.inverse import identify as identify_constants
        from explicitfe.app.view.terminal.identify import identification_notes, identification_tables

        identification = identify_constants(
            dataset,
            law=law,
            method=method,
            out=out,
            fit=fit or (),
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
        failure=("simulation", f"no constants were identified for {', '.join(map(repr, failed))}") if failed else None,
    )
