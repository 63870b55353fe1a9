"""``explicitfe predict``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import DatasetArgument, JsonOption
from explicitfe.app.view.progress import following


def predict(
    dataset: DatasetArgument,
    model: Annotated[
        Path,
        typer.Option(
            "--model",
            metavar="FILE",
            help="Model file (TOML) with constants and effects, such as model.toml of close-loop.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Output folder for the predicted curves (CSV, JSON) and a page (HTML)."),
    ] = None,
    curves: Annotated[
        list[str] | None, typer.Option("--curve", metavar="ID", help="Predict only this curve. Repeat for more.")
    ] = None,
    refinement: Annotated[
        float | None,
        typer.Option("--refinement", help="Divide element sizes by this factor.", show_default="from the model file"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing results.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Predict the curves of a dataset with a model file and report the error of each.

    Example: [bold]explicitfe predict my-dataset --model model.toml[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.app.api.inverse import predict as predict_dataset
        from explicitfe.app.view.terminal.predict import prediction_table

        prediction = predict_dataset(
            dataset, model, out=out, curves=curves or (), refinement=refinement, overwrite=overwrite, progress=progress
        )
    failures = [f"{name}: {message}" for name, message in prediction.failures.items()]
    print_answer(
        prediction.document,
        as_json,
        lambda: prediction_table(prediction),
        [f"assumed: {text}" for text in prediction.assumed],
        failure=("simulation", f"{len(failures)} of {len(prediction.curves)} curves could not be predicted. {' '.join(failures)}")
        if failures
        else None,
    )
