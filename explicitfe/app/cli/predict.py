"""``explicitfe predict``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import inverse
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command(inverse.predict, without=("density", "tolerance", "processes"))
def predict(dataset: Path, *, as_json: bool = False, **options: Any) -> None:
    """Predict the curves of a dataset with a model file and report the error of each.

    Example: [bold]explicitfe predict my-dataset --model model.toml[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.app.view.terminal.predict import prediction_table

        prediction = inverse.predict(dataset, **options, progress=progress)
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
