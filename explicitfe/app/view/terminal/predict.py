"""Errors of a prediction in the terminal."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from explicitfe.results.documents.prediction import Prediction


def prediction_table(prediction: Prediction) -> Table:
    """Root mean square error of each curve."""
    effects = ", ".join(prediction.effects) or "elastic"
    table = Table(title=escape(f"{prediction.dataset}: {effects}"), title_justify="left")
    table.add_column("curve", no_wrap=True)
    for column in ("", "rms error", "of the largest", "time"):
        table.add_column(column, justify="right")
    for name, curve in prediction.curves.items():
        if curve.status != "predicted":
            table.add_row(escape(name), "[red]failed[/red]", "", "", "")
            continue
        share = "" if curve.nrmse is None else f"{100 * curve.nrmse:.2f} %"
        table.add_row(escape(name), curve.split or "", f"{curve.rmse:.4g} {curve.unit}", share, f"{curve.seconds:.2f} s")
    return table
