"""The page of a prediction: measured and predicted curves, and their errors."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

import numpy as np

from explicitfe.app.view.page.chart import Chart
from explicitfe.app.view.page.curves import MOST_CURVES, axis_of, curve_chart, worst_charts
from explicitfe.app.view.page.frame import page_text
from explicitfe.app.view.page.tables import PageTable, bars, table
from explicitfe.app.view.page.words import finite, joined, number, percent, plural
from explicitfe.results.documents.prediction import PredictedCurve, Prediction

SIDES = {"holdout": "held out", "fit": "fitted", None: ""}
# Each side of the split, and curves without one, in words: held-out curves are what counts.
SIDES_IN_WORDS = {"holdout": "held-out curve", "fit": "fitted curve", "all": "curve"}


def predict_page(prediction: Prediction, dataset: str) -> str:
    """The text of the page; ``dataset`` is what the command was given."""
    effects = joined([name.replace("-", " ") for name in prediction.effects])
    return page_text(
        "page/predict.html.j2",
        title=f"{prediction.dataset}, predicted {f'with {effects}' if effects else 'by the elastic model'}",
        errors=list(_errors(prediction)),
        charts=_charts(prediction),
        left_undrawn=max(0, len(prediction.curves) - MOST_CURVES),
        curves=errors_table(prediction),
        failures=table(("curve", "why"), list(prediction.failures.items()), "tw"),
        assumed=prediction.assumed,
        command=f"explicitfe predict {shlex.quote(dataset)} --model {shlex.quote(prediction.model)}",
        numerics=table(
            ("", ""),
            [
                ("refinement", number(prediction.refinement)),
                ("density", number(prediction.density)),
                ("tolerance", number(prediction.tolerance, 2)),
                ("wall time", f"{number(prediction.wall_s, 2)} s"),
            ],
            "tt",
        ),
    )


def _errors(prediction: Prediction) -> Iterator[tuple[str, str]]:
    """A large number for each side, and what it is of."""
    for side, words in SIDES_IN_WORDS.items():
        if side in prediction.error:
            error = prediction.error[side]
            yield percent(error.nrmse), f"of the largest value, on {plural(error.curves, words)}"


def _charts(prediction: Prediction) -> list[Chart]:
    return worst_charts([_drawn(name, curve) for name, curve in _in_order(prediction)])


def _in_order(prediction: Prediction) -> list[tuple[str, PredictedCurve]]:
    """Held-out curves first."""
    return sorted(prediction.curves.items(), key=lambda item: item[1].split != "holdout")


def _drawn(name: str, curve: PredictedCurve) -> tuple[float, Chart | None]:
    """The error of a curve, and its chart; a curve that could not be predicted comes first."""
    rows = curve.rows
    label = f"{curve.imposed.replace('_', ' ')} ({curve.imposed_unit})" if curve.imposed_unit else curve.imposed.replace("_", " ")
    x, x_label = axis_of(np.array(rows.time_s), np.array(rows.imposed), label)
    parts = [name, SIDES[curve.split], f"error {percent(curve.nrmse)}" if finite(curve.nrmse) else ""]
    axes = (x_label, f"{curve.quantity.replace('_', ' ')} ({curve.unit})")
    model = None if rows.predicted is None else (x, np.array(rows.predicted))
    drawn = curve_chart(", ".join(filter(None, parts)), axes, x, np.array(rows.measured), model=model)
    return curve.nrmse if finite(curve.nrmse) else float("inf"), drawn


def errors_table(prediction: Prediction) -> PageTable | None:
    """The errors of the predicted curves, held-out ones first."""
    largest = max((curve.nrmse for curve in prediction.curves.values() if finite(curve.nrmse)), default=0.0)
    rows = [
        (
            name,
            SIDES[curve.split],
            percent(curve.nrmse),
            f"{number(curve.rmse)} {curve.unit}" if finite(curve.rmse) else "",
            f"{curve.seconds:.2f} s" if finite(curve.seconds) else "",
            bars([None, curve.nrmse], None, largest),
        )
        for name, curve in _in_order(prediction)
        if curve.status == "predicted"
    ]
    return table(("curve", "", "of the largest value", "rmse", "wall time", ""), rows, "ttnnnb")
