"""Pictures of an identification as PNG files, from plain numbers in the units of the axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from explicitfe.app.view.chart_figure import draw_chart, draw_charts
from explicitfe.app.view.indentation import ENERGY_LABEL, paint_section
from explicitfe.app.view.page.chart import COLOUR_COUNT, Line, chart
from explicitfe.app.view.page.curves import DATA_COLOUR, lines_of_rows
from explicitfe.app.view.page.identify import constant_name, profile_chart, unit_of_constant
from explicitfe.app.view.palette import WIDTH_IN, new_figure, save
from explicitfe.results.documents.fitted_curves import ConstantProfile, DeformedSpecimen, FittedCurve, PaperTrace

FIRST_RUNS_COLOUR, LAST_RUN_COLOUR = 5, 1


def fit(path: Path, title: str, curves: Sequence[FittedCurve], constants: Mapping[str, float]) -> None:
    """Draw measured curves with error bars, the fitted model, and the residual; ``constants`` go into the title."""
    upper, lower = [], []
    for number, curve in enumerate(curves):
        colour, held_out = number % (COLOUR_COUNT - 1), curve["split"] == "holdout"
        name = f"{curve['id']}{', only predicted' if held_out else ''}"
        upper += lines_of_rows(name, curve["x"], curve["measured"], curve["sd"], colour, as_dots=True)
        upper.append(Line("" if number else "model", curve["line_x"], curve["line_y"], colour=DATA_COLOUR, dash=int(held_out)))
        lower += lines_of_rows("", curve["x"], curve["measured"] - curve["predicted"], curve["sd"], colour, as_dots=True)
    values = ", ".join(f"{constant_name(key)} = {value:.4g}{unit_of_constant(key)}" for key, value in constants.items())
    x_label, y_label = curves[0]["x_label"], curves[0]["y_label"]
    figure = new_figure(WIDTH_IN, 6.6)
    residuals = chart("", lower, x_label=x_label, y_label="measured − model")
    draw_charts(figure, [chart(f"{title}: {values}", upper, y_label=y_label), residuals], heights=[2.4, 1.0])
    save(figure, path)


def profiles(path: Path, title: str, rows: Sequence[ConstantProfile]) -> None:
    """Draw the profile likelihood of each constant, the parabola of the curvature, and the interval from noise alone."""
    figure = new_figure(WIDTH_IN, 4.2)
    draw_charts(figure, [profile_chart(row) for row in rows], len(rows))
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    save(figure, path)


def convergence(path: Path, title: str, trace: PaperTrace) -> None:
    """Draw the paper's iteration over the loads, with the last run in another colour, and its constants run by run."""
    runs, loads = len(trace["displacements_mm"]), trace["loads_N"]
    names = {0: "start", runs - 1: f"run {runs}"}
    lines = [
        Line(names.get(number, ""), row, loads, colour=LAST_RUN_COLOUR if number == runs - 1 else FIRST_RUNS_COLOUR)
        for number, row in enumerate(trace["displacements_mm"])
    ]
    lines.append(Line("measured", trace["measured_mm"], loads, "dots", DATA_COLOUR))
    constants = [
        Line(f"{name}, {values[-1]:.4g} Pa at the end", np.arange(1.0, runs + 1.0), values)
        for name, values in zip(("C10", "C20"), trace["constants"].T, strict=True)
    ]
    left = chart(f"{title}: the paper's iteration", lines, x_label="displacement (mm)", y_label="force (N)")
    right = chart("", constants, x_label="run", y_label="constant (Pa)", y_range=(0.0, 0.0))
    figure = new_figure(WIDTH_IN, 4.8)
    for axes, shown in zip(figure.subplots(1, 2, width_ratios=[1.5, 1.0]), (left, right), strict=True):
        if shown is not None:
            draw_chart(axes, shown)
            axes.legend(frameon=False, fontsize=9)
    save(figure, path)


def deformed(path: Path, title: str, shown: DeformedSpecimen) -> None:
    """Draw the specimen, cut through its axis, under the tool, coloured by strain energy density."""
    figure = new_figure(WIDTH_IN, 6.0)
    axes = figure.subplots()
    painted = paint_section(axes, shown["mesh"], shown["displacement_m"], shown["energy_Pa"], shown["tool"], shown["lowest_mm"])
    axes.set_title(f"{title}: {shown['load']}", loc="left", fontsize=11)
    bar = figure.colorbar(painted, ax=axes, orientation="horizontal", shrink=0.6, aspect=40, extend="max")
    bar.set_label(ENERGY_LABEL)
    save(figure, path)
