"""The pictures of a report: probabilities of the causes, curves before and after, residuals, and what is assumed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.page.close_loop.axis import place_rows, spread_rows
from explicitfe.app.view.page.close_loop.reading import DrawnCurve, assumed_values, has_changed, noise_is_known
from explicitfe.app.view.page.words import bare, finite, model_names, percent, quantity, shortened
from explicitfe.app.view.palette import AFTER, BEFORE, COLOURS, new_figure, plain
from explicitfe.results.documents.loop_report import AssumedValue, LoopReport, estimates
from explicitfe.results.documents.verdict_text import NOTHING, cause_title, named_forms, probability

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE_DOTS_PER_INCH = 180
# Colour of a cause by the decision on it, of something that no candidate describes, and of nothing.
DECISIONS = {"present": AFTER, "undecided": COLOURS[4], "absent": "0.6"}
ELSE_COLOUR, NOTHING_COLOUR = BEFORE, COLOURS[2]
# The picture of the causes has at most so many bars for causes; the table below has all of them.
MOST_CAUSES_DRAWN = 12
# Parts of a bar, one for each form, are so opaque; a letter of their names takes this share of the axis.
FORM_OPACITIES, LETTER_SHARE = (1.0, 0.65, 0.4, 0.25), 0.0125
# The first picture shows so many curves: one large and three beside it fill a screen.
CURVES_SHOWN_FIRST = 4
# Curves of at most so many rows get larger dots: each row is a measurement by itself.
ROWS_DRAWN_LARGE = 30
# The residual of a curve with more rows is drawn as its running mean, with every row faint behind it.
ROWS_WITHOUT_MEAN = 200
# Up to so many standard deviations a linear scale shows both the noise and the misfit.
LINEAR_SCALE_SD = 20.0


def causes(report: LoopReport) -> Figure:
    """The probability of each cause as a bar, with a part for each form, and of something else and of nothing."""
    tested = [(name, one, one.probability) for name, one in report.causes.items() if one.decision != "not-testable"]
    known = sorted([(name, one, p) for name, one, p in tested if finite(p)], key=lambda row: -row[2])[:MOST_CAUSES_DRAWN]
    bars = [(cause_title(report, n), p, DECISIONS.get(one.decision or "", "0.6"), named_forms(report, n)) for n, one, p in known]
    nothing = report.posterior.get(NOTHING, 0.0) if report.posterior else None
    others = [
        ("something else", report.something_else, ELSE_COLOUR),
        ("nothing is missing", nothing, NOTHING_COLOUR),
    ]
    bars += [(title, p, colour, {}) for title, p, colour in others if finite(p)]
    figure = new_figure(9.2, 1.1 + 0.4 * max(len(bars), 3), PAGE_DOTS_PER_INCH)
    if not bars:
        return _only_words(figure, "No cause was compared.")
    axes = figure.add_subplot()
    places = [k + 0.5 * (k >= len(known)) for k in range(len(bars))]
    for y, (_, p, colour, forms) in zip(places, bars, strict=True):
        _bar_of_forms(axes, y, p, colour, forms)
    stated = report.thresholds.get("decisive_probability")
    decisive = stated.value if stated and finite(stated.value) else 0.9
    for limit in (1.0 - decisive, decisive):
        axes.axvline(limit, color="0.35", lw=1.0, ls=":", zorder=0)
    axes.set_yticks(places, [shortened(title, 40) for title, *_ in bars], fontsize=10)
    axes.set_ylim(places[-1] + 0.6, -0.6)
    axes.set_xlim(0.0, 1.1)
    marks = [0.0, 1.0 - decisive, 0.5, decisive, 1.0]
    axes.set_xticks(marks, [bare(x) for x in marks], fontsize=9)
    axes.set_xlabel("probability that the cause is present", fontsize=10)
    plain(axes)
    axes.grid(visible=False)
    for decision in dict.fromkeys(one.decision for _, one, _ in known):
        if decision in DECISIONS:
            axes.bar(0.0, 0.0, color=DECISIONS[decision], label=decision)
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    return figure


def _bar_of_forms(axes: Axes, y: float, p: float, colour: str, forms: dict[str, float]) -> None:
    """A bar with a part for each form; names that do not fit into their part stand behind the bar if there is room."""
    start, behind = 0.0, ""
    axes.barh(y, p, height=0.62, color=colour, alpha=FORM_OPACITIES[-1] if forms else 1.0, lw=0)
    for k, (form, share) in enumerate((form, share) for form, share in forms.items() if finite(share)):
        width = max(min(share, p - start), 0.0)
        opacity = FORM_OPACITIES[min(k, len(FORM_OPACITIES) - 1)]
        axes.barh(y, width, left=start, height=0.62, color=colour, alpha=opacity, lw=0)
        text = f"{form} {probability(share)}"
        if LETTER_SHARE * len(text) < width:
            axes.text(start + 0.008, y, text, va="center", fontsize=8.5, color="white" if k == 0 and colour == AFTER else "black")
        elif p + LETTER_SHARE * len(f"{probability(p)}: {behind}, {text}") < 1.1:
            behind += f"{', ' if behind else ': '}{text}"
        start += width
    box = {"color": "white", "pad": 1.0}  # a line of a limit does not cross the words
    axes.text(p + 0.008, y, probability(p) + behind, va="center", fontsize=9, color="0.2", bbox=box)


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
