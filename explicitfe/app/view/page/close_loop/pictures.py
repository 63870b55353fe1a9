"""Charts of a report: probabilities of the causes, curves before and after, residuals, and what is assumed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from explicitfe.app.view.chart_figure import draw_charts
from explicitfe.app.view.page.chart import COLOUR_COUNT, Chart, Line, chart
from explicitfe.app.view.page.close_loop.axis import abscissa_of, spread_rows
from explicitfe.app.view.page.close_loop.reading import assumed_values, has_changed, noise_is_known
from explicitfe.app.view.page.words import bare, finite, model_names, percent, quantity, shortened
from explicitfe.app.view.palette import AFTER, BEFORE, COLOURS, new_figure, plain
from explicitfe.results.documents.loop_report import AssumedValue, LoopReport, ReportCurve, estimates
from explicitfe.results.documents.verdict_text import NOTHING, cause_title, named_forms, probability

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE_DOTS_PER_INCH = 180
# Numbers of the colours of the models before and after effects were added, and of the data; kind of line of the former.
BEFORE_COLOUR, AFTER_COLOUR, DATA_COLOUR, BEFORE_DASH = 1, 0, COLOUR_COUNT - 1, 1
# Colour of a cause by the decision on it, of something that no candidate describes, and of nothing.
BAR_COLOURS = {"present": AFTER, "undecided": COLOURS[4], "absent": "0.6", "else": BEFORE, "nothing": COLOURS[2]}
# The picture of the causes has at most so many bars for causes; the table below has all of them.
MOST_CAUSES_DRAWN = 12
# Parts of a bar, one for each form, are so opaque.
FORM_OPACITIES = (1.0, 0.65, 0.4, 0.25)
CURVES_SHOWN_FIRST = 4
MOST_DOTS_OF_A_CURVE = 70
# The residual of a curve with more rows is drawn as its running mean over this share of the rows, in the band of its extremes.
ROWS_WITHOUT_MEAN, SHARE_OF_A_MEAN = 200, 60
# Up to so many standard deviations a linear scale shows both the noise and the misfit; a larger misfit is drawn by its logarithm
# from two standard deviations on, where a decade takes as much room as this factor times one standard deviation.
LINEAR_SCALE_SD, SD_OF_A_DECADE = 20.0, 2.5
FIGURE_WIDTH_IN, ROW_OF_CHARTS_HEIGHT_IN = 11.8, 2.5


@dataclass(frozen=True)
class CauseBar:
    """A bar of a probability: its parts are the forms of the cause, as shares of the axis with an opacity.

    ``kind`` is a key of ``BAR_COLOURS``, ``forms`` the forms with their probabilities in words.
    """

    title: str
    kind: str
    probability: float
    parts: list[tuple[float, float, float]]
    forms: str

    @property
    def words(self) -> str:
        """The probability."""
        return probability(self.probability)


def cause_bars(report: LoopReport) -> list[CauseBar]:
    """The probability of each cause, of something else and of nothing."""
    tested = [(name, one, one.probability) for name, one in report.causes.items() if one.decision != "not-testable"]
    known = sorted([(name, one, p) for name, one, p in tested if finite(p)], key=lambda row: -row[2])[:MOST_CAUSES_DRAWN]
    kinds = [one.decision if one.decision in BAR_COLOURS else "absent" for _, one, _ in known]
    bars = [
        _bar(cause_title(report, name), kind, p, named_forms(report, name))
        for (name, _, p), kind in zip(known, kinds, strict=True)
    ]
    nothing = report.posterior.get(NOTHING, 0.0) if report.posterior else None
    others = (("something else", "else", report.something_else), ("nothing is missing", "nothing", nothing))
    return bars + [_bar(title, kind, p, {}) for title, kind, p in others if finite(p)]


def _bar(title: str, kind: str, p: float, forms: dict[str, float]) -> CauseBar:
    parts, start = [(0.0, p, FORM_OPACITIES[-1] if forms else 1.0)], 0.0
    for k, share in enumerate(filter(finite, forms.values())):
        width = max(min(share, p - start), 0.0)
        parts.append((start, width, FORM_OPACITIES[min(k, len(FORM_OPACITIES) - 1)]))
        start += width
    return CauseBar(title, kind, p, parts, ", ".join(f"{form} {probability(share)}" for form, share in forms.items()))


def decisive_limits(report: LoopReport) -> tuple[float, float]:
    """The probabilities below and above which a cause is decided to be absent and present."""
    stated = report.thresholds.get("decisive_probability")
    decisive = stated.value if stated and finite(stated.value) else 0.9
    return 1.0 - decisive, decisive


def causes_figure(report: LoopReport) -> Figure:
    """The bars of the causes."""
    bars = cause_bars(report)
    figure = new_figure(9.2, 1.1 + 0.4 * max(len(bars), 3), PAGE_DOTS_PER_INCH)
    if not bars:
        return _only_words(figure, "No cause was compared.")
    axes = figure.add_subplot()
    for y, bar in enumerate(bars):
        for start, width, opacity in bar.parts:
            axes.barh(y, width, left=start, height=0.62, color=BAR_COLOURS[bar.kind], alpha=opacity, lw=0)
        axes.text(1.02, y, f"{bar.words}{f': {shortened(bar.forms, 50)}' if bar.forms else ''}", va="center", fontsize=9)
    limits = decisive_limits(report)
    for limit in limits:
        axes.axvline(limit, color="0.35", lw=1.0, ls=":", zorder=0)
    axes.set_yticks(range(len(bars)), [shortened(bar.title, 40) for bar in bars], fontsize=10)
    axes.set_ylim(len(bars) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.0)
    axes.set_xticks((marks := [0.0, limits[0], 0.5, limits[1], 1.0]), [bare(x) for x in marks], fontsize=9)
    axes.set_xlabel("probability that the cause is present", fontsize=10)
    plain(axes)
    axes.grid(visible=False)
    for kind in [kind for kind in ("present", "undecided", "absent") if any(bar.kind == kind for bar in bars)]:
        axes.bar(0.0, 0.0, color=BAR_COLOURS[kind], label=kind)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    return figure


def figure_of(charts: Sequence[Chart | None], columns: int, otherwise: str = "No curve to show.") -> Figure:
    """Charts as one figure; without any, a sentence."""
    if not charts:
        return _only_words(new_figure(FIGURE_WIDTH_IN, ROW_OF_CHARTS_HEIGHT_IN, PAGE_DOTS_PER_INCH), otherwise)
    figure = new_figure(FIGURE_WIDTH_IN, 0.6 + ROW_OF_CHARTS_HEIGHT_IN * -(-len(charts) // columns), PAGE_DOTS_PER_INCH)
    draw_charts(figure, charts, columns)
    return figure


def _only_words(figure: Figure, words: str) -> Figure:
    figure.text(0.5, 0.5, words, ha="center", va="center", color="0.4")
    return figure


def _models(report: LoopReport, curve: ReportCurve) -> Iterator[tuple[str, np.ndarray, int, int]]:
    """Name, answer, colour and kind of line of each model."""
    changed, names = has_changed(report), model_names(report)
    if curve.before is not None:
        yield f"before: {names[0]}" if changed else names[0], curve.before, BEFORE_COLOUR, BEFORE_DASH
    if curve.after is not None and changed:
        yield f"after: {names[1]}", curve.after, AFTER_COLOUR, 0


def curve_charts(report: LoopReport, curves: Sequence[ReportCurve]) -> list[Chart]:
    """The most telling curves, measured and by each model."""
    charts = []
    for curve in curves[:CURVES_SHOWN_FIRST]:
        at, measured = abscissa_of(curve), curve.measured
        dots = spread_rows(at.x, measured, MOST_DOTS_OF_A_CURVE)
        lines = [Line(name, at.x, values, colour=colour, dash=dash) for name, values, colour, dash in _models(report, curve)]
        lines.append(Line("measured", at.x[dots], measured[dots], "dots", DATA_COLOUR))
        title = f"{shortened(curve.id, 58)}, {_score(report, curve)}"
        charts.append(chart(title, lines, x_label=at.label, y_label=curve.y_label, marks=(at.marks, ()), spans=at.shaded))
    return [one for one in charts if one is not None]


def _score(report: LoopReport, curve: ReportCurve) -> str:
    """Which part of the split a curve is, and its errors."""
    models = (report.baseline, report.final) if has_changed(report) else (report.baseline,)
    rows = [model.error.curves.get(curve.id) for model in models]
    errors = [row and row.nrmse for row in rows]
    text = f": error {' → '.join(percent(x) for x in errors)}" if all(map(finite, errors)) else ""
    return f"{'held out' if curve.held_out else 'fitted'}{text}"


def residual_charts(report: LoopReport, curves: Sequence[ReportCurve]) -> list[Chart]:
    """Measured minus model of all curves over time, in standard deviations of the noise where all are known."""
    in_noise = noise_is_known(curves)
    residuals = [_residuals(report, curve, in_noise) for curve in curves]
    largest = max((float(np.nanmax(np.abs(line.y), initial=0.0)) for own in residuals for line in own), default=0.0)
    is_scaled, reach = in_noise and largest > LINEAR_SCALE_SD, 1.1 * max(largest, 3.0 if in_noise else 0.0)
    ticks = [0.0, 2.0, *(10.0**k for k in range(1, math.ceil(math.log10(largest)) + 1))] if is_scaled else []
    marks = [
        (float(_by_logarithm(t)), bare(t).replace("-", "\N{MINUS SIGN}"))
        for t in [*(-t for t in ticks[:0:-1]), *ticks]
        if abs(t) <= reach
    ]
    charts: list[Chart | None] = []
    for curve, own in zip(curves, residuals, strict=True):
        at = abscissa_of(curve, over_time=True)
        lines = [replace(line, x=at.x) for line in own]
        if in_noise:
            edge = np.full(len(at.x), 2.0)
            lines.append(Line("two standard deviations", at.x, -edge, "band", DATA_COLOUR, y_high=edge))
        if is_scaled:
            high = [None if line.y_high is None else _by_logarithm(line.y_high) for line in lines]
            lines = [replace(line, y=_by_logarithm(line.y), y_high=edge) for line, edge in zip(lines, high, strict=True)]
        if charts:  # one legend serves all
            lines = [replace(line, name="") for line in lines]
        title = f"{'held out: ' if curve.held_out else ''}{shortened(curve.id, 40)}"
        ends = np.array([-reach, reach])
        low, high_end = (_by_logarithm(ends) if is_scaled else ends).tolist()
        charts.append(
            chart(
                title,
                lines,
                x_label=at.label,
                y_label=f"residual ({'sd of noise' if in_noise else '%'})",
                y_range=(low, high_end) if reach > 0.0 else None,
                marks=(at.marks, marks),
                spans=at.shaded,
            )
        )
    return [one for one in charts if one is not None]


def _residuals(report: LoopReport, curve: ReportCurve, in_noise: bool) -> list[Line]:
    """Lines over the rows of a curve; that of many rows is their running mean, in a band of the extremes."""
    scale = curve.sd if in_noise else np.nanmax(np.abs(curve.measured)) / 100.0 or 1.0
    rows, lines = np.arange(len(curve.measured), dtype=float), []
    for name, model, colour, dash in _models(report, curve):
        residual = (curve.measured - model) / scale
        if len(rows) > ROWS_WITHOUT_MEAN:
            size = len(rows) // SHARE_OF_A_MEAN  # the caption says: a sixtieth
            low, high = (extreme(residual, size) for extreme in (scipy.ndimage.minimum_filter1d, scipy.ndimage.maximum_filter1d))
            lines.append(Line("", rows, low, "band", colour, y_high=high))
            residual = scipy.ndimage.uniform_filter1d(residual, size)
        lines.append(Line(name, rows, residual, colour=colour, dash=dash))
    return lines


def _by_logarithm(residual: np.ndarray | float) -> np.ndarray:
    """Residuals in standard deviations on a scale that is linear up to two of them, and logarithmic beyond."""
    size = np.abs(residual)
    beyond = 2.0 + SD_OF_A_DECADE * np.log10(np.maximum(size, 2.0) / 2.0)
    scaled: np.ndarray = np.sign(residual) * np.where(size <= 2.0, size, beyond)
    return scaled


def sensitivity_charts(report: LoopReport) -> list[Chart | None]:
    """Constants (as multiples of those of the report) and the error of the fit over each assumed quantity, two charts each."""
    reference = estimates(report.final.parameters or report.baseline.parameters)
    order = [key for key in reference if "." not in key[0]] or list(reference)
    colours = [k for k in range(COLOUR_COUNT) if k != BEFORE_COLOUR]
    charts = []
    for key, rows in assumed_values(report).items():
        rows = sorted(rows, key=_value_order)
        is_numeric = all(finite(row.value) for row in rows)
        at = np.array([row.value if is_numeric else k for k, row in enumerate(rows)], dtype=float)
        words = [bare(row.value) if is_numeric else shortened(row.value, 14) for row in rows]
        differs = np.array([(row.verdict, row.effects) != (report.verdict, report.effects) for row in rows])
        constants: list[Line] = []
        for name, colour in zip(order, colours, strict=False):
            usual = reference[name].value
            fitted = [estimates(row.parameters).get(name) for row in rows]
            if finite(usual) and usual:
                times = np.array([one.value / usual if one and finite(one.value) else np.nan for one in fitted])
                label = f"{quantity(report, name[0]).split(' (')[0]}{f', {name[1]}' if name[1] else ''}"
                constants += _line_with_dots(shortened(label, 24), at, times, differs, colour)
        errors = np.array([100.0 * row.error_fit if finite(row.error_fit) else np.nan for row in rows])
        error_lines, x_label, x_marks = (
            _line_with_dots("", at, errors, differs, DATA_COLOUR),
            quantity(report, key),
            [*zip(at.tolist(), words, strict=True)],
        )
        charts += [
            chart("", constants, x_label=x_label, y_label="constant, times that above", y_range=(0.9, 1.1), marks=(x_marks, ())),
            chart("", error_lines, x_label=x_label, y_label="error of the fit (%)", y_range=(0.0, 0.0), marks=(x_marks, ())),
        ]
    return charts


def _value_order(row: AssumedValue) -> float:
    """Where a row stands among others: numbers in their order, then words in their own."""
    return float(row.value) if finite(row.value) else math.inf


def _line_with_dots(name: str, at: np.ndarray, values: np.ndarray, differs: np.ndarray, colour: int) -> list[Line]:
    """A line with dots, in the colour of ``before`` where the verdict is another."""
    other = Line("", at[differs], values[differs], "dots", BEFORE_COLOUR)
    return [Line(name, at, values, colour=colour), Line("", at, values, "dots", colour), other]
