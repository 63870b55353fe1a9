"""Errors of a prediction in the terminal."""

from __future__ import annotations

from rich.console import Group
from rich.markup import escape

from explicitfe.app.view.page.predict import errors_table
from explicitfe.app.view.terminal.rows import pairs, terminal_table
from explicitfe.results.documents.prediction import Prediction


def prediction_table(prediction: Prediction) -> Group:
    """Root mean square error of each curve, and why curves could not be predicted."""
    table = terminal_table(f"{prediction.dataset}: {', '.join(prediction.effects) or 'elastic'}", errors_table(prediction))
    failed = pairs("failed" if prediction.failures else "")
    for name, why in prediction.failures.items():
        failed.add_row(escape(name), f"[red]{escape(why)}[/red]")
    return Group(table, failed) if prediction.failures else Group(table)
