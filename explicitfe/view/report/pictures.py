"""The pictures of a report: curves before and after, what is left of them, candidates, and what is assumed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.results.loop_report import AssumedValue, LoopReport, estimates
from explicitfe.results.verdict_text import effect_title
from explicitfe.view.palette import AFTER, BEFORE, COLOURS, new_figure, plain
from explicitfe.view.report.axis import place_rows, spread_rows
from explicitfe.view.report.reading import DrawnCurve, assumed_values, by_drop, has_changed, noise_is_known, was_scored
from explicitfe.view.report.words import (
    SUPERSCRIPTS,
    TRIAL_DROP,
    bare,
    chance,
    finite,
    model_names,
    percent,
    quantity,
    shortened,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE_DOTS_PER_INCH = 180
SIGNIFICANT, NOT_SIGNIFICANT = COLOURS[5], "0.6"
# The first picture shows so many curves: one large and three beside it fill a screen.
CURVES_SHOWN_FIRST = 4
# Curves of at most so many rows get larger dots: each row is a measurement by itself.
ROWS_DRAWN_LARGE = 30
# The residual of a curve with more rows is drawn as its running mean, with every row faint behind it.
ROWS_WITHOUT_MEAN = 200
# Up to so many standard deviations a linear scale shows both the noise and the misfit.
LINEAR_SCALE_SD = 20.0


def before_after(report: LoopReport, curves: Sequence[DrawnCurve]) -> Figure:
    """The most telling curve large, and up to three more beside it."""
    figure = new_figure(9.2, 6.1, PAGE_DOTS_PER_INCH)
    curves = curves[:CURVES_SHOWN_FIRST]
    if not curves:
        return _only_words(figure, "No curve to show.")
    changed = has_changed(report)
    grid = figure.add_gridspec(max(len(curves) - 1, 1), 2 if len(curves) > 1 else 1, width_ratios=[1.75, 1.0][: len(curves)])
    names = model_names(report)
    for number, curve in enumerate(curves):
        large = number == 0
        axes = figure.add_subplot(grid[:, 0] if large else grid[number - 1, 1])
        at, measured = place_rows(axes, curve, ticks=5 if large else 4), curve.measured
        for key, values, colour, line, name in (
            ("before", curve.before, BEFORE, "--", names[0]),
            ("after", curve.after, AFTER, "-", names[1]),
        ):
            if values is not None and (changed or key == "before"):
                axes.plot(at, values, line, color=colour, lw=2.2 if large else 1.5, label=f"{key}: {name}" if changed else name)
        dots = spread_rows(at, measured, 70 if large else 36)
        axes.plot(
            at[dots],
            measured[dots],
            "o",
            color="black",
            ms=(3.4 if large else 2.2) + 2.0 * (len(at) <= ROWS_DRAWN_LARGE),
            mew=0,
            label="measured",
            zorder=3,
        )
        if large or curve.y_label != curves[0].y_label:
            axes.set_ylabel(curve.y_label, fontsize=10 if large else 8)
        axes.set_title(
            shortened(curve.name, 58 if large else 36) + _score_line(report, curve, changed),
            loc="left",
            fontsize=10 if large else 8,
        )
        axes.tick_params(labelsize=9 if large else 7.5)
        axes.xaxis.label.set_fontsize(10 if large else 8)
        plain(axes)
        axes.margins(y=0.06)
    for axes, below in zip(figure.axes[1:], figure.axes[2:], strict=False):
        if axes.get_xlabel() == below.get_xlabel():
            axes.set_xlabel("")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles[::-1][:1] + handles[:-1],
        labels[::-1][:1] + labels[:-1],
        loc="outside upper left",
        ncols=3,
        frameon=False,
        fontsize=10,
    )
    return figure


def _score_line(report: LoopReport, curve: DrawnCurve, changed: bool) -> str:
    """The second line of a panel's title: which part of the split it is, and its errors."""
    models = (report.baseline, report.final) if changed else (report.baseline,)
    rows = [model.error.curves.get(curve.name) for model in models]
    errors = [row and row.nrmse for row in rows]
    text = f": error {' → '.join(percent(x) for x in errors)}" if all(map(finite, errors)) else ""
    return f"\n{'held out' if curve.held_out else 'fitted'}{text}"


