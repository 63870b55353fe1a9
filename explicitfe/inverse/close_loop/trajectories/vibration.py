"""Features of a vibrating coordinate for the report: frequency, decay, phase, and where it comes to rest."""

from __future__ import annotations

import numpy as np

from explicitfe.inverse.close_loop.trajectories.emulator import vibration_of
from explicitfe.results.documents.motion_report import VibrationFeatures

# The least share of its variance that a damped cosine must explain of a coordinate that vibrates.
LEAST_EXPLAINED_SHARE = 0.5
# The last share of a curve tells where it comes to rest if it does not vibrate.
END_SHARE = 0.15


def features_of(time_s: np.ndarray, y: np.ndarray) -> VibrationFeatures:
    """Features of a coordinate; only ``end`` where it does not vibrate.

    Parameters
    ----------
    time_s : (k,) since the start of the motion, s.
    y : (k,) a coordinate, in any unit; NaN where a value is missing.
    """
    known = np.isfinite(y) & (time_s >= 0.0)
    t, y = time_s[known], y[known]
    if not len(y):
        return VibrationFeatures()
    end = float(np.mean(y[t >= t[-1] - END_SHARE * np.ptp(t)]))
    one = vibration_of(t, y[:, None])
    # less than one period is no vibration
    slow = one is not None and np.exp(one.rate[0]) * np.ptp(t) < 2.0 * np.pi
    if one is None or slow or np.var(one.wave_at(t)[:, 0] - y) > (1.0 - LEAST_EXPLAINED_SHARE) * np.var(y):
        return VibrationFeatures(end=end)
    return VibrationFeatures(
        frequency_Hz=float(np.exp(one.rate[0]) / (2.0 * np.pi)),
        decay_per_s=float(one.rate[1]),
        phase_deg=float(np.degrees(np.angle(one.amplitude[0])) % 360.0),
        amplitude=float(np.abs(one.amplitude[0])),
        end=float(one.end[0]),
    )
