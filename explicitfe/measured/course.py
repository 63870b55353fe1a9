"""The course of a test in time: instants at which a model is computed, and from those back to the rows of the data.

A programme of many rows is reduced to its bends. Between two bends a tool that moves is computed at steps of its way, a tool
that waits at times that grow from fine to coarse. What is computed is interpolated monotonically from bend to bend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

MOVING, WAITING = 16, 8  # instants of a way over the whole range, and of a long wait
LONG, SHORT = 0.15, 0.04  # of the time: a wait from so long on gets all its instants; a shorter one half of them, or one
SHARP = 0.5  # of the faster pace: a change of pace by less is no corner
STRAIGHT = 2e-3  # of the range: a programme that is straight within this has no bend
QUIET_SD = 3.0  # of the imposed column: so far a row may be off by noise
WAITS = 0.05  # of the range: less of a way is a wait
FIRST_WAIT = 0.01  # of a wait: its first instant
ONSET = 1.25  # instants of the first way crowd where it begins, with this power


@dataclass(frozen=True)
class Course:
    """Instants of a programme.

    Attributes
    ----------
    time_s, imposed : (n,) instants, and what is imposed then; the first is the beginning, where the tool touches.
    bends : (m,) indices of the instants where the programme bends; the first and the last are among them.
    """

    time_s: np.ndarray
    imposed: np.ndarray
    bends: np.ndarray

    def split(self, number: int, parts: int) -> Course:
        """The course with the step to an instant cut into equal parts."""
        share = np.arange(1, parts) / parts
        columns = [np.insert(c, number, c[number - 1] + share * (c[number] - c[number - 1])) for c in (self.time_s, self.imposed)]
        return Course(*columns, np.where(self.bends >= number, self.bends + parts - 1, self.bends))

    def at(self, found: np.ndarray, time_s: np.ndarray, lifts: float | None = None) -> np.ndarray:
        """What was found at the instants (n,), at other times (k,).

        ``lifts``: where what is found falls to nothing it does so with this power of the way, and comes back so.
        """
        answer = np.empty(len(time_s))
        for start, end in zip(self.bends[:-1], self.bends[1:], strict=True):
            inside = (time_s >= self.time_s[start]) & (time_s <= self.time_s[end])
            if not inside.any():
                continue
            t, y = self.time_s[start : end + 1], found[start : end + 1]
            if lifts is not None:
                t, y = _with_lift(t, y, lifts)
            answer[inside] = PchipInterpolator(t, y)(time_s[inside]) if len(t) > 2 else np.interp(time_s[inside], t, y)
        return answer


def _with_lift(t: np.ndarray, y: np.ndarray, power: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants and values with the one added at which a tool loses contact, and the one at which it finds it again."""
    for turn in (1, -1):
        t, y = t[::turn], y[::turn]
        gone = np.flatnonzero((y[2:] <= 0.0) & (y[1:-1] > 0.0) & (y[:-2] > y[1:-1])) + 1  # the last that presses
        for k in gone[::-1]:
            before, last = y[k - 1] ** (1.0 / power), y[k] ** (1.0 / power)
            end = t[k] + (t[k] - t[k - 1]) * last / (before - last)
            if abs(end - t[k]) < abs(t[k + 1] - t[k]):
                t, y = np.insert(t, k + 1, end), np.insert(y, k + 1, 0.0)
        t, y = t[::turn], y[::turn]
    return t, y


def bends(time_s: np.ndarray, imposed: np.ndarray, slack: float) -> np.ndarray:
    """Indices of the rows that a polyline needs, so that no row is farther than ``slack`` from it (Douglas & Peucker 1973)."""
    kept = {0, len(time_s) - 1}
    parts = [(0, len(time_s) - 1)]
    while parts:
        start, end = parts.pop()
        if end - start < 2:
            continue
        inner = slice(start + 1, end)
        off = np.abs(imposed[inner] - np.interp(time_s[inner], time_s[[start, end]], imposed[[start, end]]))
        worst = int(np.argmax(off)) + start + 1
        if off.max() > slack:
            kept.add(worst)
            parts += [(start, worst), (worst, end)]
    return np.array(sorted(kept))


