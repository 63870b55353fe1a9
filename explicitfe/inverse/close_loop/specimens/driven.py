"""Curves that a model is driven with: the estimated loading protocol in place of the noisy rows of the imposed column."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from explicitfe.inverse.close_loop.statistics.protocol import EstimatedProtocol, estimate_protocol
from explicitfe.inverse.measured.curve import Curve, programme_of, sd_of

# A corner nearer to a row than this share of the duration needs no row of its own.
SAME_INSTANT_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class DrivenCurve:
    """A measured curve and the course that a model follows in its place.

    Attributes
    ----------
    curve : with the estimated protocol as its imposed column, at the measured rows and at the corners between them.
    rows : (k,) which rows of it are those of the measured curve.
    protocol : the estimate.
    """

    curve: Curve
    rows: np.ndarray
    protocol: EstimatedProtocol


@lru_cache(maxsize=10_000)
def driven_of(curve: Curve) -> DrivenCurve:
    """The curve that a model follows."""
    read = programme_of(curve)
    protocol = estimate_protocol(curve.time_s, read, sd_of(curve, curve.imposed), curve.conditions)
    if protocol.form in ("column", "rows"):
        return DrivenCurve(curve, np.arange(len(read)), protocol)
    near = SAME_INSTANT_SHARE * float(curve.time_s[-1])
    corners = [t for t in protocol.time_s if curve.time_s[0] < t < curve.time_s[-1] and np.abs(curve.time_s - t).min() > near]
    time_s = np.sort(np.concatenate([curve.time_s, corners])) if protocol.form == "polyline" else curve.time_s
    columns = {name: np.interp(time_s, curve.time_s, column) for name, column in curve.columns.items()}
    columns[curve.imposed] = protocol.at(time_s) if protocol.form == "polyline" else protocol.fitted
    return DrivenCurve(replace(curve, time_s=time_s, columns=columns), np.searchsorted(time_s, curve.time_s), protocol)
