"""Division of a length into cells: small cells in zones, growing away from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Marks of ``stations`` nearer than this share of the length are one: far below any element, far above rounding.
_SAME_MARK_SHARE = 1e-9

# How far the ratio of neighbouring cells may exceed ``growth`` where two intervals meet.
_GROWTH_TOLERANCE_RATIO = 1.05


def stations(
    length_m: float,
    zones: Sequence[tuple[float, float, float]],
    *,
    largest_m: float,
    growth: float = 1.25,
    breaks_m: Sequence[float] = (),
) -> np.ndarray:
    """Where to cut a length: small cells in the zones, growing away from them; (k,) m, from 0 to ``length_m``.

    Parameters
    ----------
    length_m : the length, m.
    zones : (start, stop, size) each, m. No cell between start and stop is larger than size. They may reach beyond the length.
    largest_m : no cell is larger, m.
    growth : neighbouring cells differ by no more than this ratio, by 5 % more where a mark forces them to.
    breaks_m : positions to hit, m; those outside the length do not count.

    Breaks and bounds of zones are hit to the last bit. Of marks nearer to each other than 1e-9 of the length only one is:
    the ends come first, then breaks, then bounds.

    Raises
    ------
    ValueError
        A length or size that is not positive, a growth not above 1, a zone that stops before it starts, a break not finite.
    """
    intervals = np.array(zones, dtype=float).reshape(-1, 3)
    positive = np.array([length_m, largest_m, *intervals[:, 2]])
    if not (np.isfinite(positive).all() and (positive > 0.0).all()):
        raise ValueError("length, largest size and sizes of zones must be positive")
    if not growth > 1.0:
        raise ValueError(f"growth must be above 1, not {growth}")
    if not (intervals[:, 0] <= intervals[:, 1]).all() or not np.isfinite(breaks_m).all():
        raise ValueError("a zone must not stop before it starts, breaks must be finite")

    hits = [0.0, float(length_m)]
    for mark in [*breaks_m, *intervals[:, :2].ravel()]:
        if 0.0 < mark < length_m and np.abs(np.array(hits) - mark).min() > _SAME_MARK_SHARE * length_m:
            hits.append(float(mark))
    marks = np.sort(hits)

    while True:
        positions = _divided(marks, intervals, largest_m, np.log(growth))
        cells = np.diff(positions)
        # A small cell between two marks is a zone of its own: the cells around have to grow from it.
        lower, upper = cells[:-1], cells[1:]
        small = np.union1d(
            np.flatnonzero(upper > _GROWTH_TOLERANCE_RATIO * growth * lower),
            np.flatnonzero(lower > _GROWTH_TOLERANCE_RATIO * growth * upper) + 1,
        )
        if len(small) == 0:
            return positions
        intervals = np.concatenate([intervals, np.column_stack([positions[small], positions[small + 1], cells[small]])])


def _divided(marks: np.ndarray, zones: np.ndarray, largest: float, slope: float) -> np.ndarray:
    """The marks and, between them, whole cells that follow the size h(x): the smallest that a zone asks for at x.

    A cell is a step of 1 in the integral of 1 / h. Where h = size + slope * distance, cells grow by exp(slope). Between two
    marks all cells shrink alike, to a whole number of them.
    """
    start, stop, size = zones.T
    rise = (size[:, None] - size) / slope
    kinks = [
        marks,
        start - (largest - size) / slope,
        stop + (largest - size) / slope,
        ((stop + start[:, None] + rise) / 2.0).ravel(),
        (stop + rise).ravel(),
        (start - rise).ravel(),
    ]
    x = np.unique(np.concatenate(kinks))
    x = x[(x >= marks[0]) & (x <= marks[-1])]
    distance = np.maximum(np.maximum(start - x[:, None], x[:, None] - stop), 0.0)
    h = np.minimum(largest, (size + slope * distance).min(axis=1, initial=np.inf))

    # h is linear between kinks, so the integral is a logarithm and its inverse an exponential.
    width = np.diff(x)
    change = h[1:] / h[:-1] - 1.0
    count = width / h[:-1] * _ratio(np.log1p(change), change)
    total = np.concatenate([[0.0], np.cumsum(count)])
    rate = np.diff(h) / width

    pieces = []
    ends = total[np.searchsorted(x, marks)]
    for mark, first, last in zip(marks[:-1], ends[:-1], ends[1:], strict=True):
        whole = max(1, int(np.ceil(last - first - _SAME_MARK_SHARE)))
        goal = first + (last - first) * np.arange(1, whole) / whole
        k = np.searchsorted(total, goal, side="right") - 1
        part = goal - total[k]
        exponent = rate[k] * part
        pieces += [[mark], x[k] + h[k] * part * _ratio(np.expm1(exponent), exponent)]
    return np.concatenate([*pieces, marks[-1:]])


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """The ratio of two that vanish together, with the limit 1."""
    return np.divide(numerator, denominator, out=np.ones_like(denominator), where=denominator != 0.0)
