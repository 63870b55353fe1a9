"""Recordings of markers placed on a model: rest, start of the motion, registration, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from explicitfe.inverse.measured.curve import Curve, Sensor
from explicitfe.inverse.measured.registration import Registration, procrustes
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import InputError

# Markers move once their displacement exceeds this share of the largest one, which is beyond the wobble of a hand.
MOVING_SHARE = 0.03
# Rows at rest that give the reference positions: at most so many, and at least so many, this many rows before the motion is seen.
MOST_REST_ROWS, FEWEST_REST_ROWS, ROWS_OF_DOUBT = 20, 3, 2
# The start is searched within so many sampling intervals of where the motion is seen.
START_INTERVALS = 2.0
# Distances between markers that differ by more than this factor from those of the model are in another unit.
UNIT_FACTOR = 2.0
# Two markers are swapped if exchanging them lowers the mismatch at rest to this share of it, and it is larger than expected by
# the factor.
SWAPPED_SHARE, MISMATCH_FACTOR = 0.5, 3.0
# A fixed marker that moves by more than this share of the largest motion, and by more than so many standard deviations, is loose.
LOOSE_SHARE, LOOSE_SDS = 0.01, 8.0
HIGHEST_CORRELATION = 0.98
# The mean absolute difference of two normal numbers over their standard deviation, for the median.
MEDIAN_OF_DIFFERENCE = 0.9539
RIGID = RegistrationTable(rotation="fit", translation="fit")


@dataclass(frozen=True, eq=False)
class Placed:
    """A recording of markers, placed on the model.

    Attributes
    ----------
    start_s : start of the motion in the time of the file, as stated or as seen.
    interval_s : sampling interval.
    rest_m : sensor -> (3,) m, its mean position at rest in the frame of the sensors.
    registration : from the frame of the sensors to that of the model, by the positions at rest.
    noise_m : standard deviation of a coordinate at rest.
    mismatch_m : rms distance at rest from the positions that the dataset states.
    """

    start_s: float
    interval_s: float
    rest_m: Mapping[str, np.ndarray]
    registration: Registration
    noise_m: float
    mismatch_m: float

    def displacement(self, curve: Curve, sensor: str) -> np.ndarray:
        """Measured displacement (k, 3) m of a marker from its rest, in the frame of the model; NaN where a value is missing."""
        return (curve.sensors[sensor] - self.rest_m[sensor]) @ self.registration.rotation.T


def place_on_model(curve: Curve, sensors: Mapping[str, Sensor]) -> Placed:
    """Place a recording on the model.

    Raises
    ------
    InputError : no rows at rest, another unit, swapped markers, or a marker without a value at rest.
    """
    moving = [name for name, sensor in sensors.items() if not sensor.fixed]
    interval_s = float(np.median(np.diff(curve.time_s)))
    start_s = _start_seen(curve, moving) if curve.start_s is None else curve.start_s
    doubt_s = ROWS_OF_DOUBT * interval_s if curve.start_s is None else 0.0
    before = np.flatnonzero(curve.time_s < start_s - doubt_s + 1e-9)[-MOST_REST_ROWS:]
    if len(before) < FEWEST_REST_ROWS:
        raise InputError(
            f'curve "{curve.id}": the markers already move at {start_s:.3g} s, after {len(before)} rows at rest; begin the '
            f"recording at least {FEWEST_REST_ROWS + ROWS_OF_DOUBT} rows before the release, or state start_s."
        )
    at_rest: dict[str, np.ndarray] = {}
    steps = []
    for name in sensors:
        rows = curve.sensors[name][before]
        rows = rows[np.isfinite(rows).all(axis=1)]
        if not len(rows):
            raise InputError(f'curve "{curve.id}": marker "{name}" has no value at rest, before {start_s:.3g} s; omit it.')
        at_rest[name] = rows.mean(axis=0)
        steps.append(np.abs(np.diff(rows, axis=0)))
    names = list(sensors)
    model, seen = np.array([sensors[name].at_m for name in names]), np.array([at_rest[name] for name in names])
    _check_unit(curve.id, model, seen)
    expected_m = float(np.sqrt(3.0 * np.mean([sensors[name].place_sd_m ** 2 for name in names])))
    _check_order(curve.id, names, model, seen, expected_m)
    registration = procrustes(RIGID, model, seen)
    differences = np.concatenate(steps)
    noise_m = float(np.median(differences[differences > 0.0])) / MEDIAN_OF_DIFFERENCE if (differences > 0.0).any() else 0.0
    return Placed(start_s, interval_s, at_rest, registration, noise_m, _mismatch(registration, model, seen))


def remarks(curve: Curve, placed: Placed, sensors: Mapping[str, Sensor]) -> list[str]:
    """Sentences on a stated start, missing rows, loose fixed markers and a mismatch at rest."""
    notes = _remarks_on_start(curve, [name for name, sensor in sensors.items() if not sensor.fixed])
    moved = {name: placed.displacement(curve, name) for name in sensors}
    largest_m = max(float(np.nanmax(np.linalg.norm(d, axis=1))) for d in moved.values())
    for name, sensor in sensors.items():
        missing = np.flatnonzero(~np.isfinite(moved[name]).all(axis=1))
        if len(missing):
            notes.append(
                f'curve "{curve.id}": marker "{name}" is missing in {len(missing)} rows '
                f"({len(missing) * placed.interval_s:.3g} s, from {curve.time_s[missing[0]]:.4g} s on); they are not used."
            )
        if sensor.fixed:
            after = moved[name][curve.time_s > placed.start_s]
            drift_m = float(np.nanmax(np.linalg.norm(after, axis=1), initial=0.0))
            if drift_m > max(LOOSE_SHARE * largest_m, LOOSE_SDS * placed.noise_m):
                notes.append(
                    f'curve "{curve.id}": the fixed marker "{name}" moves by {1e3 * drift_m:.2g} mm after the release, where '
                    f"others move by up to {1e3 * largest_m:.3g} mm; the clamp or the marker is loose."
                )
    expected_m = float(np.sqrt(3.0 * np.mean([sensor.place_sd_m**2 for sensor in sensors.values()])))
    if placed.mismatch_m > MISMATCH_FACTOR * expected_m:
        notes.append(
            f'curve "{curve.id}": at rest the markers lie {1e3 * placed.mismatch_m:.2g} mm (rms) from at_mm, which is said to be '
            f"known to {1e3 * expected_m / np.sqrt(3.0):.2g} mm; check at_mm."
        )
    return notes


def _remarks_on_start(curve: Curve, moving: Sequence[str]) -> list[str]:
    """A sentence if a stated start is farther from the seen one than the body takes from rest to its farthest position."""
    if curve.start_s is None:
        return []
    seen_s, farthest_s = _start_seen(curve, moving), float(curve.time_s[np.argmax(_progress(curve, moving))])
    if abs(curve.start_s - seen_s) <= farthest_s - seen_s:
        return []
    return [
        f'curve "{curve.id}": the markers begin to move at {seen_s:.3g} s, but start_s is {curve.start_s:.3g} s; correct it, or '
        f'let it be fitted with start_s = "fit".'
    ]


def _progress(curve: Curve, moving: Sequence[str]) -> np.ndarray:
    """Of the rows (k,) the share of the farthest displacement of all markers together, along it, so that noise averages out."""
    rows = np.concatenate([curve.sensors[name] for name in moving], axis=1)
    moved = np.nan_to_num(rows - np.nanmedian(rows[: FEWEST_REST_ROWS + ROWS_OF_DOUBT], axis=0))
    farthest = moved[np.argmax(np.sum(moved**2, axis=1))]
    return np.asarray(moved @ farthest / max(float(farthest @ farthest), 1e-300))


def _start_seen(curve: Curve, moving: Sequence[str]) -> float:
    """Time at which the markers begin to move, not before the first row.

    A body that is released moves by a t^2 / 2 at first. The start follows from the times at which the displacement passes a share
    of its maximum and four times this share: it lies as long before the first as the second lies after it.
    """
    progress = _progress(curve, moving)
    late = int(np.argmax(progress > 4.0 * MOVING_SHARE))
    # The last row below the smaller share: noise may exceed it before.
    early = int(np.max(np.flatnonzero(progress[:late] <= MOVING_SHARE), initial=-1)) + 1
    early_s, late_s = (_crossing(curve.time_s, progress, *one) for one in ((early, MOVING_SHARE), (late, 4.0 * MOVING_SHARE)))
    return max(early_s - (late_s - early_s), float(curve.time_s[0]))


def _crossing(time_s: np.ndarray, progress: np.ndarray, row: int, level: float) -> float:
    """Time at which a level is exceeded before a row, interpolated between rows."""
    if row == 0:
        return float(time_s[0])
    share = (level - progress[row - 1]) / max(progress[row] - progress[row - 1], 1e-300)
    return float(time_s[row - 1] + share * (time_s[row] - time_s[row - 1]))


def _check_unit(curve: str, model: np.ndarray, seen: np.ndarray) -> None:
    """Refuse distances between markers that can only be right in another unit."""
    expected_m, seen_m = (float(np.sqrt(np.mean(np.sum((x - x.mean(axis=0)) ** 2, axis=1)))) for x in (model, seen))
    ratio = seen_m / expected_m
    if not 1.0 / UNIT_FACTOR < ratio < UNIT_FACTOR:
        raise InputError(
            f'curve "{curve}": the markers lie {1e3 * seen_m:.3g} mm from their centre at rest, {ratio:.3g} times as far as '
            f"at_mm says ({1e3 * expected_m:.3g} mm); check the units, which must be mm."
        )


def _check_order(curve: str, names: Sequence[str], model: np.ndarray, seen: np.ndarray, expected_m: float) -> None:
    """Refuse markers whose names are exchanged."""
    now = _mismatch(procrustes(RIGID, model, seen), model, seen)
    if now <= MISMATCH_FACTOR * expected_m:
        return
    tried = []
    for i, j in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[i], order[j] = j, i
        tried.append((_mismatch(procrustes(RIGID, model, seen[order]), model, seen[order]), i, j))
    best, i, j = min(tried)
    if best < SWAPPED_SHARE * now:
        raise InputError(
            f'curve "{curve}": markers "{names[i]}" and "{names[j]}" are swapped: exchanged, they lower the mismatch at rest '
            f"from {1e3 * now:.3g} to {1e3 * best:.3g} mm; rename their columns."
        )


def _mismatch(registration: Registration, model: np.ndarray, seen: np.ndarray) -> float:
    """Rms distance (m) of registered positions from those of the model."""
    return float(np.sqrt(np.mean(np.sum((registration.to_model(seen) - model) ** 2, axis=1))))


def rotation_sds(at_m: np.ndarray, place_sd_m: np.ndarray) -> np.ndarray:
    """Standard deviations (3,) rad of the rotation about each axis of a registration, from errors of the places of markers.

    To first order of small rotations, Cov = (sum (r^2 I - r r^T) / sd^2)^-1 with r the places from their centre.
    """
    r = at_m - at_m.mean(axis=0)
    weight = 1.0 / np.maximum(place_sd_m, 1e-6) ** 2
    information = sum(w * (x @ x * np.eye(3) - np.outer(x, x)) for w, x in zip(weight, r, strict=True))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


@dataclass(frozen=True, eq=False)
class RepeatScatter:
    """How much repeats of one test differ, along each axis.

    Attributes
    ----------
    share : (3,) standard deviation as a share of the largest distance that a marker moves.
    correlation, common : (3,) of rows that follow each other, and of markers at one time.
    pairs : number of pairs that it rests on.
    """

    share: np.ndarray
    correlation: np.ndarray
    common: np.ndarray
    pairs: int


def scatter_of_repeats(groups: Sequence[Sequence[tuple[Curve, Placed]]], moving: Sequence[str]) -> RepeatScatter | None:
    """Differences between repeats, aligned at their starts; None where no test was repeated.

    Parameters
    ----------
    groups : curves of one test each.
    moving : names of the markers that move.
    """
    differences = []
    for (a, first), (b, second) in (pair for group in groups for pair in combinations(group, 2)):
        shift_s = _best_shift(a, first, b, second, moving)
        differences.append(np.nan_to_num(_differences(a, first, b, second, moving, shift_s)))
    if not differences:
        return None
    rows = sum(len(d) for d in differences)
    square = sum(np.sum(d**2, axis=(0, 1)) for d in differences)
    lagged = sum(np.sum(d[1:] * d[:-1], axis=(0, 1)) for d in differences)
    together = sum(np.sum(np.sum(d, axis=1) ** 2, axis=0) for d in differences) - square
    size = np.maximum(square, 1e-300)
    return RepeatScatter(
        np.sqrt(square / (rows * len(moving))),
        np.clip(lagged / size, 0.0, HIGHEST_CORRELATION),
        np.clip(together / (size * max(len(moving) - 1, 1)), 0.0, 1.0),
        len(differences),
    )


def _best_shift(a: Curve, first: Placed, b: Curve, second: Placed, moving: Sequence[str]) -> float:
    """Correction of the second start [s] that makes two repeats differ least; each start is fitted later anyway."""
    step = 0.1 * first.interval_s
    tried = step * np.arange(-20, 21)
    sizes = [float(np.nanmean(_differences(a, first, b, second, moving, float(shift)) ** 2)) for shift in tried]
    return float(tried[int(np.argmin(sizes))])


def _differences(a: Curve, first: Placed, b: Curve, second: Placed, moving: Sequence[str], shift_s: float) -> np.ndarray:
    """Differences (k, s, 3) of one curve of a pair after its start, as shares of the largest distances."""
    t = a.time_s - first.start_s
    end = min(t[-1], b.time_s[-1] - second.start_s - abs(shift_s))
    t = t[(t > 0.0) & (t <= end)]
    left = np.empty((len(t), len(moving), 3))
    for k, name in enumerate(moving):
        one, other = first.displacement(a, name), second.displacement(b, name)
        size = max(float(np.nanmax(np.linalg.norm(d, axis=1))) for d in (one, other))
        for axis in range(3):
            x = np.interp(t, a.time_s - first.start_s, one[:, axis])
            y = np.interp(t + shift_s, b.time_s - second.start_s, other[:, axis])
            left[:, k, axis] = (x - y) / (np.sqrt(2.0) * size)
    return left
