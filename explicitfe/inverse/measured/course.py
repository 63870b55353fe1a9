"""Discretization of a loading protocol: instants at which a model is computed, and interpolation to the rows of the data.

A protocol of many rows is reduced to a polyline. Between two of its vertices a moving tool is computed at equal steps of
displacement, and a resting tool at times with growing intervals. Results are interpolated monotonically between the instants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

# Numbers of instants for a motion over the whole range of the protocol, and for a long hold. A ramp, a hold and a return then
# need about 40. ``density`` multiplies them.
INSTANTS_OF_A_FULL_MOTION = 16
INSTANTS_OF_A_LONG_WAIT = 8
# A hold of at least this share of the duration gets all its instants; a shorter one gets half of them.
LONG_WAIT_TIME_SHARE = 0.15
# In a hold shorter than this share of the duration, relaxation is too small for more than one instant.
SHORT_WAIT_TIME_SHARE = 0.04
# The rate may change by this share of the larger one without a vertex: the response is smooth there.
SMOOTH_PACE_CHANGE_SHARE = 0.5
# A protocol that is straight within this share of its range has no vertex: digitised ramps deviate by less.
STRAIGHT_RANGE_SHARE = 2e-3
# A row that deviates by at most this many standard deviations of its noise is no vertex.
NOISE_OF_A_STRAIGHT_LINE_SDS = 3.0
# A motion over less than this share of the range is a hold.
WAIT_RANGE_SHARE = 0.05
# The first instant of a hold comes after this share of it, because relaxation begins immediately.
FIRST_INSTANT_WAIT_SHARE = 0.01
# Instants of the first motion are denser at its start, with this power of their number: the force of a round tool starts curved.
ONSET_POWER = 1.25


@dataclass(frozen=True)
class Course:
    """Instants of a loading protocol.

    Attributes
    ----------
    time_s, imposed : (n,) instants, and the imposed values; at the first one the tool touches the specimen.
    bends : (m,) indices of the vertices of the protocol, including the first and the last instant.
    """

    time_s: np.ndarray
    imposed: np.ndarray
    bends: np.ndarray

    def split(self, number: int, parts: int) -> Course:
        """Return the protocol with the step to an instant divided into equal parts."""
        share = np.arange(1, parts) / parts

        def finer(column: np.ndarray) -> np.ndarray:
            return np.insert(column, number, column[number - 1] + share * (column[number] - column[number - 1]))

        bends_after = np.where(self.bends >= number, self.bends + parts - 1, self.bends)
        return Course(finer(self.time_s), finer(self.imposed), bends_after)

    def at(
        self, answers: np.ndarray, time_s: np.ndarray, contact_power: float | None = None, *, smooth: bool = False
    ) -> np.ndarray:
        """Interpolate a response at the instants (n,) to other times (k,).

        Parameters
        ----------
        contact_power : when the tool loses or regains contact, the response depends on the distance with this power; None if it
            never loses contact.
        smooth : the response has no kink between two bends, so that it need not be interpolated monotonically.
        """
        values = np.empty(len(time_s))
        for start, end in zip(self.bends[:-1], self.bends[1:], strict=True):
            inside = (time_s >= self.time_s[start]) & (time_s <= self.time_s[end])
            if not inside.any():
                continue
            t, y = self.time_s[start : end + 1], answers[start : end + 1]
            if contact_power is not None:
                t, y = _with_ends_of_contact(t, y, contact_power)
            between = CubicSpline if smooth and contact_power is None and len(t) > 3 else PchipInterpolator
            values[inside] = between(t, y)(time_s[inside]) if len(t) > 2 else np.interp(time_s[inside], t, y)
        return values


def _with_ends_of_contact(t: np.ndarray, y: np.ndarray, power: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants and responses, with the loss and the return of contact added."""
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
    """Return the rows of the polyline from which no row deviates by more than ``slack`` (Douglas & Peucker 1973)."""
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
    """Choose the instants of a loading protocol.

    Parameters
    ----------
    time_s, imposed : (k,) rows.
    sd : noise of the imposed column.
    waits : whether the response changes during a hold.
    density : multiplies the numbers of instants.
    touches : whether contact begins where 0 is imposed. If the tool is in contact in the first row, it is assumed to have
        approached at the rate of the following motion.
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
    """Instants between vertex k and the next, as fractions of the time between them."""
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
