"""Missing, swapped, jumping and constant markers in a recording."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

import numpy as np

from explicitfe.platform.errors import InputError, shortened

# Tongues reach 0.3 m/s (docs/studies/kinematics.md). A step above this speed, and above this multiple of the steps around it, is
# no movement.
JUMP_SPEED_M_PER_S = 1.0
JUMP_OF_STEPS_AROUND = 5.0
STEPS_AROUND = 10
SMALLEST_SWAP_M = 1e-3
# Of an interchange of two markers: the distances to the other's place, relative to those to the own one.
SWAP_SHARE = 0.5
# Coordinates that are one number are no position if this share of it separates them from the rows around.
DETACHED_SHARE = 0.5
HELD_ROWS = 10  # equal positions in so many rows, while another marker moves by at least this:
MOVES_M = 1e-3
MM_PER_M, MS_PER_S = 1e3, 1e3


def without_lost_markers(
    path: Path, time_s: np.ndarray, positions: Mapping[str, np.ndarray], planar: bool, notes: list[str]
) -> dict[str, np.ndarray]:
    """Set lost positions to nan, and omit sensors without any value.

    A marker is lost where it is at exactly (0, 0, 0), and where its coordinates are one number, such as -16512, far from the rows
    around.

    Parameters
    ----------
    positions : sensor -> (k, 3) m.

    Raises
    ------
    InputError : no sensor has a value, or the numbers are displacements from the first row.
    """
    answer, zero_first, near = {}, 0, 0
    for name, place in positions.items():
        axes = place[:, [0, 2]] if planar else place
        equal = (np.abs(axes) == np.abs(axes[:, :1])).all(axis=1)
        lost = equal & (axes[:, 0] == 0.0)
        usual = np.isfinite(axes).all(axis=1) & ~equal
        if usual.any():
            rows = np.arange(len(place))
            between = np.column_stack([np.interp(rows, rows[usual], column[usual]) for column in place.T])
            lost |= equal & (np.abs(place - between).max(axis=1) > DETACHED_SHARE * np.abs(place).max(axis=1))
        zero_first += bool(lost[0] and not lost[1:].any())
        near += bool(lost[0] and np.linalg.norm(place[1]) < JUMP_SPEED_M_PER_S * (time_s[1] - time_s[0]))
        seen = np.where(lost[:, None], np.nan, place)
        if np.isfinite(seen).all(axis=1).any():
            answer[name] = seen
            values = sorted({f"{MM_PER_M * value:.6g}" for value in place[lost, 0]})
            if lost.any():
                what = "(0, 0, 0)" if values == ["0"] else f"one number in all coordinates ({', '.join(values[:3])} mm)"
                notes.append(f"{path}: {shortened(name)} is at {what} in {lost.sum()} rows, which is taken as missing.")
    if len(positions) > 1 and near == len(positions) == zero_first:
        raise InputError(
            f"{path}: all sensors are at (0, 0, 0) in the first row and near it in the next; give positions, no displacements."
        )
    never = [name for name in positions if name not in answer]
    if never:
        notes.append(f"{path}: markers without any value are omitted: {', '.join(map(shortened, never))}.")
    if not answer:
        raise InputError(f"{path}: no marker has a value; export the recording again.")
    return answer


def doubts(path: Path | str, time_s: np.ndarray, positions: Mapping[str, np.ndarray]) -> list[str]:
    """Name markers that are interchanged, jump, or keep their place while others move."""
    notes, swapped, leaps = [], {name: set[int]() for name in positions}, dict.fromkeys(positions, 0)
    for a, b in combinations(positions, 2):
        rows = np.flatnonzero(np.isfinite(positions[a] + positions[b]).all(axis=1))
        steps = _swaps(positions[a][rows], positions[b][rows])
        if len(steps):
            swapped[a] |= {int(row) for row in rows[steps + 1]}
            swapped[b] |= {int(row) for row in rows[steps + 1]}
            times = [f"{time_s[row]:.4g}" for row in rows[steps + 1]] + ["the end"] * (len(steps) % 2)
            spans = [f"{start} to {end}" for start, end in zip(times[::2], times[1::2], strict=True)]
            shown = ", ".join(spans[:3]) + (f" and {len(spans) - 3} more" if len(spans) > 3 else "")
            notes.append(
                f"{path}: {shortened(a)} and {shortened(b)} appear to be interchanged from {shown} s; exchange them there."
            )
    for name, place in positions.items():
        rows = np.flatnonzero(np.isfinite(place).all(axis=1))
        step_m = np.linalg.norm(np.diff(place[rows], axis=0), axis=1)
        speed = step_m / np.diff(time_s[rows])
        fast = [k for k in np.flatnonzero(speed > JUMP_SPEED_M_PER_S) if rows[k + 1] not in swapped[name]]
        jumps = [k for k in fast if _stands_out(step_m, int(k))]
        leaps[name] = len(jumps)
        if jumps:
            worst = max(jumps, key=lambda k: step_m[k])
            within_ms = MS_PER_S * (time_s[rows[worst + 1]] - time_s[rows[worst]])
            others = f", and jumps {len(jumps) - 1} more times" if len(jumps) > 1 else ""
            notes.append(
                f"{path}: {shortened(name)} jumps by {MM_PER_M * step_m[worst]:.3g} mm within {within_ms:.3g} ms "
                f"({speed[worst]:.2g} m/s) at {time_s[rows[worst + 1]]:.4g} s{others}; above {JUMP_SPEED_M_PER_S:g} m/s it is no "
                f"movement of a tongue; leave the cells of a lost marker empty."
            )
    jumping = {name for name in positions if swapped[name] or leaps[name]}
    return notes + _repeats(path, time_s, positions, jumping)


def _stands_out(steps: np.ndarray, number: int) -> bool:
    """Whether a step is much longer than the typical one around it."""
    low = max(number - STEPS_AROUND, 0)
    around = np.delete(steps[low : number + STEPS_AROUND + 1], number - low)
    return bool(len(around) == 0 or steps[number] > JUMP_OF_STEPS_AROUND * np.median(around))


def _swaps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Steps (j,) in which two markers take each other's place."""
    own = [np.linalg.norm(np.diff(place, axis=0), axis=1) for place in (a, b)]
    other = np.linalg.norm(a[1:] - b[:-1], axis=1) + np.linalg.norm(b[1:] - a[:-1], axis=1)
    both = (other < SWAP_SHARE * (own[0] + own[1])) & (np.minimum(*own) > SMALLEST_SWAP_M)
    return np.array([k for k in np.flatnonzero(both) if all(_stands_out(steps, int(k)) for steps in own)], dtype=int)


def _repeats(path: Path | str, time_s: np.ndarray, positions: Mapping[str, np.ndarray], jumping: set[str]) -> list[str]:
    """Markers whose coordinates repeat exactly while another one moves, and does not jump."""
    notes = []
    for name, place in positions.items():
        same = np.append(False, (np.diff(place, axis=0) == 0.0).all(axis=1))
        ends = np.flatnonzero(np.diff(np.append(np.append(False, same), False).astype(int)))
        spans = [(start - 1, end - 1) for start, end in zip(ends[::2], ends[1::2], strict=True) if end - start >= HELD_ROWS - 1]
        moving = [
            (start, end)
            for start, end in spans
            if any(
                np.isfinite(part).any() and np.nanmax(np.ptp(part, axis=0)) > MOVES_M
                for part in (other[start : end + 1] for key, other in positions.items() if key not in (name, *jumping))
            )
        ]
        if moving:
            start, end = max(moving, key=lambda span: span[1] - span[0])
            notes.append(
                f"{path}: {shortened(name)} keeps exactly the same position in {end - start + 1} rows from {time_s[start]:.4g} s "
                f"on while other sensors move; leave the cells empty if it was lost."
            )
    return notes
