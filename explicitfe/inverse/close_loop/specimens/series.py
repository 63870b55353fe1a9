"""Measured curves as series: phases, bends, noise of what is imposed, and which tests are nominally equal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from explicitfe.inverse.close_loop.specimens.driven import driven_of
from explicitfe.inverse.close_loop.statistics.noise import MEDIAN_OF_ABSOLUTE_NORMAL
from explicitfe.inverse.close_loop.statistics.system import Series
from explicitfe.inverse.measured.course import bends
from explicitfe.inverse.measured.curve import PRINTED_UNITS, Curve, programme_of, sd_of
from explicitfe.inverse.measured.tables import MeasuredSpecimen, MeasuredTool

# Below this share of the fastest pace a tool waits: a motor that holds its place still moves a little.
WAITING_SHARE_OF_PACE = 0.02
# The fastest pace is that of the fastest tenth of the rows, because one step of a coarse table is faster than the tool ever was.
# It is no less than this share of that one step, so that a test which mostly waits keeps its ramp.
FAST_ROWS_QUANTILE = 0.9
LEAST_SHARE_OF_FASTEST_STEP = 1e-2
# A programme bends where a polyline would miss it by more than this share of its range, and than so many times its noise.
BEND_SHARE_OF_RANGE = 5e-3
BEND_NOISE_FACTOR = 3.0
# The variance of fourth differences of independent rows over that of a row.
FOURTH_DIFFERENCE_VARIANCE = 70.0
# A tool that feels less than this share of the largest force hangs in the air, or all but.
AIR_SHARE_OF_FORCE = 0.01
# At no more than this times the noise of an imposed force the tool may hang in the air: noise exceeds it once in 1000 rows.
LOOSE_TOOL_NOISE_FACTOR = 3.0
# Protocols are nominally equal within this share of their range, and specimens within this share of a length.
EQUAL_PROGRAMME_SHARE, EQUAL_LENGTH_SHARE = 0.05, 0.1
# A curve keeps rows on which its displacement does not depend rather than be left with fewer rows than this.
FEWEST_ROWS = 3
# Programmes are compared at so many instants.
COMPARED_INSTANTS = 50


def rest_of(curve: Curve) -> float:
    """The value of the imposed column in the state at rest."""
    return 1.0 if curve.imposed == "stretch" else 0.0


def distance_from_rest(curve: Curve, programme: np.ndarray) -> np.ndarray:
    """How far the imposed column (k,) is from rest; the approach of a tool to the specimen is rest."""
    moved = np.abs(programme - rest_of(curve))
    if curve.tool is not None and curve.tool.shape != "bonded-disc" and programme.max() > 0.0:
        moved[: int(np.argmax(programme > 0.0))] = 0.0
    return moved


def determined(curve: Curve) -> np.ndarray:
    """Which rows (k,) a model can answer.

    Where the force is imposed and no more than noise, the tool may hang in the air anywhere above the specimen: no model says
    where. A tool that is tied to the specimen cannot.
    """
    every = np.ones(len(curve.time_s), dtype=bool)
    if curve.tool is None or curve.tool.control != "force" or curve.tool.shape == "bonded-disc":
        return every
    pressed = curve.force_N > LOOSE_TOOL_NOISE_FACTOR * _imposed_sd(curve)
    return pressed if pressed.sum() >= FEWEST_ROWS else every


def series_of(curve: Curve, test: str, peers: str) -> Series:
    """A measured curve as the loop sees it, with the rows that a model can answer.

    Parameters
    ----------
    test : what all curves of its test share.
    peers : what all tests nominally equal to it share; "" if there are none.
    """
    protocol = driven_of(curve).protocol
    programme, values = protocol.fitted, curve.columns[curve.predicted]
    span = max(float(np.ptp(programme)), 1e-300)
    sd = _imposed_sd(curve)
    corners = bends(curve.time_s, programme, max(BEND_SHARE_OF_RANGE * span, BEND_NOISE_FACTOR * sd))
    moved = distance_from_rest(curve, np.interp(curve.time_s, curve.time_s[corners], programme[corners]))
    pace = np.gradient(moved, curve.time_s)
    fast = float(np.quantile(np.abs(pace), FAST_ROWS_QUANTILE))
    still = WAITING_SHARE_OF_PACE * max(fast, LEAST_SHARE_OF_FASTEST_STEP * float(np.abs(pace).max()))
    phase = np.where(pace > still, "loading", np.where(pace < -still, "unloading", "hold"))
    slope = _slope(programme, values, span)
    unit, factor = PRINTED_UNITS[curve.predicted]
    corners = np.unique(np.concatenate([corners, _ends_of_contact(curve)]))
    rows = np.flatnonzero(determined(curve))
    ends = np.searchsorted(rows, corners)
    number = curve.conditions.get("repeat", curve.conditions.get("order", 0))
    return Series(
        id=curve.id,
        curve=curve.id,
        test=test,
        peers=peers,
        specimen="" if curve.group == curve.id else curve.group,
        constants=curve.constants,
        measured=values[rows],
        time_s=curve.time_s[rows],
        noise_sd=sd_of(curve, curve.predicted),
        imposed_sd=np.abs(slope[rows]) * protocol.row_sd,
        slope=slope[rows],
        bends=np.unique(np.clip(np.concatenate([[0], ends, [len(rows) - 1]]), 0, len(rows) - 1)),
        scatter=curve.noise.repeat_sd_fraction,
        trend=float(number) if isinstance(number, int | float) else 0.0,
        phase=phase[rows],
        unit=unit,
        factor=factor,
    )


def _ends_of_contact(curve: Curve) -> np.ndarray:
    """The rows where a tool whose displacement is imposed comes into contact or leaves it: there the force bends."""
    nowhere = np.zeros(0, dtype=np.int64)
    if curve.tool is None or curve.tool.control != "displacement" or curve.tool.shape == "bonded-disc":
        return nowhere
    pressed = np.flatnonzero(np.abs(curve.force_N) > AIR_SHARE_OF_FORCE * np.abs(curve.force_N).max())
    if not len(pressed):
        return nowhere
    first, last = pressed[0] - 1, pressed[-1] + 1
    rows_in_the_air = {int(first): first + 1, int(last): len(curve.force_N) - last}
    return np.array([end for end, count in rows_in_the_air.items() if count >= FEWEST_ROWS], dtype=np.int64)


def _imposed_sd(curve: Curve) -> float:
    """Standard deviation of the noise of the imposed column, SI: as stated, or as large as the programme is rough."""
    sd = sd_of(curve, curve.imposed)
    if sd is not None:
        return sd
    fourth = np.abs(np.diff(programme_of(curve), 4))
    roughness = MEDIAN_OF_ABSOLUTE_NORMAL * np.sqrt(FOURTH_DIFFERENCE_VARIANCE)
    return float(np.median(fourth)) / roughness if len(fourth) else 0.0


def _slope(programme: np.ndarray, values: np.ndarray, span: float) -> np.ndarray:
    """How much the predicted column changes with the imposed one, at each row: a stiffening curve is steep at its end."""
    degree = min(3, len(np.unique(programme)) // 4)
    line = np.polynomial.Polynomial.fit(programme, values, degree) if degree and span > 1e-300 else None
    return np.full(len(values), float(np.ptp(values)) / span) if line is None else line.deriv()(programme)


def peers_of(curve: Curve, curves: Sequence[Curve]) -> str:
    """The first of the curves that is nominally equal to this one, if another one is."""
    equal = [c.id for c in curves if _nominally_equal(c, curve)]
    return equal[0] if len(equal) > 1 else ""


def _nominally_equal(one: Curve, other: Curve) -> bool:
    """Whether two curves are one test on one kind of specimen, repeated."""
    same = one.constants == other.constants and one.kind == other.kind
    same = same and all(one.conditions.get(key) == other.conditions.get(key) for key in ("direction", "material", "cycle"))
    if not same or not _alike(one.tool, other.tool, ("radius_mm", "edge_radius_mm")):
        return False
    if not _alike(one.specimen, other.specimen, ("radius_mm", "height_mm", "layer_mm")):
        return False
    share = EQUAL_PROGRAMME_SHARE
    end = min(one.time_s[-1], other.time_s[-1])
    if end < (1.0 - 2.0 * share) * max(one.time_s[-1], other.time_s[-1]):
        return False
    grid = np.linspace(0.0, end, COMPARED_INSTANTS)
    a, b = (np.interp(grid, c.time_s, programme_of(c)) for c in (one, other))
    return float(np.sqrt(np.mean((a - b) ** 2))) < share * max(float(np.ptp(a)), float(np.ptp(b)))


def _alike(
    one: MeasuredSpecimen | MeasuredTool | None, other: MeasuredSpecimen | MeasuredTool | None, lengths: Iterable[str]
) -> bool:
    """Whether two tools, or two specimens, are of one shape and about one size."""
    if one is None or other is None:
        return one is other
    if one.shape != other.shape:
        return False
    pairs = [(getattr(one, key, None), getattr(other, key, None)) for key in lengths]
    return all(a == b or (a and b and abs(a - b) < EQUAL_LENGTH_SHARE * max(a, b)) for a, b in pairs)
