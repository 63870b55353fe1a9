"""Measured curves as series: phases, bends, noise of what is imposed, and which tests are nominally equal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from explicitfe.close_loop.statistics.noise import MEDIAN
from explicitfe.close_loop.statistics.system import Series
from explicitfe.measured.course import bends
from explicitfe.measured.curve import PRINTED_UNITS, Curve, programme_of, sd_of

EQUAL = 0.05  # of the range: programmes that agree so far are the same


EQUAL_SIZE = 0.1  # of a length


STILL = 0.02  # of the fastest pace: below it a tool waits


SLACK, QUIET_SD = 5e-3, 3.0  # of the range, and of the imposed column's noise: no bend


def series_of(curve: Curve, test: str, peers: str) -> Series:
    way, y = programme_of(curve), curve.columns[curve.predicted]
    span = max(float(np.ptp(way)), 1e-300)
    sd = sd_of(curve, curve.imposed)
    if sd is None:  # as rough as it is
        fourth = np.abs(np.diff(way, 4))
        sd = float(np.median(fourth)) / (MEDIAN * np.sqrt(70.0)) if len(fourth) else 0.0
    corners = bends(curve.time_s, way, max(SLACK * span, QUIET_SD * sd))
    moved = np.abs(np.interp(curve.time_s, curve.time_s[corners], way[corners]) - (1.0 if curve.imposed == "stretch" else 0.0))
    pace = np.gradient(moved, curve.time_s)
    # of all paces the fastest is one step of a coarse table; a tenth of the rows moves faster than a pace that counts
    still = STILL * max(float(np.quantile(np.abs(pace), 0.9)), 1e-2 * float(np.abs(pace).max()))
    phase = np.where(pace > still, "loading", np.where(pace < -still, "unloading", "hold"))
    slope = _slope(way, y, span)
    unit, factor = PRINTED_UNITS[curve.predicted]
    number = curve.conditions.get("repeat", curve.conditions.get("order", 0))
    return Series(
        id=curve.id,
        curve=curve.id,
        test=test,
        peers=peers,
        specimen="" if curve.group == curve.id else curve.group,
        constants=curve.constants,
        measured=y,
        time_s=curve.time_s,
        noise_sd=sd_of(curve, curve.predicted),
        imposed_sd=slope * sd,
        bends=corners,
        scatter=curve.noise.repeat_sd_fraction,
        trend=float(number) if isinstance(number, int | float) else 0.0,
        phase=phase,
        unit=unit,
        factor=factor,
    )


def _slope(way: np.ndarray, y: np.ndarray, span: float) -> np.ndarray:
    """How much the predicted column changes with the imposed one, at each row: a stiffening curve is steep at its end."""
    degree = min(3, len(np.unique(way)) // 4)
    line = np.polynomial.Polynomial.fit(way, y, degree) if degree and span > 1e-300 else None
    return np.full(len(y), float(np.ptp(y)) / span) if line is None else np.abs(line.deriv()(way))


def peers_of(curve: Curve, curves: Sequence[Curve]) -> str:
    """The first curve that is nominally equal to this one, if it has such company."""
    equal = [c.id for c in curves if _nominally_equal(c, curve)]
    return equal[0] if len(equal) > 1 else ""


def _nominally_equal(one: Curve, other: Curve) -> bool:
    same = one.constants == other.constants and one.kind == other.kind
    same = same and all(one.conditions.get(key) == other.conditions.get(key) for key in ("direction", "material", "cycle"))
    if not same or not _alike(one.tool, other.tool, ("radius_mm", "edge_radius_mm")):
        return False
    if not _alike(one.specimen, other.specimen, ("radius_mm", "height_mm", "layer_mm")):
        return False
    end = min(one.time_s[-1], other.time_s[-1])
    if end < (1.0 - 2.0 * EQUAL) * max(one.time_s[-1], other.time_s[-1]):
        return False
    grid = np.linspace(0.0, end, 50)
    a, b = (np.interp(grid, c.time_s, programme_of(c)) for c in (one, other))
    return float(np.sqrt(np.mean((a - b) ** 2))) < EQUAL * max(float(np.ptp(a)), float(np.ptp(b)))


def _alike(one: Any, other: Any, lengths: Iterable[str]) -> bool:
    if one is None or other is None:
        return one is other
    if one.shape != other.shape:
        return False
    pairs = [(getattr(one, key, None), getattr(other, key, None)) for key in lengths]
    return all(a == b or (a and b and abs(a - b) < EQUAL_SIZE * max(a, b)) for a, b in pairs)