def residuals(report: LoopReport, curves: Sequence[DrawnCurve]) -> Figure:
    """Measured minus model of all curves over time, in standard deviations of the noise where all are known."""
    columns = min(4, max(len(curves), 1))
    rows = -(-len(curves) // columns)
    figure = new_figure(11.8, 0.8 + 1.45 * rows if len(curves) > 2 else 3.2, PAGE_DOTS_PER_INCH)
    if not curves:
        return _only_words(figure, "No curve to show.")
    changed, whitened = has_changed(report), noise_is_known(curves)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    largest = 0.0
    for axes, curve in zip(grid.flat, curves, strict=False):
        at = place_rows(axes, curve, ticks=4, over_time=True)
        scale = curve.noise if whitened else np.nanmax(np.abs(curve.measured)) / 100.0 or 1.0
        for key, model, colour, line in (("before", curve.before, BEFORE, "--"), ("after", curve.after, AFTER, "-")):
            if model is None or (key == "after" and not changed):
                continue
            residual = (curve.measured - model) / scale
            largest = max(largest, float(np.nanmax(np.abs(residual))) if np.isfinite(residual).any() else 0.0)
            if len(at) > ROWS_WITHOUT_MEAN:
                axes.plot(at, residual, color=colour, lw=0.5, alpha=0.25)
                residual = _running_mean(residual, len(at) // 60)  # the caption says: a sixtieth
            axes.plot(at, residual, line, color=colour, lw=1.3, label=key if changed else model_names(report)[0])
        if whitened:
            axes.axhspan(-2.0, 2.0, color="0.9", lw=0, zorder=-1)
        axes.axhline(0.0, color="black", lw=0.7)
        held = "held out: " if curve.held_out else ""
        axes.set_title(held + shortened(curve.name, 38 - len(held)), loc="left", fontsize=8, weight="bold" if held else "normal")
        axes.tick_params(labelsize=7.5)
        axes.xaxis.label.set_fontsize(8)
        plain(axes)
    for axes in grid.flat[len(curves) :]:
        axes.remove()
    for above, below in zip(grid.flat, grid.flat[columns : len(curves)], strict=False):
        if above.get_xlabel() == below.get_xlabel():
            above.set_xlabel("")
    if whitened:
        _scale_by_noise(grid[0, 0], largest)
    for axes in grid[:, 0]:
        axes.set_ylabel("left (sd of noise)" if whitened else "left (%)", fontsize=8)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure


def _running_mean(values: np.ndarray, width: int) -> np.ndarray:
    """Mean over ``width`` rows around each, over fewer at the ends."""
    weights = np.ones(width)
    return np.convolve(values, weights, "same") / np.convolve(np.ones(len(values)), weights, "same")


def _scale_by_noise(axes: Axes, largest: float) -> None:
    """Give a panel a scale that shows both two standard deviations and the largest misfit."""
    if largest <= LINEAR_SCALE_SD:
        axes.set_ylim(-1.1 * max(largest, 3.0), 1.1 * max(largest, 3.0))
        return
    decades = range(1, math.ceil(math.log10(largest)) + 1)
    ticks = [0.0, 2.0, *(10.0**k for k in decades)]
    ticks = [t for t in ticks if t <= 1.6 * largest]
    axes.set_yscale("symlog", linthresh=2.0, linscale=0.8)
    axes.set_ylim(-1.6 * largest, 1.6 * largest)
    shown = [*(-t for t in ticks[:0:-1]), *ticks]
    axes.set_yticks(shown, [bare(t) for t in shown])
    axes.minorticks_off()


def ranking(report: LoopReport) -> Figure:
    """The drop of chi squared of all candidates that could be tested, a column for each round of the search."""
    rounds = [[(row, row.effect, row.chi2_drop) for row in one.candidates if was_scored(row)] for one in report.steps]
    scored = [[(row, name, drop) for row, name, drop in rows if name and finite(drop)] for rows in rounds]
    names = list(dict.fromkeys(name for rows in scored for _, name, _ in sorted(rows, key=lambda entry: by_drop(entry[0]))))
    columns = [k for k, rows in enumerate(scored) if rows]
    figure = new_figure(5.2 + 2.6 * max(len(columns) - 1, 0), 1.1 + 0.3 * max(len(names), 3), PAGE_DOTS_PER_INCH)
    if not columns:
        return _only_words(figure, "No candidate was tested.")
    panels = figure.subplots(1, len(columns), sharey=True, sharex=True, squeeze=False)[0]
    top = max(drop for rows in scored for _, _, drop in rows)
    for axes, k in zip(panels, columns, strict=True):
        for row, name, drop in scored[k]:
            chosen = name == report.steps[k].chosen
            colour = AFTER if chosen else SIGNIFICANT if row.status == "significant" else NOT_SIGNIFICANT
            y, end = names.index(name), max(drop, 1.0)
            axes.plot([1.0, end], [y, y], color=colour, lw=3.0 if chosen else 2.0, solid_capstyle="butt")
            axes.plot([end], [y], "o", color=colour, ms=8 if chosen else 6)
            if finite(row.p_holm):
                text = f"p {chance(row.p_holm, row.p_is_bound, '= ')}{', added' if chosen else ''}"
                axes.annotate(text, (end, y), xytext=(7, 0), textcoords="offset points", va="center", fontsize=8, color="0.25")
        axes.set_xscale("log")
        axes.set_xlim(1.0, max(top, 10.0) ** 1.5 * 1.5)
        powers = [10.0**n for n in range(math.ceil(math.log10(max(top, 10.0))) + 1)]
        axes.set_xticks(powers, ["1", "10", *(f"10{str(n).translate(SUPERSCRIPTS)}" for n in range(2, len(powers)))], fontsize=8)
        axes.minorticks_off()
        axes.set_title(f"round {k + 1}", loc="left", fontsize=10)
        axes.set_xlabel(TRIAL_DROP, fontsize=9)
        plain(axes)
        axes.grid(axis="y", visible=False)
    panels[0].set_yticks(range(len(names)), [shortened(effect_title(report, name), 40) for name in names], fontsize=9)
    panels[0].set_ylim(len(names) - 0.4, -0.6)
    return figure


def sensitivity(report: LoopReport) -> Figure:
    """Constants (as multiples of those of the report) and the error of the fit over each assumed quantity."""
    tables = {key: sorted(rows, key=_value_order) for key, rows in assumed_values(report).items()}
    reference = estimates(report.final.parameters or report.baseline.parameters)
    columns = min(len(tables), 4)
    rows = -(-len(tables) // columns)
    figure = new_figure(max(3.2 * columns, 4.6), 3.9 * rows, PAGE_DOTS_PER_INCH)
    grid = figure.subplots(2 * rows, columns, squeeze=False, sharey="row", height_ratios=[1.4, 1.0] * rows)
    colours = [COLOURS[0], COLOURS[2], COLOURS[3], COLOURS[4], COLOURS[5], "black"]
    order = [key for key in reference if "." not in key[0]] or list(reference)
    for number, (key, table) in enumerate(tables.items()):
        upper, lower = (grid[2 * (number // columns) + k, number % columns] for k in (0, 1))
        values = [row.value for row in table]
        numeric = all(map(finite, values))
        at = np.asarray(values, dtype=float) if numeric else np.arange(len(values), dtype=float)
        same = np.array([(row.verdict, row.effects) == (report.verdict, report.effects) for row in table])
        fits = [estimates(row.parameters) for row in table]
        for name, colour in zip(order, colours, strict=False):
            usual = reference[name].value
            fitted = [fit[name].value if name in fit else None for fit in fits]
            if finite(usual) and usual and any(map(finite, fitted)):
                times = np.array([x / usual if finite(x) else np.nan for x in fitted])
                label = f"{quantity(report, name[0]).split(' (')[0]}{f', {name[1]}' if name[1] else ''}"
                _plot_marked(upper, at, times, same, colour, shortened(label, 24))
        errors = np.array([100.0 * row.error_fit if finite(row.error_fit) else np.nan for row in table])
        _plot_marked(lower, at, errors, same, "black", "")
        upper.axhline(1.0, color="0.5", lw=0.8)
        lower.set_xlabel(quantity(report, key), fontsize=9)
        marks = [bare(value) if numeric else shortened(value, 14) for value in values]
        for axes in (upper, lower):
            axes.set_xticks(at, marks if axes is lower else [""] * len(at))
            axes.tick_params(labelsize=8)
            axes.margins(x=0.1)
            plain(axes)
    for axes in grid[::2, 0]:
        axes.set_ylabel("constant, times\nthe one above", fontsize=9)
        axes.set_ylim(min(0.9, axes.get_ylim()[0]), max(1.1, axes.get_ylim()[1]))  # a change of one per cent looks small
    for axes in grid[1::2, 0]:
        axes.set_ylabel("error of\nthe fit (%)", fontsize=9)
        axes.set_ylim(bottom=0.0)
    for number in range(len(tables), rows * columns):
        for k in (0, 1):
            grid[2 * (number // columns) + k, number % columns].remove()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=min(len(labels), 3), frameon=False, fontsize=8)
    return figure


def _value_order(row: AssumedValue) -> float:
    """Where a row stands among others: numbers in their order, then words in their own."""
    return float(row.value) if finite(row.value) else math.inf


def _plot_marked(axes: Axes, at: np.ndarray, values: np.ndarray, same: np.ndarray, colour: str, label: str) -> None:
    """Draw a line with filled marks, and with open ones where the verdict is another."""
    axes.plot(at, values, "-", color=colour, lw=1.2)
    axes.plot(at[same], values[same], "o", color=colour, ms=5, label=label or None)
    axes.plot(at[~same], values[~same], "o", color=BEFORE, mfc="white", mew=1.6, ms=6, zorder=3)


def _only_words(figure: Figure, words: str) -> Figure:
    """The figure with words in its middle."""
    figure.text(0.5, 0.5, words, ha="center", va="center", color="0.4")
    return figure
