"""What measured curves have of what effects require to be seen, such as time, unloading or repeats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.inverse.close_loop.specimens.series import WAITING_SHARE_OF_PACE, distance_from_rest
from explicitfe.inverse.close_loop.statistics.system import Series
from explicitfe.inverse.measured.curve import Curve, programme_of, sd_of
from explicitfe.inverse.predict.experiment import cycle_of

# A stop that is shorter, as a share of the duration, is the turn of a machine; a return that is shorter, as a share of the range,
# is its play; a force that is less negative, as a share of the largest, is the zero of the load cell.
HOLD_SHARE, UNLOADING_SHARE, PULL_SHARE = 0.1, 0.05, 0.01
PULL_NOISE_FACTOR = 4.0  # A force that is less negative than so many times its noise does not pull.
# Rates whose ratio is smaller hardly distinguish time from strain.
RATE_RATIO = 1.5


def features_of(curves: Sequence[Curve], series: Sequence[Series]) -> set[str]:
    """What the curves have, in the words of :attr:`explicitfe.fem.effects.effect.Effect.requires`."""
    features = set()
    first = curves[0]
    if first.tool is not None:
        features.add("tool")
        if first.tool.shape in ("flat-cylinder", "platen"):
            features.add("flat tool")
        if first.tool.shape == "flat-cylinder":
            features.add("edge")
        loose = ("frictionless", "unknown") if first.tool.shape == "platen" else ("frictionless",)
        if first.specimen is not None and first.specimen.base not in loose:
            features.add("bonded base")
    else:
        features.add("strain")
    paces: dict[str, list[float]] = {}
    cycles: dict[str, set[float]] = {}
    directions: dict[str, set[str]] = {}
    for curve, one in zip(curves, series, strict=True):
        held = np.diff(one.time_s) @ (one.phase[1:] == "hold") / one.time_s[-1]
        if curve.tool is not None:
            noise = PULL_NOISE_FACTOR * (sd_of(curve, "force_N") or 0.0)
            if curve.force_N.min() < -max(PULL_SHARE * float(np.abs(curve.force_N).max()), noise):
                features.add("force that pulls")
        if _unloading(curve) > UNLOADING_SHARE:
            features |= {"unloading", "time"}
        if held > HOLD_SHARE:
            features.add("time")
        paces.setdefault(curve.constants, []).append(_loading_pace(curve))
        cycles.setdefault(curve.constants, set()).add(cycle_of(curve))
        directions.setdefault(curve.constants, set()).add(str(curve.conditions.get("direction")))
    if any(max(p) > RATE_RATIO * min(p) for p in paces.values()):
        features.add("time")
    if any(len(c) > 1 for c in cycles.values()):
        features.add("repeats")
    if any(len(d) > 1 for d in directions.values()):
        features.add("two directions")
    return features


def _loading_pace(curve: Curve) -> float:
    """Median pace of loading, in the unit of the imposed column per second."""
    moved = distance_from_rest(curve, programme_of(curve))
    pace = np.diff(moved) / np.diff(curve.time_s)
    rising = pace > WAITING_SHARE_OF_PACE * pace.max(initial=0.0)
    return float(np.median(pace[rising])) if rising.any() else 0.0


def _unloading(curve: Curve) -> float:
    """How far the programme returns towards rest, as a share of its range."""
    moved = distance_from_rest(curve, programme_of(curve))
    return float((np.maximum.accumulate(moved) - moved).max() / max(moved.max(), 1e-300))
