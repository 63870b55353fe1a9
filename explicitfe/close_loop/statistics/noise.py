"""What a measured curve scatters without any physics: noise of its rows, their correlation, scatter between repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from explicitfe.close_loop.statistics.system import Series

DEGREE = 5  # of the polynomial between two bends
ROWS_A_TERM = 4  # so many rows carry one coefficient
# The median of |z| where z is standard normal.
MEDIAN_OF_ABSOLUTE_NORMAL = 0.6745
DOUBTED = 1.6  # a stated noise is believed until rows differ by so many times what it allows
HIGHEST = 0.98  # correlation of neighbouring rows
CORRELATIONS = tuple(float(r) for r in np.linspace(0.0, 0.96, 49))
AS_LIKELY = 1.0  # of -2 log likelihood
ORDERS = (2, 3, 4)  # of differences: what is left of a curve's own bend falls with the order, noise does not
TRIED = 150  # sizes of a scatter, 5 % apart
TREND_FROM = 3  # repeats, of which a trend can be told from scatter
SMALLEST = 1e-6  # of the largest value: below, a column is without noise


@dataclass(frozen=True)
class RowNoise:
    """Noise of the rows of one series.

    Attributes
    ----------
    sd : (k,) standard deviation of each row, SI.
    correlation : of neighbouring rows.
    stated : whether the dataset says the sd, and it was believed.
    """

    sd: np.ndarray
    correlation: float
    stated: bool

    @property
    def weight_sd(self) -> np.ndarray:
        """(k,) sd of independent rows that would say as much about anything smooth: sd^2 times the sum of the correlations.

        Rows whitened by their correlation would count differences of neighbours, and a model that is wrong would be fitted to
        its slopes.
        """
        return self.sd * np.sqrt((1.0 + self.correlation) / (1.0 - self.correlation))

    @property
    def effective(self) -> float:
        """How many independent rows say as much about a mean."""
        return len(self.sd) * (1.0 - self.correlation) / (1.0 + self.correlation)


@dataclass(frozen=True)
class Scatter:
    """Differences between nominally equal tests.

    Attributes
    ----------
    scale : sd of the relative size of a curve; ``offset`` : sd of a constant, in units of the curve's largest value.
    source : "stated", "repeats" or "unknown".
    repeats : how many differences it rests on.
    """

    scale: float
    offset: float
    source: str
    repeats: int


def smooth_basis(series: Series, degree: int = DEGREE) -> np.ndarray:
    """Functions (k, m) that any smooth curve is made of: polynomials between the bends of the programme, orthonormal.

    Where nothing moves, time runs logarithmically.
    """
    columns = []
    rows = np.arange(len(series.measured))
    for first, last in zip(series.bends[:-1], series.bends[1:], strict=True):
        inside = rows[(rows >= first) & ((rows < last) | (last == rows[-1]))]
        if not len(inside):
            continue
        t = series.time_s[inside] - series.time_s[inside[0]]
        if series.phase[inside[len(inside) // 2]] == "hold" and len(inside) > 2:
            t = np.log1p(t / max(t[1], 1e-3 * t[-1]))
        x = 2.0 * t / t[-1] - 1.0 if t[-1] > 0.0 else t
        count = int(np.clip(len(inside) // ROWS_A_TERM, 0, degree))
        for column in np.polynomial.legendre.legvander(x, count).T:
            whole = np.zeros(len(rows))
            whole[inside] = column
            columns.append(whole)
    basis, triangle = np.linalg.qr(np.array(columns).T)
    return basis[:, np.abs(np.diag(triangle)) > 1e-8]


def row_noise(series: Sequence[Series]) -> list[RowNoise]:
    """Noise of each series.

    A stated sd is that of a row by itself. How much neighbouring rows differ then says how they are correlated: second
    differences of AR(1) noise have the variance 2 (1 - r) (3 - r) sd^2. They are taken from what a smooth curve leaves, by the
    median, so that a kink does not count, and no larger than third and fourth ones would make them, so that a bend does not.
    Where no sd is stated, both are those of what a smooth curve leaves, by restricted maximum likelihood. All series share one
    correlation: they come from one machine.
    """
    rough, weights = [], []
    for one in series:
        rest = _rest(one)
        sizes = [np.median(np.abs(np.diff(rest, k))) / np.sqrt(comb(2 * k, k)) for k in ORDERS if len(rest) > k]
        rough.append(float(np.sqrt(6.0) * min(sizes) / MEDIAN_OF_ABSOLUTE_NORMAL))
        weights.append(max(len(rest) - 2, 1))
    stated = [np.hypot(one.noise_sd or 0.0, float(np.sqrt(np.mean(one.imposed_sd**2)))) for one in series]
    known = [
        one.noise_sd is not None and sd > SMALLEST * np.abs(one.measured).max() for one, sd in zip(series, stated, strict=True)
    ]
    ratios = [
        (rough[k] / stated[k]) ** 2 for k in range(len(series)) if known[k] and rough[k] <= DOUBTED * np.sqrt(6.0) * stated[k]
    ]
    parts = [weights[k] for k in range(len(series)) if known[k] and rough[k] <= DOUBTED * np.sqrt(6.0) * stated[k]]
    shared = _correlation(float(np.average(ratios, weights=parts))) if ratios else None
    unknown = [k for k in range(len(series)) if not known[k]]
    estimated = _likely([series[k] for k in unknown], shared) if unknown else ([], 0.0)
    found = []
    for k, one in enumerate(series):
        floor = SMALLEST * float(np.abs(one.measured).max())
        if not known[k]:
            sd = max(estimated[0][unknown.index(k)], floor)
            found.append(RowNoise(np.full(len(one.measured), sd), estimated[1], False))
        elif rough[k] <= DOUBTED * np.sqrt(6.0) * stated[k]:
            each = np.hypot(one.noise_sd or 0.0, one.imposed_sd)
            found.append(RowNoise(np.maximum(each, max(floor, 0.1 * stated[k])), shared or 0.0, True))
        else:  # rows differ by more than the dataset says
            found.append(RowNoise(np.full(len(one.measured), rough[k] / np.sqrt(6.0)), 0.0, False))
    return found


def _rest(series: Series) -> np.ndarray:
    basis = smooth_basis(series)
    return series.measured - basis @ (basis.T @ series.measured)


def _correlation(ratio: float) -> float:
    """r of 2 (1 - r) (3 - r) = ratio, between 0 and the highest."""
    return float(np.clip(2.0 - np.sqrt(1.0 + 0.5 * max(ratio, 0.0)), 0.0, HIGHEST))


def _likely(series: Sequence[Series], shared: float | None) -> tuple[list[float], float]:
    """The sd of each series, and the correlation they share, by restricted maximum likelihood."""
    bases = [smooth_basis(one) for one in series]

    def terms(r: float) -> tuple[float, list[float]]:
        total, sds = 0.0, []
        for one, basis in zip(series, bases, strict=True):
            y, X = whitened_rows(one.measured, r), whitened_rows(basis, r)
            Q, R = np.linalg.qr(X)
            rest = y - Q @ (Q.T @ y)
            free = max(len(y) - X.shape[1], 1)
            variance = max(float(rest @ rest) / free, 1e-300)
            size = (len(y) - 1) * np.log(1.0 - r * r)  # log of the determinant of the rows' correlation
            total += free * np.log(variance) + size + 2.0 * float(np.log(np.abs(np.diag(R))).sum())
            sds.append(float(np.sqrt(variance)))
        return total, sds

    if shared is None:
        # The highest that is about as likely as the best: noise that is taken for white is taken for physics.
        tried = [terms(r)[0] for r in CORRELATIONS]
        shared = max(r for r, value in zip(CORRELATIONS, tried, strict=True) if value <= min(tried) + AS_LIKELY)
    return terms(shared)[1], shared


def whitened_rows(columns: np.ndarray, correlation: float) -> np.ndarray:
    """Columns (k, ...) of unit-variance AR(1) rows made independent, of unit variance."""
    if correlation == 0.0:
        return columns.copy()
    out = columns.copy()
    out[1:] = (columns[1:] - correlation * columns[:-1]) / np.sqrt(1.0 - correlation**2)
    return out


def scatter(series: Sequence[Series], rows: Sequence[RowNoise]) -> Scatter:
    """Scatter between nominally equal tests: as stated, or from the repeats there are.

    Each repeat is a scale and an offset of their mean, known as well as the noise of its rows allows; the variances of both come
    from restricted maximum likelihood. From few repeats they are taken with caution: the largest that are about as likely as
    the best.
    """
    stated = [one.scatter for one in series if one.scatter is not None]
    sets: dict[str, list[int]] = {}
    for number, one in enumerate(series):
        if one.peers:
            sets.setdefault(one.peers, []).append(number)
    found = []
    for numbers in sets.values():
        peers = [series[k] for k in numbers]
        if len({one.test for one in peers}) < 2:
            continue
        pairs, noise = _compared(peers, [rows[k] for k in numbers])
        order = np.array([one.trend for one in peers])
        regular = np.ones((len(peers), 1))
        # One specimen, again and again: a trend is a drift and not scatter.
        if len(peers) >= TREND_FROM and len(set(order)) == len(order) and len({one.specimen for one in peers}) == 1:
            regular = np.column_stack([regular, order])
        rest = pairs - regular @ np.linalg.lstsq(regular, pairs, rcond=None)[0]
        found.append((len(peers) - regular.shape[1], rest.T @ rest, noise))
    free = sum(entry[0] for entry in found)
    if not free:
        return Scatter(max(stated), 0.0, "stated", 0) if stated else Scatter(0.0, 0.0, "unknown", 0)
    scale, offset = _variances(found)
    if stated:
        return Scatter(max(stated), min(offset, max(stated)), "stated", free)
    return Scatter(scale, offset, "repeats", free)


def _variances(sets: Sequence[tuple[int, np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Largest likely sd of scale and of offset, from (degrees of freedom, sums of squares (2, 2), noise (2, 2)) of each set."""
    squares = sum(np.diag(entry[1]) for entry in sets)
    tried = [np.concatenate([[0.0], np.sqrt(total) * np.geomspace(1e-2, 10.0, TRIED)]) for total in squares]
    s, o = np.meshgrid(*tried, indexing="ij")
    value = np.zeros(s.shape)  # -2 log likelihood
    for count, square, noise in sets:
        a, b, c = s**2 + noise[0, 0], o**2 + noise[1, 1], noise[0, 1]
        determinant = np.maximum(a * b - c * c, 1e-300)
        value += count * np.log(determinant)
        value += (b * square[0, 0] - 2.0 * c * square[0, 1] + a * square[1, 1]) / determinant
    likely = value <= value.min() + AS_LIKELY
    return float(s[likely].max()), float(o[likely].max())


def _compared(peers: Sequence[Series], rows: Sequence[RowNoise]) -> tuple[np.ndarray, np.ndarray]:
    """Size of each curve relative to their mean and its shift in units of the largest value, (k, 2); covariance (2, 2) of their
    noise."""
    end = min(one.time_s[-1] for one in peers)
    grid = np.unique(np.concatenate([one.time_s[one.time_s <= end] for one in peers]))
    values = np.array([np.interp(grid, one.time_s, one.measured) for one in peers])
    mean = values.mean(axis=0)
    top = float(np.abs(mean).max())
    design = np.column_stack([mean, np.full(len(grid), top)])
    pairs = np.linalg.lstsq(design, values.T, rcond=None)[0].T
    information = np.zeros((2, 2))
    for one, row in zip(peers, rows, strict=True):
        here = one.time_s <= end
        own = np.column_stack([np.interp(one.time_s[here], grid, mean), np.full(int(here.sum()), top)])
        own /= row.weight_sd[here, None]
        information += own.T @ own / len(peers)
    return pairs, np.linalg.pinv(information)
