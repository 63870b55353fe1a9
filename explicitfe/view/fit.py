"""Pictures of an identification as PNG files, from plain numbers in the units of the axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.view.indentation import SHOWN, paint_section

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN, DPI = 10.0, 160
# Okabe and Ito's colours, told apart with every kind of colour blindness.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "black")
MARKERS = "os^Dv"
GRID = "0.88"
MANY = 40  # rows: more are drawn as a line of dots, without error bars
THRESHOLD = 3.84  # of chi2, 95 %
NAMES = {"C10_Pa": "C10", "C20_Pa": "C20"}


def fit(path: Path, title: str, curves: Sequence[Mapping[str, Any]], constants: Sequence[float]) -> None:
    """Measured with error bars against the fitted model, and what is left.

    Parameters
    ----------
    curves : each with id, split, x_label, y_label, x, measured, sd, predicted, line_x, line_y.
    """
    figure = _figure(6.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2.4, 1.0])
    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        held = curve["split"] == "holdout"
        label = f"{curve['id']}{', only predicted' if held else ''}"
        face = "none" if held else colour
        rest = curve["measured"] - curve["predicted"]
        for axes, values in ((upper, curve["measured"]), (lower, rest)):
            named = label if axes is upper else None
            if len(values) > MANY:
                axes.plot(curve["x"], values, ".", ms=2.5, color=colour, mfc=face, alpha=0.6, label=named)
            else:
                style = {
                    "fmt": MARKERS[number // len(COLOURS) % len(MARKERS)],
                    "ms": 5,
                    "color": colour,
                    "mfc": face,
                    "capsize": 3,
                    "lw": 1.0,
                }
                axes.errorbar(curve["x"], values, 2.0 * curve["sd"], label=named, **style)
        upper.plot(curve["line_x"], curve["line_y"], "--" if held else "-", color="black", lw=1.2, zorder=3)
    upper.plot([], [], "-", color="black", lw=1.2, label="model")
    upper.set_ylabel(curves[0]["y_label"])
    lower.axhline(0.0, color="black", lw=0.8)
    lower.set_ylabel("measured − model")
    lower.set_xlabel(curves[0]["x_label"])
    upper.set_title(f"{title}: C10 = {constants[0]:.4g} Pa, C20 = {constants[1]:.4g} Pa", loc="left", fontsize=11)
    bars = any(curve["sd"].any() and len(curve["x"]) <= MANY for curve in curves)
    head = "bars: two standard deviations" if bars else None
    upper.legend(frameon=False, fontsize=8, ncols=1 + len(curves) // 8, title=head, title_fontsize=8, alignment="left")
    for axes in (upper, lower):
        _plain(axes)
    _save(figure, path)


def profiles(path: Path, title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Profile likelihood of each constant beside the parabola of the curvature.

    Parameters
    ----------
    rows : each with name, best, sd, values, rise, ci95.
    """
    figure = _figure(4.2)
    for axes, row in zip(figure.subplots(1, len(rows), squeeze=False)[0], rows, strict=True):
        values, name = row["values"], NAMES.get(row["name"], row["name"])
        axes.plot(values, row["rise"], color=COLOURS[0], lw=2.0, label="profile likelihood")
        if row["sd"] > 0.0:
            parabola = ((values - row["best"]) / row["sd"]) ** 2
            axes.plot(values, parabola, "--", color=COLOURS[1], lw=1.5, label="curvature at the optimum")
        axes.axhline(THRESHOLD, color="0.4", lw=0.9)
        axes.annotate(
            "95 %", (0.99, THRESHOLD), xycoords=("axes fraction", "data"), ha="right", va="bottom", color="0.3", fontsize=8
        )
        low, high = row["ci95"]
        axes.axvspan(max(low, values[0]), min(high, values[-1]), color="0.94", lw=0, zorder=-1)
        axes.set_ylim(0.0, 10.0)
        axes.set_xlim(values[0], values[-1])
        axes.set_xlabel(f"{name} (Pa)")
        axes.set_title(f"{name} = {row['best']:.4g} Pa, 95 %: {low:.4g} to {high:.4g}", loc="left", fontsize=10)
        _plain(axes)
    figure.axes[0].set_ylabel("rise of χ² above its least")
    figure.axes[0].legend(frameon=False, fontsize=8, loc="upper center")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    _save(figure, path)


