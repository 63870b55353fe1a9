"""Continuous polyline with free corners, fitted to rows of unit noise.

The segments follow from dynamic programming (Bellman & Roth 1969, pruned as by Killick et al. 2012), the corners from nonlinear
least squares, and their number from the criterion of Schwarz (1978) with prior odds against each corner. A polyline is given as
its chi2 and the times of its corners (m - 2,); its knots (m,) are the first row, the corners and the last row.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.linalg import solveh_banded

# Segment boundaries that are compared by dynamic programming; more rows than this are joined in blocks.
MOST_BOUNDARIES = 400
# A row is a boundary of a block if its second difference exceeds so many standard deviations of its noise.
BOUNDARY_SDS = 4.0
# Iterations of Levenberg and Marquardt, and the decrease of chi2 below which they end.
MOST_STEPS_OF_CORNERS = 30
SMALLEST_DECREASE = 1e-3
SMALLEST_DAMPING, LARGEST_POLYLINE_DAMPING = 1e-9, 1e4
# A pivot of knots that no row determines, as a share of the largest one.
SMALLEST_PIVOT = 1e-10
# Two corners are no closer than this share of the smallest distance of two rows.
SMALLEST_GAP_SHARE = 1e-3
# Removing corners continues through polylines that are worse than the best one by the cost of so many corners.
CORNERS_TOO_FEW = 3.0
# Segments by dynamic programming leave few superfluous corners, unless the column is no polyline.
MOST_REMOVALS = 20
# Logarithm of the prior odds, doubled, against a further corner: one in five.
ODDS_AGAINST_CORNER = 3.0


def penalty_of_corner(rows: int) -> float:
    """What a further corner costs: two parameters (Schwarz 1978) and the odds against it."""
    return 2.0 * float(np.log(rows)) + ODDS_AGAINST_CORNER


def corners_by_segments(time_s: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Criterion and corners by the best division of the rows into straight segments (dynamic programming).

    The lines of neighbouring segments are independent here, so that the search is exact. A corner is where they intersect; if
    that is not between the two segments, the boundary becomes two corners, of which :func:`prune` removes one.
    """
    k = len(y)
    edges = _possible_boundaries(time_s, y)
    t, y = (time_s - time_s.mean()) / np.ptp(time_s), y - y.mean()
    sums = np.vstack([np.zeros(5), np.cumsum(np.column_stack([t, y, t * t, t * y, y * y]), axis=0)])[edges]
    penalty = penalty_of_corner(k)
    cost, before = np.full(len(edges), np.inf), np.zeros(len(edges), dtype=np.int64)
    cost[0] = 0.0
    candidates = np.zeros(1, dtype=np.int64)
    for end in range(1, len(edges)):
        rss = _straight_rss((edges[end] - edges[candidates]).astype(float), sums[end] - sums[candidates])
        total = cost[candidates] + rss
        best = int(np.argmin(total))
        cost[end], before[end] = total[best] + penalty, candidates[best]
        # A start that is worse than a boundary here can never be the best one again (Killick et al. 2012).
        candidates = np.append(candidates[total <= cost[end]], end)
    bounds = [len(edges) - 1]
    while bounds[-1] > 0:
        bounds.append(int(before[bounds[-1]]))
    return float(cost[-1]), _intersections(time_s, y, edges[bounds[::-1]])


