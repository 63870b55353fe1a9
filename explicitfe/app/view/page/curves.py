"""Charts of measured curves and model curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.app.view.page.chart import COLOUR_COUNT, Chart, Line, chart
from explicitfe.app.view.page.close_loop.axis import goes_one_way

# Data are black as the letters of the page, and the model has its first colour.
DATA_COLOUR, MODEL_COLOUR = COLOUR_COUNT - 1, 0
# Only so many charts are drawn: those with the largest errors.
MOST_CURVES = 24
# A curve with more rows is drawn as a line: dots would lie on each other.
MOST_DOTS = 80
# Bars of the noise of so many rows can be told apart, from this many standard deviations below to as many above.
MOST_NOISE_BARS, SDS_OF_A_BAR = 40, 2.0


@dataclass(frozen=True, eq=False)
class CurveToDraw:
    """A curve in the units of its axes, each column (n,).

    Attributes
    ----------
    title : its name and what the page says of it; ``error`` decides which of many curves are drawn.
    x, measured : rows of the data; ``sd`` is their noise, None where it is not known.
    model_x, model : the model's line; None where it has none.
    """

    title: str
    x_label: str
    y_label: str
    x: np.ndarray
    measured: np.ndarray
    sd: np.ndarray | None
    model_x: np.ndarray | None
    model: np.ndarray | None
    error: float


def charts_of_curves(curves: Sequence[CurveToDraw]) -> list[Chart]:
    """The charts of the curves with the largest errors, in the order in which they were given."""
    worst = sorted(range(len(curves)), key=lambda number: -curves[number].error)[:MOST_CURVES]
    drawn = [_chart(curves[number]) for number in sorted(worst)]
    return [one for one in drawn if one is not None]


def axis_of(time_s: np.ndarray, imposed: np.ndarray, label: str) -> tuple[np.ndarray, str]:
    """Abscissa of a curve with its label: the imposed quantity, or time where that quantity is not monotonic."""
    return (imposed, label) if goes_one_way(time_s, imposed) else (time_s, "time (s)")


def measured_lines(
    name: str, x: np.ndarray, values: np.ndarray, sd: np.ndarray | None, colour: int = DATA_COLOUR, *, as_dots: bool
) -> list[Line]:
    """Rows of a curve as dots or as a line, with bars of their noise where it is known and they are few."""
    lines = []
    if sd is not None and np.any(sd > 0.0) and len(x) <= MOST_NOISE_BARS:
        gaps = np.full(len(x), np.nan)
        bars = np.column_stack([values - SDS_OF_A_BAR * sd, values + SDS_OF_A_BAR * sd, gaps]).ravel()
        lines.append(Line("", np.repeat(x, 3), bars, colour=colour))
    return [*lines, Line(name, x, values, drawn="dots" if as_dots else "line", colour=colour)]


def _chart(curve: CurveToDraw) -> Chart | None:
    lines = measured_lines("measured", curve.x, curve.measured, curve.sd, as_dots=len(curve.x) <= MOST_DOTS)
    if curve.model_x is not None and curve.model is not None:
        lines.append(Line("model", curve.model_x, curve.model, colour=MODEL_COLOUR))
    return chart(curve.title, lines, x_label=curve.x_label, y_label=curve.y_label)
