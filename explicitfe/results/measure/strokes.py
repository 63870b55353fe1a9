"""Opening and closing movements (strokes) of a point: distance, duration and speed of each.

A stroke lasts from one local minimum of the point's speed to the next.

Tasko and Westbury (2002), J. Speech Lang. Hear. Res. 45:127, define it so.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy

# Positions are filtered by a Butterworth filter of this order, forwards and backwards, so that nothing is delayed.
FILTER_ORDER = 4
# A peak of speed that rises by less above the minima beside it, and a stroke over a smaller distance, are none.
SMALLEST_RISE_M_S = 5e-3
SMALLEST_DISTANCE_M = 1e-3


class Stroke(NamedTuple):
    """One opening or closing movement.

    Attributes
    ----------
    start_s, peak_s, end_s : s. Times of the start, the peak speed and the end.
    distance_m : m. Straight distance from start to end.
    peak_speed_m_s : m/s.
    """

    start_s: float
    peak_s: float
    end_s: float
    distance_m: float
    peak_speed_m_s: float

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return self.end_s - self.start_s

    @property
    def peak_share(self) -> float:
        """Time of the peak speed as a share of the duration: 0.5 if acceleration and deceleration are symmetric."""
        return (self.peak_s - self.start_s) / self.duration_s

    @property
    def peak_over_mean(self) -> float:
        """Peak speed over mean speed, c = V T / D: 1.875 of a movement of least jerk, pi / 2 of half a sine.

        Munhall, Ostry and Parush (1985), J. Exp. Psychol. Hum. Percept. Perform. 11:457, have V / D = c / T in speech.
        """
        return self.peak_speed_m_s * self.duration_s / self.distance_m


def strokes(
    times_s: np.ndarray, positions_m: np.ndarray, *, cutoff_hz: float | None = None, edge_share: float = 0.0
) -> list[Stroke]:
    """The strokes of a point.

    Parameters
    ----------
    times_s : (t,) s, rising at equal intervals.
    positions_m : (t, k) m.
    cutoff_hz : Hz. Cut-off frequency of the low-pass filter; None: no filter.
    edge_share : a stroke begins and ends where its speed is this share of its peak, or at a minimum before that. 0: at the
        minima, or where the point stands still.
    """
    step_s = float(np.mean(np.diff(times_s)))
    if cutoff_hz is not None:
        low_pass = scipy.signal.butter(FILTER_ORDER, cutoff_hz, fs=1.0 / step_s, output="sos")
        positions_m = scipy.signal.sosfiltfilt(low_pass, positions_m, axis=0)
    speed = np.linalg.norm(np.gradient(positions_m, step_s, axis=0), axis=1)
    # A point may start or stop at full speed: both ends of the record count as minima, whatever the speed is there.
    peaks = scipy.signal.find_peaks(speed, prominence=SMALLEST_RISE_M_S)[0]
    if not len(peaks):
        return []
    inner = [int(a + np.argmin(speed[a : b + 1])) for a, b in pairwise(peaks)]
    bounds = [0, *inner, len(speed) - 1]
    every = [
        _stroke(times_s, positions_m, speed, first, int(peak), last, edge_share)
        for first, peak, last in zip(bounds[:-1], peaks, bounds[1:], strict=True)
    ]
    return [stroke for stroke in every if stroke.distance_m >= SMALLEST_DISTANCE_M]


def _stroke(
    times_s: np.ndarray, positions_m: np.ndarray, speed: np.ndarray, first: int, peak: int, last: int, edge_share: float
) -> Stroke:
    """The stroke around a peak of the speed, between two minima of it."""
    # Linear between samples, and parabolic at the peak, which samples 10 ms apart would cut.
    start_s = _crossing(times_s, speed, np.arange(peak, first - 1, -1), edge_share * speed[peak])
    end_s = _crossing(times_s, speed, np.arange(peak, last + 1), edge_share * speed[peak])
    ends = np.array([[np.interp(time, times_s, column) for column in positions_m.T] for time in (start_s, end_s)])
    before, at, after = speed[[peak - 1, peak, peak + 1]]
    bend = before - 2.0 * at + after
    peak_s = times_s[peak] + (times_s[peak + 1] - times_s[peak]) * (before - after) / (2.0 * bend)
    top = at - (before - after) ** 2 / (8.0 * bend)
    return Stroke(start_s, float(peak_s), end_s, float(np.linalg.norm(ends[1] - ends[0])), float(top))


def _crossing(times_s: np.ndarray, speed: np.ndarray, samples: np.ndarray, level: float) -> float:
    """When the speed first falls to a level along samples that lead away from a peak; the last of them where it does not."""
    below = np.flatnonzero(speed[samples] <= level)
    if not len(below) or below[0] == 0:
        return float(times_s[samples[-1]])
    outer, inner = samples[below[0]], samples[below[0] - 1]
    share = (speed[inner] - level) / (speed[inner] - speed[outer])
    return float(times_s[inner] + share * (times_s[outer] - times_s[inner]))
