"""Charts of measured curves and model curves."""

from __future__ import annotations

from collections.abc import Sequence

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


def worst_charts(charts: Sequence[tuple[float, Chart | None]]) -> list[Chart]:
    """Of pairs of an error and a chart the charts with the largest errors, in the order in which they were given."""
    worst = sorted(range(len(charts)), key=lambda number: -charts[number][0])[:MOST_CURVES]
    return [shown for number in sorted(worst) if (shown := charts[number][1]) is not None]


def axis_of(time_s: np.ndarray, imposed: np.ndarray, label: str) -> tuple[np.ndarray, str]:
    """Abscissa of a curve with its label: the imposed quantity, or time where that quantity is not monotonic."""
    return (imposed, label) if goes_one_way(time_s, imposed) else (time_s, "time (s)")


def lines_of_rows(
    name: str, x: np.ndarray, values: np.ndarray, sd: np.ndarray | None, colour: int = DATA_COLOUR, *, as_dots: bool
) -> list[Line]:
    """Rows of a curve as dots or as a line, with bars of their noise where it is known and they are few."""
    lines = []
    if sd is not None and np.any(sd > 0.0) and len(x) <= MOST_NOISE_BARS:
        gaps = np.full(len(x), np.nan)
        bars = np.column_stack([values - SDS_OF_A_BAR * sd, values + SDS_OF_A_BAR * sd, gaps]).ravel()
        lines.append(Line("", np.repeat(x, 3), bars, colour=colour))
    return [*lines, Line(name, x, values, drawn="dots" if as_dots else "line", colour=colour)]


def curve_chart(
    title: str,
    axes: tuple[str, str],
    x: np.ndarray,
    measured: np.ndarray,
    sd: np.ndarray | None = None,
    model: tuple[np.ndarray, np.ndarray] | None = None,
) -> Chart | None:
    """The chart of a curve: its rows, with their noise where it is known, and the line of the model, x and y."""
    lines = lines_of_rows("measured", x, measured, sd, as_dots=len(x) <= MOST_DOTS)
    if model is not None:
        lines.append(Line("model", *model, colour=MODEL_COLOUR))
    return chart(title, lines, x_label=axes[0], y_label=axes[1])
