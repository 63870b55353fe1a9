"""What measured curves have of what effects require."""

from __future__ import annotations

import numpy as np

from explicitfe.close_loop.specimens.series import STILL
from explicitfe.measured.curve import Curve, programme_of

HOLD, RATE = 0.1, 1.5  # share of a test that a hold lasts; factor between two rates


PULLS = 0.01  # of the largest force: below zero by so much, a tool is pulled


BACK = 0.05  # of the range: a way back


def _pace(curve: Curve) -> float:
    """Median pace of the way in."""
    way = programme_of(curve)
    rest = 1.0 if curve.imposed == "stretch" else 0.0
    moved = np.abs(way - rest)
    pace = np.diff(moved) / np.diff(curve.time_s)
    rising = pace > STILL * pace.max(initial=0.0)
    return float(np.median(pace[rising])) if rising.any() else 0.0


def _way_back(curve: Curve) -> float:
    """Largest way back, over the range."""
    way = programme_of(curve)
    moved = np.abs(way - (1.0 if curve.imposed == "stretch" else 0.0))
    return float((np.maximum.accumulate(moved) - moved).max() / max(moved.max(), 1e-300))
