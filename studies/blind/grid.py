"""Planned curves of a homogeneous test, and the instants at which its numerics follow them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

Mode = Literal["uniaxial", "shear", "platen"]
Conditions = dict[str, float | str]  # of a curve, as in the dataset
Parameters = dict[str, Any]  # of an effect, as a model file states them: numbers, or lists of numbers
Effects = Mapping[str, Parameters]  # by their names


@dataclass(frozen=True, eq=False)
class HomogeneousRun:
    """A curve before noise is added to it.

    Attributes
    ----------
    id : name of the curve.
    time_s (k,) : rows [s]; every corner of the programme is a row.
    imposed (k,) : stretch, amount of shear, or displacement of a platen [m].
    conditions : as in the dataset.
    test : number of the test. Curves of one test follow each other.
    split : "fit", "holdout", or None where the tool chooses.
    height_m, area_m2 : of the cylinder between platens.
    """

    id: str
    time_s: np.ndarray
    imposed: np.ndarray
    conditions: Conditions = field(default_factory=dict)
    test: int = 0
    split: str | None = None
    height_m: float = 1.0
    area_m2: float = 1.0

    @property
    def repeat(self) -> float:
        """The number of the repeat, which a drift from repeat to repeat is proportional to."""
        return float(self.conditions.get("repeat", self.conditions.get("cycle", 1)))


class Grid:
    """Instants of all curves in one array, each test beginning at rest.

    Attributes
    ----------
    imposed (m,) : the imposed value at the instants.
    increment_s (m,) : time since the last instant [s], 0 where a test begins.
    rows (n,) : the instants that are rows of the data.
    tests : slices of the instants, one a test.
    across (m,) : whether the fibres lie across the load.
    """

    def __init__(self, plan: Sequence[HomogeneousRun], parts: int, mode: Mode) -> None:
        tests: dict[int, list[HomogeneousRun]] = {}
        for curve in plan:
            tests.setdefault(curve.test, []).append(curve)
        times, ways, rows, heights, areas, across, self.tests = [], [], [], [], [], [], []
        self._paces, self._first = [], []
        count = 0
        for curves in tests.values():
            start, times_of_curves = 0.0, []
            for curve in curves:
                times_of_curves.append(curve.time_s + start)
                start = times_of_curves[-1][-1]
                later = curves[len(times_of_curves)] if len(times_of_curves) < len(curves) else None
                start += 0.0 if later is None else later.time_s[1]  # The next curve begins one row later.
            t, x = np.concatenate(times_of_curves), np.concatenate([curve.imposed for curve in curves])
            fine = np.interp(np.arange((len(t) - 1) * parts + 1) / parts, np.arange(len(t)), t)
            # A platen that is in the tissue already at the first row approached at the pace of its first movement; these instants
            # are for its approach.
            before = parts if mode == "platen" else 0
            times.append(np.concatenate([np.full(before, fine[0]), fine]))
            ways.append(np.concatenate([np.zeros(before), np.interp(fine, t, x)]))
            rows.append(count + before + parts * np.arange(len(t)))
            size = before + len(fine)
            self.tests.append(slice(count, count + size))
            heights.append(np.full(size, curves[0].height_m))
            areas.append(np.full(size, curves[0].area_m2))
            across.append(np.full(size, curves[0].conditions.get("direction") == "cross-fibre"))
            moving = np.flatnonzero(np.abs(np.diff(x)) > 0.0)[0]
            self._paces.append(abs(x[moving + 1] - x[moving]) / (t[moving + 1] - t[moving]))
            self._first.append(slice(count, count + before))
            count += size
        self.imposed = np.concatenate(ways)
        self.rows = np.concatenate(rows)
        self.height_m, self.area_m2 = np.concatenate(heights), np.concatenate(areas)
        self.across = np.concatenate(across)
        self.increment_s = np.diff(np.concatenate(times), prepend=0.0)
        self.increment_s[[test.start for test in self.tests]] = 0.0

    def approach_with(self, offset_m: float | np.ndarray) -> np.ndarray:
        """Depths of the platen in the tissue (m,) [m]; sets the time of its approach, where it begins in the tissue."""
        depths = self.imposed + offset_m
        for first, pace in zip(self._first, self._paces, strict=True):
            depth = max(float(depths[first.stop]), 0.0)
            parts = first.stop - first.start
            depths[first] = depth * np.arange(parts) / parts
            self.increment_s[first.start + 1 : first.stop + 1] = depth / pace / parts
        return depths
