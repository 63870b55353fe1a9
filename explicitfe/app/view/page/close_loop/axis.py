"""Where the rows of a curve lie across a chart, and which of them are drawn as dots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from explicitfe.app.view.page.chart import round_ticks
from explicitfe.app.view.page.words import bare
from explicitfe.results.documents.loop_report import ReportCurve

# A loading that takes less than this share of the time would be a vertical line: it gets more room ...
SHORT_LOADING_SHARE = 0.15
# ... namely this share of the width.
STRETCHED_LOADING_WIDTH_SHARE = 0.36
# The next mark of the axis keeps this share of the time behind the loading away from its end, or the words would overlap.
MARK_DISTANCE_SHARE = 0.15
TICKS_AFTER_LOADING = 3
# A test goes in one direction if it turns back by at most this share of its span: measured columns tremble.
TURNING_BACK_SHARE = 0.01
# It is held for a while where it changes by less than this share of its span from row to row ...
STILL_SHARE_OF_SPAN = 1e-3
# ... in more than this share of the time. With fewer rows than this, one row is too much of the time to tell.
HELD_SHARE_OF_TIME = 0.1
ROWS_THAT_SHOW_A_HOLD = 20
# The loading ends where this share of the largest change is reached: a controller creeps over the last per cent.
LOADED_SHARE = 0.99


class Abscissa(NamedTuple):
    """Places of the rows of a curve (k,), the label of the axis, its marks if they are no round numbers, and shaded ranges."""

    x: np.ndarray
    label: str
    marks: Sequence[tuple[float, str]] = ()
    shaded: Sequence[tuple[float, float]] = ()


def abscissa_of(curve: ReportCurve, over_time: bool = False) -> Abscissa:
    """Where the rows of a curve lie across: over what is imposed, or over time, of which a short loading is stretched.

    The curve is drawn over time where ``over_time`` asks for it, where the imposed quantity turns back or is held, or where it is
    not given.
    """
    time, imposed = curve.time_s, curve.x
    if time is None or (imposed is not None and not over_time and goes_one_way(time, imposed)):
        rows = np.arange(len(curve.measured), dtype=float)
        return Abscissa(rows, "row") if imposed is None else Abscissa(imposed, curve.x_label)
    start, end = float(np.nanmin(time)), float(np.nanmax(time))
    loaded = loading_end(time, imposed) if imposed is not None else end
    if not 0.0 < loaded - start < SHORT_LOADING_SHARE * (end - start):
        return Abscissa(time, "time (s)")
    knots, places = [start, loaded, end], [0.0, STRETCHED_LOADING_WIDTH_SHARE, 1.0]
    earliest = loaded + MARK_DISTANCE_SHARE * (end - loaded)
    marked = [start, loaded, *(t for t in round_ticks(loaded, end, TICKS_AFTER_LOADING)[0] if earliest < t)]
    marks = [(float(np.interp(t, knots, places)), bare(t)) for t in marked]
    x = np.interp(time, knots, places)
    return Abscissa(x, "time (s), loading (shaded) stretched", marks, [(0.0, STRETCHED_LOADING_WIDTH_SHARE)])


def goes_one_way(time: np.ndarray, imposed: np.ndarray) -> bool:
    """Whether the imposed quantity goes in one direction, without a stop of more than a tenth of the time."""
    changes, span = np.diff(imposed), float(np.ptp(imposed))
    held = 0.0
    if len(imposed) > ROWS_THAT_SHOW_A_HOLD:
        held = np.diff(time)[np.abs(changes) < STILL_SHARE_OF_SPAN * span].sum()
    back = min(changes[changes < 0.0].sum(), -changes[changes > 0.0].sum(), key=abs)
    return bool(abs(back) <= TURNING_BACK_SHARE * span and held <= HELD_SHARE_OF_TIME * np.ptp(time))


def loading_end(time: np.ndarray, imposed: np.ndarray) -> float:
    """The time (s) at which the loading is over."""
    change = np.abs(imposed - imposed[0])
    return float(time[int(np.argmax(change >= LOADED_SHARE * np.nanmax(change)))])


def spread_rows(at: np.ndarray, values: np.ndarray, most: int) -> np.ndarray:
    """Numbers of at most so many rows of a long curve, evenly along its drawn length."""
    if len(at) <= most:
        return np.arange(len(at))
    steps = np.hypot(np.diff(at) / (np.ptp(at) or 1.0), np.diff(values) / (np.nanmax(values) - np.nanmin(values) or 1.0))
    length = np.concatenate([[0.0], np.nan_to_num(steps).cumsum()])
    return np.unique(np.searchsorted(length, np.linspace(0.0, length[-1], most)).clip(0, len(at) - 1))
