"""Pictures of a run over time, from the charts of its page: named points and energies; and the curve of a reaction force."""

from __future__ import annotations

from typing import TYPE_CHECKING

from explicitfe.app.view.chart_figure import draw_chart, draw_charts
from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.page.chart import Chart, Line, chart
from explicitfe.app.view.page.run.charts import BALANCE_TITLE, FORCES_TITLE, POINTS_TITLE, charts_of
from explicitfe.results.files import Result
from explicitfe.results.measure.reactions import force_curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CHART_HEIGHT_IN = 2.0


def probes_figure(result: Result, step: int) -> Figure | None:
    """Displacement and speed of the named points over time; None where there is nothing to show."""
    charts = charts_of([result])[0]
    return _figure(result, charts, [one for one in charts if one.title.startswith(POINTS_TITLE)], "Named points over time")


def energies_figure(result: Result, step: int) -> Figure | None:
    """Stacked energies over time, the error of their balance and the hourglass share; None where there is nothing to show."""
    charts = charts_of([result])[0]
    return _figure(result, charts, [one for one in charts if one.numerical], "Energy balance over time")


def _figure(result: Result, charts: list[Chart], shown: list[Chart], what: str) -> Figure | None:
    """Charts below each other, after that of the muscle forces."""
    if not shown:
        return None
    shown = [*(one for one in charts if one.title == FORCES_TITLE), *shown]
    heights = [2.0 if one.title == BALANCE_TITLE else 1.0 for one in shown]
    figure = result_figure(result, 0.8 + CHART_HEIGHT_IN * sum(heights), what)
    for axes in draw_charts(figure, shown, heights=heights)[:-1]:
        axes.set_xlabel("")
    return figure


def reaction_figure(result: Result, name: str) -> Figure:
    """Force of a support, a fixed or prescribed node set or a bone over displacement; over time where nothing moves.

    Raises
    ------
    InputError : the result has no such force.
    """
    curve = force_curve(result, name)
    along = "" if curve.moved is None else f", along the displacement of {curve.moved}"
    what = f"Force of {name} on the body" if curve.own else f"Force of the body on {name}"
    x = 1e3 * (result.history("time") if curve.moved is None else curve.displacement_m)
    label = "time (ms)" if curve.moved is None else f"displacement of {curve.moved} (mm)"
    lines = [Line("", x, curve.force_N), Line("", x, curve.force_N, "dots", colour=0)]
    figure = result_figure(result, 4.2, what + along)
    if (shown := chart("", lines, x_label=label, y_label="force (N)")) is not None:
        draw_chart(figure.subplots(), shown)
    return figure