def convergence(path: Path, title: str, trace: Mapping[str, Any]) -> None:
    """The paper's iteration over the loads, from light to dark, and its constants run by run.

    Parameters
    ----------
    trace : loads_N (k,), measured_mm (k,), displacements_mm (n, k), changed (n), constants (n, 2) Pa.
    """
    from matplotlib import colormaps

    figure = _figure(4.8)
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
        _plain(axes)
    _save(figure, path)


def deformed(path: Path, title: str, shown: Mapping[str, Any]) -> None:
    """The specimen cut through its axis under the tool, by strain energy density.

    Parameters
    ----------
    shown : mesh, displacement_m, energy_Pa (m,), tool as a scenario has it, lowest_mm of the tool, load in words.
    """
    figure = _figure(6.0)
    axes = figure.subplots()
    painted = paint_section(axes, shown["mesh"], shown["displacement_m"], shown["energy_Pa"], shown["tool"], shown["lowest_mm"])
    axes.set_title(f"{title}: {shown['load']}", loc="left", fontsize=11)
    bar = figure.colorbar(painted, ax=axes, orientation="horizontal", shrink=0.6, aspect=40, extend="max")
    bar.set_label(f"strain energy density (Pa), up to what {100 * SHOWN:.0f} % of the section stay below")
    _save(figure, path)


def materials(path: Path, panels: Mapping[str, Sequence[Mapping[str, Any]]], heads: Mapping[str, str]) -> None:
    """Several groups of constants side by side: measured curves, fitted and held out, the model of each, and what is left.

    Parameters
    ----------
    panels : name -> curves, each with split, x, measured, line_x, line_y (the model at x), x_label, y_label.
    heads : name -> a line in words.
    """
    count = len(panels)
    columns = min(3, count)
    rows = -(-count // columns)
    figure = _figure(4.6 * rows)
    grid = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.0, 1.0] * rows)
    for number, (name, curves) in enumerate(panels.items()):
        row, column = divmod(number, columns)
        upper, lower = grid[2 * row, column], grid[2 * row + 1, column]
        for side, colour in (("fit", COLOURS[0]), ("holdout", COLOURS[1])):
            label: str | None = {"fit": "fitted", "holdout": "only predicted"}[side]
            for curve in (c for c in curves if c["split"] == side):
                upper.plot(curve["x"], curve["measured"], color=colour, lw=1.6, label=label)
                rest = 100.0 * (curve["measured"] - curve["line_y"]) / np.abs(curve["measured"]).max()
                lower.plot(curve["x"], rest, color=colour, lw=1.2)
                label = None
        upper.plot(curves[0]["line_x"], curves[0]["line_y"], "--", color="black", lw=1.4, label="model")
        upper.set_title(f"{name}\n{heads[name]}", loc="left", fontsize=9)
        upper.set_ylabel(curves[0]["y_label"])
        upper.tick_params(labelbottom=False)
        lower.axhline(0.0, color="black", lw=0.8)
        lower.set_ylabel("left (% of\nthe largest)", fontsize=9)
        lower.set_xlabel(curves[0]["x_label"])
        for axes in (upper, lower):
            _plain(axes)
    grid[0, 0].legend(frameon=False, fontsize=8)
    for number in range(count, rows * columns):
        row, column = divmod(number, columns)
        grid[2 * row, column].remove()
        grid[2 * row + 1, column].remove()
    _save(figure, path)


def _figure(height_in: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained")


def _plain(axes: Axes) -> None:
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _save(figure: Figure, path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).print_png(path)
