"""Pictures of an identification as PNG files, from plain numbers in the units of the axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from explicitfe.app.view.indentation import ENERGY_LABEL, paint_section
from explicitfe.app.view.page import words
from explicitfe.app.view.palette import COLOURS, WIDTH_IN, new_figure, plain, save
from explicitfe.results.documents.fitted_curves import ConstantProfile, DeformedSpecimen, FittedCurve, GroupCurve, PaperTrace

MARKERS = "os^Dv"
# A curve with more rows is drawn as a line of dots without error bars, which would hide it.
ROWS_WITH_ERROR_BARS = 40
# A constant with this rise of chi squared stands at an end of its 95 % interval: the quantile of one degree of freedom.
CHI2_RISE_95_PERCENT = 3.84


def constant_name(key: str) -> str:
    """Name of a constant without its unit."""
    return key.removesuffix("_Pa")


def unit_of_constant(key: str) -> str:
    """ " Pa", or nothing for a constant without a unit."""
    return " Pa" if key.endswith("_Pa") else ""


def fit(path: Path, title: str, curves: Sequence[FittedCurve], constants: Mapping[str, float]) -> None:
    """Draw measured curves with error bars, the fitted model, and the residual; ``constants`` go into the title."""
    figure = new_figure(WIDTH_IN, 6.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2.4, 1.0])
    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        held = curve["split"] == "holdout"
        label = f"{curve['id']}{', only predicted' if held else ''}"
        face = "none" if held else colour
        residual = curve["measured"] - curve["predicted"]
        for axes, values in ((upper, curve["measured"]), (lower, residual)):
            named = label if axes is upper else None
            if len(values) > ROWS_WITH_ERROR_BARS:
                axes.plot(curve["x"], values, ".", ms=2.5, color=colour, mfc=face, alpha=0.6, label=named)
            else:
                axes.errorbar(
                    curve["x"],
                    values,
                    2.0 * curve["sd"],
                    label=named,
                    fmt=MARKERS[number // len(COLOURS) % len(MARKERS)],
                    ms=5,
                    color=colour,
                    mfc=face,
                    capsize=3,
                    lw=1.0,
                )
        upper.plot(curve["line_x"], curve["line_y"], "--" if held else "-", color="black", lw=1.2, zorder=3)
    upper.plot([], [], "-", color="black", lw=1.2, label="model")
    upper.set_ylabel(curves[0]["y_label"])
    lower.axhline(0.0, color="black", lw=0.8)
    lower.set_ylabel("measured − model")
    lower.set_xlabel(curves[0]["x_label"])
    values = ", ".join(f"{constant_name(key)} = {value:.4g}{unit_of_constant(key)}" for key, value in constants.items())
    upper.set_title(f"{title}: {values}", loc="left", fontsize=11 if len(constants) <= 3 else 9)
    bars = any(curve["sd"].any() and len(curve["x"]) <= ROWS_WITH_ERROR_BARS for curve in curves)
    head = "bars: two standard deviations" if bars else None
    upper.legend(frameon=False, fontsize=8, ncols=1 + len(curves) // 8, title=head, title_fontsize=8, alignment="left")
    for axes in (upper, lower):
        plain(axes)
    save(figure, path)


def profiles(path: Path, title: str, rows: Sequence[ConstantProfile]) -> None:
    """Draw the profile likelihood of each constant, the parabola of the curvature, and the interval from noise alone."""
    figure = new_figure(WIDTH_IN, 4.2)
    for axes, row in zip(figure.subplots(1, len(rows), squeeze=False)[0], rows, strict=True):
        values, name, unit = row["values"], constant_name(row["name"]), unit_of_constant(row["name"])
        wider = row["widened_by"]
        axes.plot(values, row["rise"], color=COLOURS[0], lw=2.0, label="profile likelihood")
        if row["sd"] > 0.0:
            parabola = ((values - row["best"]) / (wider * row["sd"])) ** 2
            axes.plot(values, parabola, "--", color=COLOURS[1], lw=1.5, label="curvature at the optimum")
            if wider > 1.0:
                half = CHI2_RISE_95_PERCENT**0.5 * row["sd"]
                label = f"95 % from independent noise alone ({words.number(wider, 2)} times narrower)"
                axes.axvspan(row["best"] - half, row["best"] + half, color="0.55", lw=1.5, zorder=0.5, label=label)
        axes.axhline(CHI2_RISE_95_PERCENT, color="0.4", lw=0.9)
        axes.annotate(
            "95 %",
            (0.99, CHI2_RISE_95_PERCENT),
            xycoords=("axes fraction", "data"),
            ha="right",
            va="bottom",
            color="0.3",
            fontsize=8,
        )
        low, high = row["ci95"]
        axes.axvspan(max(low, values[0]), min(high, values[-1]), color="0.94", lw=0, zorder=-1)
        axes.set_ylim(0.0, 10.0)
        axes.set_xlim(values[0], values[-1])
        axes.set_xlabel(f"{name} (Pa)" if unit else name)
        axes.set_title(f"{name} = {row['best']:.4g}{unit}, 95 %: {low:.4g} to {high:.4g}", loc="left", fontsize=10)
        plain(axes)
    wider = max(row["widened_by"] for row in rows)
    figure.axes[0].set_ylabel("increase of χ²" + (f" over {words.number(wider, 2)}²" if wider > 1.0 else ""))
    figure.axes[0].legend(frameon=False, fontsize=8, loc="upper center")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    save(figure, path)


def convergence(path: Path, title: str, trace: PaperTrace) -> None:
    """Draw the paper's iteration over the loads, from light to dark, and its constants run by run."""
    from matplotlib import colormaps

    figure = new_figure(WIDTH_IN, 4.8)
    left, right = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
    runs = len(trace["displacements_mm"])
    for number, row in enumerate(trace["displacements_mm"]):
        last = number == runs - 1
        colour = COLOURS[1] if last else colormaps["Blues"](0.2 + 0.55 * number / max(runs - 1, 1))
        label = {0: "start", runs - 1: f"run {runs}"}.get(number)
        left.plot(row, trace["loads_N"], "-", color=colour, lw=2.0 if last else 1.1, label=label)
    left.plot(trace["measured_mm"], trace["loads_N"], "o", color="black", mfc="none", ms=7, label="measured")
    left.set_xlabel("displacement (mm)")
    left.set_ylabel("force (N)")
    left.legend(frameon=False, fontsize=9)
    left.set_title(f"{title}: the paper's iteration", loc="left", fontsize=11)
    at = np.arange(1, runs + 1)
    for k, name in enumerate(("C10", "C20")):
        right.plot(
            at,
            trace["constants"][:, k],
            "-o",
            ms=4,
            color=COLOURS[k],
            label=f"{name}, {trace['constants'][-1, k]:.4g} Pa at the end",
        )
    right.set_xlabel("run")
    right.set_ylabel("constant (Pa)")
    right.set_ylim(bottom=0.0)
    right.legend(frameon=False, fontsize=9)
    for axes in (left, right):
        plain(axes)
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


