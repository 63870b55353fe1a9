"""Tests under a tool by the implicit solver: programmes, the rig between tool and reading, and the rows that are read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

from studies.blind.foreign.axisymmetric import Drive, Press, RoundSpecimen
from studies.blind.foreign.contact import RigidTool
from studies.blind.foreign.law import HiddenTissue
from studies.blind.grid import Conditions

RAMP_POINTS = 18  # depths of an elastic curve
RAMP_EXPONENT = 1.4  # The depths lie closer to each other at first touch.
RAMP_MARGIN_SHARE = 0.02  # by which it goes on beyond the largest depth
LARGEST_INCREMENT_SHARE = 1.0 / 12.0  # of the largest displacement or force, where the answer depends on the past
INCREMENTS_OF_A_HOLD = 12
RELEASED_SHARE = 1e-4  # of the largest force: the tool rests on tissue that has not recovered


@dataclass(frozen=True)
class RigReading:
    """What stands between the tool and the reading.

    Attributes
    ----------
    offset_mm : way of the tool into the tissue where the displacement reads 0; negative is a gap.
    compliance_mm_N : of the reading.
    force_offset_N, force_drift_N_s : of the load cell.
    lag_s : by which the force is read late.
    saturation_N : force F is read as F / (1 + F / saturation).
    """

    offset_mm: float = 0.0
    compliance_mm_N: float = 0.0
    force_offset_N: float = 0.0
    force_drift_N_s: float = 0.0
    lag_s: float = 0.0
    saturation_N: float = np.inf

    def read(self, force_N: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        """The force that is read [N]."""
        return force_N / (1.0 + force_N / self.saturation_N) + self.force_offset_N + self.force_drift_N_s * time_s


@dataclass(frozen=True)
class ColumnNoise:
    """Standard deviations of the rows of both columns; 0 is exact."""

    force_N: float
    displacement_mm: float


@dataclass(frozen=True, eq=False)
class ToolTest:
    """One curve.

    Attributes
    ----------
    corners : (time [s], displacement [mm] or force [N]) of the programme.
    rows (k,) : times that are read [s].
    test : number of the test. Curves of one test follow each other on the same specimen.
    """

    id: str
    specimen: RoundSpecimen
    tool: RigidTool
    corners: tuple[tuple[float, float], ...]
    by_force: bool
    rows: np.ndarray
    conditions: Conditions
    test: int
    split: str | None = None

    def imposed(self, time_s: np.ndarray) -> np.ndarray:
        """The programme at times."""
        t, x = np.array(self.corners).T
        return np.interp(time_s, t, x)

    @property
    def largest(self) -> float:
        return max(x for _, x in self.corners)


class ElasticCurve:
    """Force against depth of an elastic tissue without friction: a spline through equilibria."""

    def __init__(
        self,
        specimen: RoundSpecimen,
        tool: RigidTool,
        tissue: HiddenTissue,
        depth_mm: float,
        fineness: float,
        points: int = RAMP_POINTS,
    ) -> None:
        press = Press(specimen, tool, tissue, fineness)
        self.end_mm = (1.0 + RAMP_MARGIN_SHARE) * depth_mm
        share = (np.arange(1, points + 1) / points) ** RAMP_EXPONENT
        d = self.end_mm * share
        F = np.array([press.advance(0.0, Drive(True, depth))[1] for depth in d])
        self._spline = make_interp_spline(np.sqrt(d / self.end_mm), F / d, k=3)
        self._low = float(np.sqrt(share[0]))

    def force(self, depth_mm: np.ndarray) -> np.ndarray:
        """Force [N] at depths, 0 above the surface."""
        at = np.clip(depth_mm / self.end_mm, 0.0, None)
        return np.maximum(depth_mm, 0.0) * self._spline(np.maximum(np.sqrt(at), self._low))

    def depth(self, force_N: np.ndarray) -> np.ndarray:
        """Depth [mm] at forces."""
        top = float(self.force(np.array(1.5 * self.end_mm)))
        return np.array(
            [
                0.0 if f <= 0.0 else brentq(lambda d, f=f: float(self.force(np.array(d))) - f, 0.0, 1.5 * self.end_mm)
                for f in force_N
            ]
            if float(np.max(force_N)) <= top
            else np.full(len(force_N), np.nan)
        )


def depends_on_past(tissue: HiddenTissue, tool: RigidTool) -> bool:
    return bool(tissue.prony) or tissue.softening is not None or tool.friction > 0.0


def answers(
    tests: Sequence[ToolTest], tissue: HiddenTissue, reading: RigReading, depth_mm: Sequence[float], fineness: float
) -> list[np.ndarray]:
    """The predicted column of each test at its rows: force [N] where the displacement is imposed, else displacement [mm].

    Parameters
    ----------
    depth_mm : the largest depth of each test, about; a spline of the force begins with it.

    Raises
    ------
    RunError : a state cannot be computed.
    """
    curves: dict[tuple[RoundSpecimen, RigidTool], ElasticCurve] = {}
    columns: list[np.ndarray] = []
    if any(depends_on_past(tissue, test.tool) for test in tests):
        presses: dict[int, tuple[Press, float]] = {}
        for test in tests:
            press, start = presses.get(test.test, (None, 0.0))
            press = press or Press(test.specimen, test.tool, tissue, fineness)
            columns.append(_history(press, start, test, reading))
            presses[test.test] = press, start + float(test.rows[-1])
        return columns
    for test in tests:
        key = test.specimen, test.tool
        if key not in curves:
            deepest = max(d for d, other in zip(depth_mm, tests, strict=True) if (other.specimen, other.tool) == key)
            curves[key] = ElasticCurve(*key, tissue, deepest + max(reading.offset_mm, 0.0), fineness)
        columns.append(_elastic(curves[key], test, reading))
    return columns


def _elastic(curve: ElasticCurve, test: ToolTest, reading: RigReading) -> np.ndarray:
    if test.by_force:
        force = test.imposed(test.rows) - reading.force_offset_N - reading.force_drift_N_s * test.rows
        return curve.depth(np.maximum(force, 0.0)) + reading.compliance_mm_N * np.maximum(force, 0.0) - reading.offset_mm
    machine = test.imposed(test.rows - reading.lag_s) + reading.offset_mm
    depth = machine.copy()
    for _ in range(100 if reading.compliance_mm_N > 0.0 else 0):
        step = 1e-4 * curve.end_mm
        force = curve.force(depth)
        slope = (curve.force(depth + step) - curve.force(depth - step)) / (2.0 * step)
        change = (machine - depth - reading.compliance_mm_N * force) / (1.0 + reading.compliance_mm_N * slope)
        depth = depth + change
        if np.abs(change).max() < 1e-9 * curve.end_mm:
            break
    return reading.read(curve.force(depth), test.rows)


def _history(press: Press, start_s: float, test: ToolTest, reading: RigReading) -> np.ndarray:
    """Rows of a test whose tissue or contact remembers, from where the last curve of it ended."""
    read = test.rows - reading.lag_s
    corners = np.array([t for t, _ in test.corners])
    times = np.unique(np.round(np.concatenate([read[read > 0.0], corners[corners > 0.0], _between(test)]), 9))
    seen_t, seen = [0.0], [0.0 if test.by_force else press.state.force_N]
    if test.by_force:
        seen = [press.state.tool_mm - press.touch_mm + reading.compliance_mm_N * press.state.force_N]
    for t in times:
        target = float(test.imposed(np.array(t)))
        if test.by_force:
            target -= reading.force_offset_N + reading.force_drift_N_s * t
            target = max(target, RELEASED_SHARE * test.largest)
        else:
            target += reading.offset_mm
        drive = Drive(not test.by_force, target, 0.0 if test.by_force else reading.compliance_mm_N)
        depth, force = press.advance(start_s + t, drive)
        seen_t.append(float(t))
        seen.append(depth + reading.compliance_mm_N * force if test.by_force else force)
    column = np.interp(read, seen_t, seen)
    return column - reading.offset_mm if test.by_force else reading.read(column, test.rows)


def _between(test: ToolTest) -> np.ndarray:
    """Instants between the corners that keep increments small."""
    places = []
    for (t0, x0), (t1, x1) in zip(test.corners, test.corners[1:], strict=False):
        if x0 == x1:
            share = np.arange(1, INCREMENTS_OF_A_HOLD) / INCREMENTS_OF_A_HOLD
            places.append(t0 + (t1 - t0) * np.expm1(share * np.log(50.0)) / 49.0)
        else:
            count = int(np.ceil(abs(x1 - x0) / (LARGEST_INCREMENT_SHARE * test.largest)))
            places.append(np.linspace(t0, t1, count + 1)[1:-1])
    return np.concatenate(places)
