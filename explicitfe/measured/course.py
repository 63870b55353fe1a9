"""The course of a test in time: instants at which a model is computed, and from those back to the rows of the data.

A programme of many rows is reduced to its bends. Between two bends a moving tool is computed at even steps of its displacement,
a waiting tool at times that grow from fine to coarse. Between the instants, a monotone curve from bend to bend is evaluated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

# Numbers of instants: of a motion over the whole range of the programme, and of a long wait. A ramp, a hold and a return then
# take about 40; ``density`` multiplies them.
INSTANTS_OF_A_FULL_MOTION = 16
INSTANTS_OF_A_LONG_WAIT = 8
# A wait of this share of the whole time gets all its instants; a shorter one gets half of them.
LONG_WAIT_TIME_SHARE = 0.15
# A wait shorter than this share of the whole time relaxes too little to need more than one instant.
SHORT_WAIT_TIME_SHARE = 0.04
# The pace may change by this share of the faster one without a corner: the answer is smooth there.
SMOOTH_PACE_CHANGE_SHARE = 0.5
# A programme that is straight within this share of its range has no bend: digitised ramps wobble by less.
STRAIGHT_RANGE_SHARE = 2e-3
# A row that is off by no more than this many standard deviations of its noise is no bend.
NOISE_OF_A_STRAIGHT_LINE_SDS = 3.0
# A motion over less than this share of the range is a wait.
WAIT_RANGE_SHARE = 0.05
# The first instant of a wait comes after this share of it: relaxation begins at once, whatever its times are.
FIRST_INSTANT_WAIT_SHARE = 0.01
# Instants of the first motion crowd where it begins, with this power of their number: the force of a round tool begins curved.
ONSET_POWER = 1.25


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

        def finer(column: np.ndarray) -> np.ndarray:
            return np.insert(column, number, column[number - 1] + share * (column[number] - column[number - 1]))

        bends_after = np.where(self.bends >= number, self.bends + parts - 1, self.bends)
        return Course(finer(self.time_s), finer(self.imposed), bends_after)

    def at(self, answers: np.ndarray, time_s: np.ndarray, contact_power: float | None = None) -> np.ndarray:
        """Answers at the instants (n,), interpolated to other times (k,).

        Parameters
        ----------
        contact_power : where the tool loses contact, the answer falls to zero with this power of the distance, and so it rises
            again; None where it never loses contact.
        """
        values = np.empty(len(time_s))
        for start, end in zip(self.bends[:-1], self.bends[1:], strict=True):
            inside = (time_s >= self.time_s[start]) & (time_s <= self.time_s[end])
            if not inside.any():
                continue
            t, y = self.time_s[start : end + 1], answers[start : end + 1]
            if contact_power is not None:
                t, y = _with_ends_of_contact(t, y, contact_power)
            values[inside] = PchipInterpolator(t, y)(time_s[inside]) if len(t) > 2 else np.interp(time_s[inside], t, y)
        return values


def _with_ends_of_contact(t: np.ndarray, y: np.ndarray, power: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants and answers, with those added at which the tool loses contact and touches again."""
    for direction in (1, -1):
        t, y = t[::direction], y[::direction]
        last_pressing = np.flatnonzero((y[2:] <= 0.0) & (y[1:-1] > 0.0) & (y[:-2] > y[1:-1])) + 1
        for k in last_pressing[::-1]:
            before, last = y[k - 1] ** (1.0 / power), y[k] ** (1.0 / power)
            end = t[k] + (t[k] - t[k - 1]) * last / (before - last)
            if abs(end - t[k]) < abs(t[k + 1] - t[k]):
                t, y = np.insert(t, k + 1, end), np.insert(y, k + 1, 0.0)
        t, y = t[::direction], y[::direction]
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
    """Choose the instants of a programme.

    Parameters
    ----------
    time_s, imposed : (k,) rows.
    sd : noise of the imposed column.
    waits : whether anything happens while the tool waits.
    density : multiplies the numbers of instants.
    touches : whether contact begins where 0 is imposed. A tool that is in contact in the first row already is taken to have
        come at the pace at which it goes on.
    """
    low, high = min(imposed.min(), 0.0), max(imposed.max(), 0.0)
    range_ = high - low
    slack = max(STRAIGHT_RANGE_SHARE * range_, NOISE_OF_A_STRAIGHT_LINE_SDS * sd)
    bend_rows = bends(time_s, imposed, slack)
    t, x = time_s[bend_rows], imposed[bend_rows]
    in_the_air = touches and x[0] < 0.0
    if abs(x[0]) > slack and not in_the_air:
        pace = np.abs(np.diff(x) / np.diff(t))
        moving = np.flatnonzero(np.abs(np.diff(x)) > WAIT_RANGE_SHARE * range_)
        rate = pace[moving[0]] if len(moving) else pace.max(initial=0.0)
        ago = abs(x[0]) / rate if rate > 0.0 else t[-1] - t[0]
        t, x = np.concatenate([[t[0] - ago], t]), np.concatenate([[0.0], x])
        if len(t) > 2 and abs(x[1] - np.interp(t[1], t[[0, 2]], x[[0, 2]])) <= slack:
            t, x = np.delete(t, 1), np.delete(x, 1)
    elif not in_the_air:
        x[0] = 0.0  # It differs from zero by less than the noise.
    if touches:
        crossings = [k for k in range(len(x) - 1) if x[k] < 0.0 < x[k + 1]]
        for k in crossings[::-1]:
            x, t = np.insert(x, k + 1, 0.0), np.insert(t, k + 1, t[k] + (t[k + 1] - t[k]) * -x[k] / (x[k + 1] - x[k]))
    pace = np.diff(x) / np.diff(t)
    times, values, corners = [t[:1]], [x[:1]], [0]
    count = 0
    for k in range(len(t) - 1):
        motion_share = abs(x[k + 1] - x[k]) / range_ if range_ > 0.0 else 0.0
        share = _shares(t, k, motion_share, abs(x[k]) <= slack, waits, density)
        times.append(t[k] + share * (t[k + 1] - t[k]))
        values.append(x[k] + share * (x[k + 1] - x[k]))
        times[-1][-1], values[-1][-1] = t[k + 1], x[k + 1]
        count += len(share)
        touch = touches and x[k + 1] == 0.0
        if k == len(t) - 2 or touch or abs(pace[k + 1] - pace[k]) > SMOOTH_PACE_CHANGE_SHARE * np.abs(pace[k : k + 2]).max():
            corners.append(count)
    return Course(np.concatenate(times), np.concatenate(values), np.array(corners))


def _shares(t: np.ndarray, k: int, motion_share: float, onset: bool, waits: bool, density: float) -> np.ndarray:
    """Instants between bend k and the next, as shares of the time between them."""
    if motion_share > WAIT_RANGE_SHARE:
        count = int(np.ceil(density * max(INSTANTS_OF_A_FULL_MOTION * motion_share, 1.0)))
        return (np.arange(1, count + 1) / count) ** (ONSET_POWER if onset else 1.0)
    time_share = (t[k + 1] - t[k]) / (t[-1] - t[0])
    if not waits or time_share < SHORT_WAIT_TIME_SHARE:
        count = int(np.ceil(density)) if waits else 1
        return np.arange(1, count + 1) / count
    count = int(np.ceil(density * INSTANTS_OF_A_LONG_WAIT * (1.0 if time_share > LONG_WAIT_TIME_SHARE else 0.5)))
    growth = np.log1p(1.0 / FIRST_INSTANT_WAIT_SHARE)
    return np.expm1(np.arange(1, count + 1) / count * growth) * FIRST_INSTANT_WAIT_SHARE