def materials(path: Path, panels: Mapping[str, Sequence[GroupCurve]], heads: Mapping[str, str]) -> None:
    """Draw groups of constants side by side: measured curves, fitted and held out, the model of each, and what is left.

    Parameters
    ----------
    panels : name of a group -> its curves, with the model at the measured rows.
    heads : name of a group -> a line in words.
    """
    count = len(panels)
    columns = min(3, count)
    rows = -(-count // columns)
    figure = new_figure(WIDTH_IN, 4.6 * rows)
    grid = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.0, 1.0] * rows)
    for number, (name, curves) in enumerate(panels.items()):
        row, column = divmod(number, columns)
        upper, lower = grid[2 * row, column], grid[2 * row + 1, column]
        for side, colour in (("fit", COLOURS[0]), ("holdout", COLOURS[1])):
            label: str | None = {"fit": "fitted", "holdout": "only predicted"}[side]
            for curve in (c for c in curves if c["split"] == side):
                upper.plot(curve["x"], curve["measured"], color=colour, lw=1.6, label=label)
                residual = 100.0 * (curve["measured"] - curve["line_y"]) / np.abs(curve["measured"]).max()
                lower.plot(curve["x"], residual, color=colour, lw=1.2)
                label = None
        upper.plot(curves[0]["line_x"], curves[0]["line_y"], "--", color="black", lw=1.4, label="model")
        upper.set_title(f"{name}\n{heads[name]}", loc="left", fontsize=9)
        upper.set_ylabel(curves[0]["y_label"])
        upper.tick_params(labelbottom=False)
        lower.axhline(0.0, color="black", lw=0.8)
        lower.set_ylabel("left (% of\nthe largest)", fontsize=9)
        lower.set_xlabel(curves[0]["x_label"])
        for axes in (upper, lower):
            plain(axes)
    grid[0, 0].legend(frameon=False, fontsize=8)
    for number in range(count, rows * columns):
        row, column = divmod(number, columns)
        grid[2 * row, column].remove()
        grid[2 * row + 1, column].remove()
    save(figure, path)