def _possible_boundaries(time_s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Numbers of rows before which a segment may begin, with the first and one behind the last row."""
    k = len(y)
    if k <= MOST_BOUNDARIES:
        return np.arange(k + 1)
    w = (time_s[1:-1] - time_s[:-2]) / (time_s[2:] - time_s[:-2])
    second = np.abs(y[1:-1] - (1.0 - w) * y[:-2] - w * y[2:]) / np.sqrt(1.0 + w**2 + (1.0 - w) ** 2)
    sharp = np.argsort(second)[::-1][: MOST_BOUNDARIES // 2]
    sharp = sharp[second[sharp] > BOUNDARY_SDS] + 1
    even = np.linspace(0, k, MOST_BOUNDARIES // 2 + 1).round().astype(np.int64)
    return np.unique(np.concatenate([even, sharp, sharp + 1]))


def _straight_rss(n: np.ndarray, sums: np.ndarray) -> np.ndarray:
    """Sum of squares (m,) about the line through n rows, given the sums (m, 5) of t, y, t², ty and y²."""
    st, sy, stt, sty, syy = sums.T
    ctt, cty, cyy = stt - st * st / n, sty - st * sy / n, syy - sy * sy / n
    slope = np.divide(cty, ctt, out=np.zeros_like(ctt), where=ctt > 1e-14 * stt)
    return np.where(n < 2.5, 0.0, np.maximum(cyy - slope * cty, 0.0))


def _intersections(time_s: np.ndarray, y: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Corners between segments of rows [bounds[i], bounds[i + 1])."""
    t = time_s - time_s[0]
    lines = [np.polyfit(t[a:b], y[a:b], 1) if b - a > 1 else np.array([0.0, y[a]]) for a, b in pairwise(bounds)]
    corners: list[float] = []
    for i, b in enumerate(bounds[1:-1]):
        (slope, offset), (slope_after, offset_after) = lines[i], lines[i + 1]
        turn = slope - slope_after
        meets = (offset_after - offset) / turn if turn != 0.0 else np.inf
        corners += [t[b - 1], t[b]]
        if t[bounds[i]] < meets < t[bounds[i + 2] - 1]:
            # The rows between the boundary and the intersection belong to the other line.
            moved = np.arange(*sorted((int(b), int(np.searchsorted(t, meets)))))
            change = (np.polyval(lines[i], t[moved]) - y[moved]) ** 2 - (np.polyval(lines[i + 1], t[moved]) - y[moved]) ** 2
            if abs(float(change.sum())) < penalty_of_corner(len(y)):
                corners[-2:] = [float(meets)]
    inner = time_s[0] + np.unique(corners)
    return inner[(inner > time_s[0]) & (inner < time_s[-1])]


def _shares(time_s: np.ndarray, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Segment of each row (k,), and the share (k,) of the knot at its end."""
    segments = np.minimum(np.searchsorted(knots, time_s, side="right"), len(knots) - 1) - 1
    return segments, (time_s - knots[segments]) / (knots[segments + 1] - knots[segments])


def fit_values(time_s: np.ndarray, y: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Knots (m,), their values (m,) by least squares, and the fitted rows (k,)."""
    knots = np.concatenate([time_s[:1], corners, time_s[-1:]])
    segments, w = _shares(time_s, knots)
    count = len(knots) - 1
    band, right = np.zeros((2, count + 1)), np.zeros(count + 1)
    band[1, :-1] = np.bincount(segments, (1.0 - w) ** 2, count)
    band[1, 1:] += np.bincount(segments, w**2, count)
    band[1] += SMALLEST_PIVOT * band[1].max()
    band[0, 1:] = np.bincount(segments, w * (1.0 - w), count)
    right[:-1] = np.bincount(segments, (1.0 - w) * y, count)
    right[1:] += np.bincount(segments, w * y, count)
    values = solveh_banded(band, right, check_finite=False)
    return knots, values, (1.0 - w) * values[segments] + w * values[segments + 1]


def tangent_basis(time_s: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Orthonormal basis (k, q) of the changes of the rows by the values of the knots and the times of the corners.

    To first order each segment changes on its own, by an offset and a slope, and the corners follow as intersections.
    """
    segments, _ = _shares(time_s, knots)
    columns = []
    for segment in np.unique(segments):
        inside = segments == segment
        column = inside / np.sqrt(inside.sum())
        columns.append(column)
        slope = np.where(inside, time_s - time_s[inside].mean(), 0.0)
        if inside.sum() > 1:
            columns.append(slope / np.linalg.norm(slope))
    return np.column_stack(columns)


def _derivatives(time_s: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Derivatives (k, 2 m - 2) of the rows by the values of the knots and by the times of the corners."""
    segments, w = _shares(time_s, knots)
    rows, hats = np.arange(len(time_s)), np.zeros((len(time_s), len(knots)))
    hats[rows, segments], hats[rows, segments + 1] = 1.0 - w, w
    slope = (np.diff(values) / np.diff(knots))[segments]
    return np.hstack([hats, -slope[:, None] * hats[:, 1:-1]])


def _step(time_s: np.ndarray, residual: np.ndarray, knots: np.ndarray, values: np.ndarray, damping: float) -> np.ndarray:
    """Damped Gauss-Newton step of the times of the corners (m - 2,).

    A row depends on the values and times of the two knots of its segment, so that the normal equations are banded.
    """
    segments, w = _shares(time_s, knots)
    count = len(knots) - 1
    by_left, by_right = np.tile(-np.diff(values) / np.diff(knots), (2, 1))
    by_left[0] = by_right[-1] = 0.0  # The first and the last time are given.
    aa, ab, bb = (np.bincount(segments, product, count) for product in ((1.0 - w) ** 2, (1.0 - w) * w, w**2))
    # Derivatives of a row by the value and the time of the knot before it, and of the knot behind it: these factors times its
    # shares 1 - w and w.
    factors, moments = (np.ones(count), by_left, np.ones(count), by_right), (aa, aa, bb, bb)
    band, right_hand = np.zeros((4, 2 * count + 2)), np.zeros(2 * count + 2)
    for p in range(4):
        for q in range(p, 4):
            moment = moments[p] if p // 2 == q // 2 else ab
            band[3 - (q - p), q : q + 2 * count : 2] += factors[p] * factors[q] * moment
        first = np.bincount(segments, (w if p > 1 else 1.0 - w) * residual, count)
        right_hand[p : p + 2 * count : 2] += factors[p] * first
    band[3] = np.where(band[3] > 0.0, (1.0 + damping) * band[3], 1.0)
    return solveh_banded(band, right_hand, check_finite=False)[3:-2:2]


def refine(time_s: np.ndarray, y: np.ndarray, corners: np.ndarray) -> tuple[float, np.ndarray]:
    """chi2 and corners of the nearest least-squares polyline (Levenberg 1944, Marquardt 1963; values eliminated)."""
    gap = SMALLEST_GAP_SHARE * float(np.diff(time_s).min())
    corners = corners[np.diff(corners, prepend=time_s[0]) > gap]
    corners = corners[time_s[-1] - corners > gap]
    knots, values, fitted = fit_values(time_s, y, corners)
    chi2, damping = float(((y - fitted) ** 2).sum()), 1e-3
    for _ in range(MOST_STEPS_OF_CORNERS if len(corners) else 0):
        step = _step(time_s, y - fitted, knots, values, damping)
        # A corner moves at most half of the way to its neighbours, so that none change places.
        room = np.maximum(np.diff(knots) / 2.0, gap)
        trial = knots.copy()
        trial[1:-1] += np.minimum(np.maximum(step, gap - room[:-1]), room[1:] - gap)
        _, new_values, new_fitted = fit_values(time_s, y, trial[1:-1])
        new_chi2 = float(((y - new_fitted) ** 2).sum())
        if not new_chi2 <= chi2:
            damping *= 10.0
            if damping > LARGEST_POLYLINE_DAMPING:
                break
            continue
        decrease, chi2 = chi2 - new_chi2, new_chi2
        knots, values, fitted, damping = trial, new_values, new_fitted, max(damping / 10.0, SMALLEST_DAMPING)
        if decrease < SMALLEST_DECREASE:
            break
    return chi2, knots[1:-1]


def prune(time_s: np.ndarray, y: np.ndarray, current: tuple[float, np.ndarray]) -> tuple[float, np.ndarray]:
    """Remove corners, one or two neighbours at a time, and return the polyline of the smallest criterion on the way."""
    penalty = penalty_of_corner(len(y))

    def criterion(polyline: tuple[float, np.ndarray]) -> float:
        return polyline[0] + penalty * len(polyline[1])

    best = current
    for _ in range(MOST_REMOVALS):
        if not len(current[1]) or criterion(current) >= criterion(best) + CORNERS_TOO_FEW * penalty:
            break
        corners = current[1]
        least, most = _increases(time_s, y, corners)
        if least.min() >= 2.0 * penalty:  # No pair is worth less either.
            break
        trials = [np.delete(corners, int(np.argmin(most))), *_with_fewer(time_s, y, corners, int(np.argmin(least)))]
        current = min((refine(time_s, y, trial) for trial in trials), key=criterion)
        best = min(best, current, key=criterion)
    return best


def _with_fewer(time_s: np.ndarray, y: np.ndarray, corners: np.ndarray, i: int) -> list[np.ndarray]:
    """The corners without corner i, and without it and a neighbour or with one where the lines outside of the two intersect."""
    knots, values, _ = fit_values(time_s, y, corners)
    slopes = np.diff(values) / np.diff(knots)
    trials = [np.delete(corners, i)]
    for first in (i - 1, i):
        if first < 0 or first + 1 >= len(corners):
            continue
        trials.append(np.delete(corners, [first, first + 1]))
        before, after = slopes[first], slopes[first + 2]
        turn = before - after
        meets = (values[first + 2] - after * knots[first + 2] - values[first + 1] + before * knots[first + 1]) / (turn or 1.0)
        if turn != 0.0 and knots[first] < meets < knots[first + 3]:
            trials.append(np.concatenate([corners[:first], [meets], corners[first + 2 :]]))
    return trials


def _increases(time_s: np.ndarray, y: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linearised increases of chi2 (m,) if each corner is removed: with the times of the others free, and with them fixed."""
    knots, values, _ = fit_values(time_s, y, corners)
    n, inverse = len(knots), 1.0 / np.diff(knots)
    turn = np.zeros((n - 2, n))
    i = np.arange(n - 2)
    turn[i, i], turn[i, i + 1], turn[i, i + 2] = inverse[:-1], -inverse[:-1] - inverse[1:], inverse[1:]
    square = (turn @ values) ** 2
    J = _derivatives(time_s, knots, values)
    scale = np.maximum(np.linalg.norm(J, axis=0), 1e-12)
    # A time of which the rows say nothing, such as that of a corner without a turn, does not count.
    gram = (J / scale).T @ (J / scale) + 1e-8 * np.eye(J.shape[1])
    wide = np.hstack([turn, np.zeros((n - 2, n - 2))]) / scale
    fixed = turn / scale[:n]
    variance_free = np.einsum("ij,ji->i", wide, np.linalg.solve(gram, wide.T))
    variance_fixed = np.einsum("ij,ji->i", fixed, np.linalg.solve(gram[:n, :n], fixed.T))
    return square / variance_free, square / variance_fixed