def course_of(
    time_s: np.ndarray, imposed: np.ndarray, *, sd: float = 0.0, waits: bool = True, density: float = 1.0, touches: bool = True
) -> Course:
    """Instants for a programme.

    Parameters
    ----------
    time_s, imposed : (k,) rows.
    sd : noise of the imposed column.
    waits : whether anything happens while the tool waits.
    density : multiplies the numbers of instants.
    touches : whether contact begins where 0 is imposed. A tool that is in already has come at the pace at which it goes on.
    """
    low, high = min(imposed.min(), 0.0), max(imposed.max(), 0.0)
    range_ = high - low
    slack = max(STRAIGHT * range_, QUIET_SD * sd)
    where = bends(time_s, imposed, slack)
    t, x = time_s[where], imposed[where]
    in_the_air = touches and x[0] < 0.0
    if abs(x[0]) > slack and not in_the_air:
        pace = np.abs(np.diff(x) / np.diff(t))
        moving = np.flatnonzero(np.abs(np.diff(x)) > WAITS * range_)
        rate = pace[moving[0]] if len(moving) else pace.max(initial=0.0)
        ago = abs(x[0]) / rate if rate > 0.0 else t[-1] - t[0]
        t, x = np.concatenate([[t[0] - ago], t]), np.concatenate([[0.0], x])
        if len(t) > 2 and abs(x[1] - np.interp(t[1], t[[0, 2]], x[[0, 2]])) <= slack:
            t, x = np.delete(t, 1), np.delete(x, 1)
    elif not in_the_air:
        x[0] = 0.0  # no way at all: where it begins
    if touches:
        crossings = [k for k in range(len(x) - 1) if x[k] < 0.0 < x[k + 1]]
        for k in crossings[::-1]:
            x, t = np.insert(x, k + 1, 0.0), np.insert(t, k + 1, t[k] + (t[k + 1] - t[k]) * -x[k] / (x[k + 1] - x[k]))
    pace = np.diff(x) / np.diff(t)
    times, values, corners = [t[:1]], [x[:1]], [0]
    count = 0
    for k in range(len(t) - 1):
        share = _shares(t, x, k, abs(x[k + 1] - x[k]) / range_ if range_ > 0.0 else 0.0, abs(x[k]) <= slack, waits, density)
        times.append(t[k] + share * (t[k + 1] - t[k]))
        values.append(x[k] + share * (x[k + 1] - x[k]))
        times[-1][-1], values[-1][-1] = t[k + 1], x[k + 1]
        count += len(share)
        touch = touches and x[k + 1] == 0.0
        if k == len(t) - 2 or touch or abs(pace[k + 1] - pace[k]) > SHARP * np.abs(pace[k : k + 2]).max():
            corners.append(count)
    return Course(np.concatenate(times), np.concatenate(values), np.array(corners))


def _shares(t: np.ndarray, x: np.ndarray, k: int, way: float, onset: bool, waits: bool, density: float) -> np.ndarray:
    """Instants between two bends, as shares of the way from one to the next."""
    if way > WAITS:
        count = int(np.ceil(density * max(MOVING * way, 1.0)))
        return (np.arange(1, count + 1) / count) ** (ONSET if onset else 1.0)
    time = (t[k + 1] - t[k]) / (t[-1] - t[0])
    if not waits or time < SHORT:
        count = int(np.ceil(density)) if waits else 1
        return np.arange(1, count + 1) / count
    count = int(np.ceil(density * WAITING * (1.0 if time > LONG else 0.5)))
    return np.expm1(np.arange(1, count + 1) / count * np.log1p(1.0 / FIRST_WAIT)) * FIRST_WAIT
