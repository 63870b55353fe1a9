"""``explicitfe predict``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import DatasetArgument, JsonOption
from explicitfe.view.progress import following


def predict(
    dataset: DatasetArgument,
    model: Annotated[Path, typer.Option("--model", metavar="FILE", help="Constants and effects (TOML).", show_default=False)],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for a page and the numbers.")] = None,
    curves: Annotated[
        list[str] | None, typer.Option("--curve", metavar="ID", help="Predict only this curve; repeat for more.")
    ] = None,
    refinement: Annotated[
        float | None, typer.Option("--refinement", help="Divides the element sizes; the model file's own if left out.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what an earlier prediction wrote.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Predict measured curves from constants and effects, and say how far off they are.

    Example: [bold]explicitfe predict my-dataset --model model.toml[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.predict.predict import predict as predict_dataset
        from explicitfe.view.terminal.predict import prediction_table

        prediction = predict_dataset(
            dataset, model, out=out, curves=curves or (), refinement=refinement, overwrite=overwrite, progress=progress
        )
    failures = [f"{name}: {message}" for name, message in prediction.failures.items()]
    print_answer(
        prediction.document,
        as_json,
        lambda: prediction_table(prediction),
        [f"assumed: {text}" for text in prediction.assumed],
        failure=("simulation", f"not all curves could be predicted. {' '.join(failures)}") if failures else None,
    )
