"""Draws the charts of pages with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from explicitfe.app.view.page.chart import Chart
from explicitfe.app.view.palette import COLOURS, LINE_STYLES, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FILLED_OPACITY = {"area": 0.25, "band": 0.25, "dark-band": 0.8}
LETTER_SIZE, SMALL_LETTER_SIZE, LEGEND_COLUMNS = 9, 8, 4  # font sizes, and entries in a row of the legend


def draw_charts(
    figure: Figure, charts: Sequence[Chart | None], columns: int = 1, heights: Sequence[float] | None = None
) -> list[Axes]:
    """Draw charts row by row into panels of a figure; None leaves a panel empty.

    Below panels side by side, or with the same names of series, stands one legend; other panels have their own at the right.
    ``heights`` of the rows are shares; all the same if left out.

    Returns
    -------
    The panels of the charts.
    """
    rows = -(-len(charts) // columns)
    panels, drawn = figure.subplots(rows, columns, squeeze=False, height_ratios=heights).ravel(), []
    for axes, shown in zip(panels, [*charts, *[None] * (len(panels) - len(charts))], strict=True):
        if shown is None:
            axes.set_axis_off()
        else:
            draw_chart(axes, shown)
            drawn.append(axes)
    named = {tuple(entries[1]): (axes, entries) for axes in drawn[::-1] if (entries := axes.get_legend_handles_labels())[1]}
    if columns > 1 or len(named) == 1:
        handles = {label: handle for _, entries in named.values() for handle, label in zip(*entries, strict=True)}
        ncols = max(1, min(LEGEND_COLUMNS, len(handles)))
        figure.legend(handles.values(), handles, loc="outside lower left", ncols=ncols, frameon=False, fontsize=LETTER_SIZE)
        return drawn
    for axes, entries in named.values():
        axes.legend(*entries, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=SMALL_LETTER_SIZE)
    return drawn


def draw_chart(axes: Axes, shown: Chart) -> None:
    """Draw a chart into a panel, with the ranges and marks that it has on a page."""
    plain(axes)
    for series in shown.series:
        colour, label = COLOURS[series.colour or 0], series.name or None
        if series.drawn in FILLED_OPACITY:
            edge = 0.0 if series.y_high is None else series.y_high
            axes.fill_between(series.x, series.y, edge, color=colour, alpha=FILLED_OPACITY[series.drawn], lw=0, label=label)
        elif series.drawn == "dots":
            axes.plot(series.x, series.y, "o", color=colour, ms=3.5, mew=0, label=label)
        else:
            axes.plot(series.x, series.y, LINE_STYLES[series.dash], color=colour, lw=1.5, label=label)
    for start, end in shown.shaded:
        axes.axvspan(start, end, color="0.955", lw=0, zorder=-1)
    if shown.zero:
        axes.axhline(0.0, color="0.6", lw=0.8, zorder=0.5)
    axes.set_xlim(*shown.x_range)
    axes.set_ylim(*shown.y_range)
    axes.set_xticks([tick.value for tick in shown.x_ticks], [tick.label for tick in shown.x_ticks])
    axes.set_yticks([tick.value for tick in shown.y_ticks], [tick.label for tick in shown.y_ticks])
    axes.set_xlabel(shown.x_label, fontsize=LETTER_SIZE)
    axes.set_ylabel(shown.y_label, fontsize=LETTER_SIZE)
    axes.set_title(shown.title, loc="left", fontsize=LETTER_SIZE)
    axes.tick_params(labelsize=SMALL_LETTER_SIZE)
