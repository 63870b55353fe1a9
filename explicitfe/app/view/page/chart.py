"""Charts as data: the template of a page draws them as SVG without a script, ``chart_figure.py`` draws them with matplotlib.

Lines are drawn in a square of 1000 by 1000 that the page stretches to the room it has, while letters and widths of lines keep
their size: a chart can be read on a telephone and on paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from explicitfe.app.view.page.words import SUPERSCRIPTS

CHART_SIDE = 1000.0
# More points are not distinguishable on a screen; longer lines are reduced to their extremes.
MOST_POINTS_OF_A_LINE = 600
# Lines stay this share of the height away from the frame.
MARGIN_SHARE = 0.06
# Dots need room at the sides, or half of the first and the last one is cut off.
DOT_MARGIN_SHARE = 0.02
TICKS_WANTED = 6
# A logarithmic axis over more decades has fewer marks.
MOST_DECADES_MARKED = 6
DECADE_FACTOR = 10.0
# A span below this share of the numbers themselves is rounding.
ROUNDING_SHARE_OF_VALUE = 1e-12
COLOUR_COUNT = 7
DASH_COUNT = 4

Marks = Sequence[tuple[float, str]]
Drawn = Literal["line", "dots", "area", "band", "dark-band"]


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a chart.

    Attributes
    ----------
    name : in the legend; empty: it has no place there.
    x, y : (n,) NaN where the line is interrupted.
    drawn : as a line, as dots, as an area down to zero, or as a pale or dark band from y to ``y_high``.
    colour : number of its colour, from 0; None: by its place. "before" and "after" have colours of their own in pages of fits.
    dash : number of its kind of line, 0: solid.
    y_high : (n,) upper edge of a band; None for all others.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    drawn: Drawn = "line"
    colour: int | None = None
    dash: int = 0
    y_high: np.ndarray | None = None


@dataclass(frozen=True)
class Word:
    """A word in a chart: its place as percentages from the left and from the bottom, and the number of its colour."""

    left: str
    bottom: str
    text: str
    colour: int


@dataclass(frozen=True)
class Tick:
    """A mark of an axis: its place, the same as a percentage from the left or from the bottom, and its label."""

    value: float
    percent: str
    label: str


@dataclass(frozen=True, eq=False)
class DrawnLine(Line):
    """A line as it is drawn: ``pieces`` are the points of a polyline each, of no length for a dot.

    On a logarithmic axis, y are logarithms.
    """

    pieces: Sequence[str] = ()


@dataclass(frozen=True)
class Chart:
    """A chart as the template draws it.

    Attributes
    ----------
    title, x_label, y_label : with units; may be empty.
    x_range, y_range : values at the left and right, and at the bottom and top edge.
    x_ticks, y_ticks : marks; ``zero`` is where y = 0 lies, %; None where it is not within the chart.
    spans : shaded ranges, for example of muscle activity, % from the left; ``shaded`` are the same in units of x.
    follows : quantity of x, "time" or "indentation", if the player of the page marks the current value; otherwise empty.
    numerical : whether it is one of the checks of the numerical solution.
    words : written into the chart.
    """

    title: str
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    series: list[DrawnLine]
    zero: str | None = None
    spans: list[tuple[str, str]] = field(default_factory=list)
    shaded: Sequence[tuple[float, float]] = ()
    follows: str = ""
    logarithmic: bool = False
    numerical: bool = False
    words: list[Word] = field(default_factory=list)


def chart(
    title: str,
    series: Sequence[Line],
    *,
    x_label: str = "",
    y_label: str = "",
    x_range: tuple[float, float] | None = None,
    y_range: tuple[float, float] | None = None,
    logarithmic: bool = False,
    spans: Sequence[tuple[float, float]] = (),
    marks: tuple[Marks, Marks] = ((), ()),
    reversed_axes: bool = False,
    words: Sequence[tuple[float, float, str, int]] = (),
    alike: Sequence[Line] = (),
) -> Chart | None:
    """A chart of some series; None where no number is finite.

    Parameters
    ----------
    x_range, y_range : smallest ranges of the axes; by default those of the data.
    logarithmic : whether y is drawn by its logarithm; numbers that are not positive are left out.
    spans : parts of the x axis that are shaded, from and to.
    marks : places on the x and on the y axis with their labels; round numbers if left out.
    reversed_axes : whether both axes run to the left and down.
    words : written into the chart: x, y, text, number of the colour.
    alike : series of other charts, for which the axes have room as well.
    """
    if logarithmic:
        series, alike = (
            [replace(one, y=np.log10(np.where(one.y > 0.0, one.y, np.nan))) for one in lines] for lines in (series, alike)
        )
        y_range = None if y_range is None else (math.log10(y_range[0]), math.log10(y_range[1]))
    kept = [one for one in series if (np.isfinite(one.x) & np.isfinite(one.y)).any()]
    if not kept:
        return None
    has_dots = any(one.drawn == "dots" for one in kept)
    # Samples of which only one can be drawn, such as a share that is undefined at rest, span no range.
    across = [np.array(x_range)] if x_range else [one.x for one in (*kept, *alike)]
    left, right = _span(across, DOT_MARGIN_SHARE if has_dots and not x_range else 0.0)
    with_zero = [reached(one) for one in (*kept, *alike)]
    bottom, top = _span([*with_zero, np.array(y_range or [])], MARGIN_SHARE)
    x_marks = marks[0] or list(zip(*round_ticks(left, right), strict=True))
    y_marks = marks[1] or list(zip(*(_decades(bottom, top) if logarithmic else round_ticks(bottom, top)), strict=True))
    if reversed_axes:
        left, right, bottom, top = right, left, top, bottom
    placed = [
        DrawnLine(
            one.name,
            one.x,
            one.y,
            one.drawn,
            (number if one.colour is None else one.colour) % COLOUR_COUNT,
            one.dash % DASH_COUNT,
            one.y_high,
            _pieces(one, (left, right), (bottom, top)),
        )
        for number, one in enumerate(kept)
    ]
    return Chart(
        title,
        x_label,
        y_label,
        (left, right),
        (bottom, top),
        [Tick(value, _percent(value, left, right), label) for value, label in x_marks],
        [Tick(value, _percent(value, bottom, top), label) for value, label in y_marks],
        placed,
        None if logarithmic or not bottom < 0.0 < top else _percent(0.0, bottom, top),
        [(_percent(max(a, left), left, right), _percent(min(b, right), left, right)) for a, b in spans if b > left and a < right],
        spans,
        logarithmic=logarithmic,
        words=[Word(_percent(x, left, right), _percent(y, bottom, top), text, colour) for x, y, text, colour in words],
    )


def round_ticks(low: float, high: float, wanted: int = TICKS_WANTED) -> tuple[list[float], list[str]]:
    """Round numbers from ``low`` to ``high``, about as many as wanted, and their labels."""
    step = 10.0 ** math.floor(math.log10((high - low) / wanted))
    factor = next(f for f in (1.0, 2.0, 5.0, 10.0) if (high - low) / (f * step) <= wanted)
    step *= factor
    numbers = [step * k for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    largest = max(map(abs, numbers), default=0.0)
    if digits > 4 or largest >= 1e5:
        places = math.floor(math.log10(largest) + 1e-9) - math.floor(math.log10(step) + 1e-9) if largest else 0
        return numbers, [f"{x:.{max(0, places)}e}" if x else "0" for x in numbers]
    return numbers, [f"{x + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}") for x in numbers]


def _decades(low: float, high: float) -> tuple[list[float], list[str]]:
    """Powers of ten, by their exponents."""
    exponents = list(range(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1))
    if len(exponents) < 2:
        every = [math.log10(m) + k for k in range(math.floor(low), math.ceil(high)) for m in (1, 2, 5)]
        shown = [x for x in every if low <= x <= high]
        numbers = shown if len(shown) > 1 else round_ticks(low, high, 3)[0]
        return numbers, [f"{DECADE_FACTOR**x:.{0 if len(shown) > 1 else 1}e}" for x in numbers]
    exponents = exponents[:: math.ceil(len(exponents) / MOST_DECADES_MARKED)]
    plain = exponents[0] >= -3 and exponents[-1] <= 4
    labels = [f"{DECADE_FACTOR**k:g}" if plain else f"10{str(k).translate(SUPERSCRIPTS)}" for k in exponents]
    return [float(k) for k in exponents], labels


def _percent(value: float, low: float, high: float) -> str:
    return f"{100.0 * (value - low) / (high - low):.2f}"


def _span(columns: Sequence[np.ndarray], margin: float) -> tuple[float, float]:
    """The smallest and the largest finite number, with a margin; always different numbers."""
    numbers = np.concatenate([np.ravel(column) for column in columns])
    numbers = numbers[np.isfinite(numbers)]
    low, high = float(numbers.min()), float(numbers.max())
    size = high - low
    if not size > ROUNDING_SHARE_OF_VALUE * max(abs(low), abs(high)):
        size = 0.1 * max(abs(low), abs(high)) or 1.0
        low, high = low - 0.5 * size, high + 0.5 * size
    return low - margin * size, high + margin * size


def reached(one: Line) -> np.ndarray:
    """All y values that a series covers, (k,): those of its line, zero for an area, and the upper edge of a band."""
    if one.drawn == "area":
        return np.append(one.y, 0.0)
    return one.y if one.y_high is None else np.append(one.y, one.y_high)


def _pieces(one: Line, across: tuple[float, float], up: tuple[float, float]) -> list[str]:
    """The points of each uninterrupted part of a series, in the square; an area has the foot of its ends."""
    x = CHART_SIDE * (one.x - across[0]) / (across[1] - across[0])
    y = CHART_SIDE * (up[1] - one.y) / (up[1] - up[0])
    whole = np.isfinite(x) & np.isfinite(y)
    pieces = []
    for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(whole.astype(int)) != 0) + 1):
        if not len(part) or not whole[part[0]]:
            continue
        # Dots stand for themselves: of them all are drawn.
        kept = part if one.drawn == "dots" else part[_drawn_rows(y[part])]
        if one.y_high is not None:
            kept = np.union1d(kept, part[_drawn_rows(one.y_high[part])])
        points = [f"{x[k]:.1f},{y[k]:.1f}" for k in kept]
        if one.drawn == "dots":
            pieces += [f"{point} {point}" for point in points]
            continue
        if one.y_high is not None:
            high = CHART_SIDE * (up[1] - one.y_high) / (up[1] - up[0])
            points += [f"{x[k]:.1f},{high[k]:.1f}" for k in kept[::-1]]
        if one.drawn == "area":
            foot = CHART_SIDE * up[1] / (up[1] - up[0])
            points = [f"{x[kept[0]]:.1f},{foot:.1f}", *points, f"{x[kept[-1]]:.1f},{foot:.1f}"]
        # A line of one point has no length; its round end is drawn as a dot.
        pieces.append(" ".join(points * 2 if len(points) == 1 else points))
    return pieces


def _drawn_rows(y: np.ndarray) -> np.ndarray:
    """Rows of a line that are drawn: all, or of a long one its ends, and the lowest and the highest of many equal parts."""
    if len(y) <= MOST_POINTS_OF_A_LINE:
        return np.arange(len(y))
    rows = {0, len(y) - 1}
    for part in np.array_split(np.arange(len(y)), MOST_POINTS_OF_A_LINE // 2):
        rows |= {int(part[np.argmin(y[part])]), int(part[np.argmax(y[part])])}
    return np.array(sorted(rows))
