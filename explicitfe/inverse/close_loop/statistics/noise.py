"""How much measured curves scatter without any physics: noise of rows, its correlation, scatter between repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import Literal

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from explicitfe.inverse.close_loop.statistics.system import Series
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS

# Physics is smooth between the bends of a protocol: polynomials of this degree, with at least so many rows for each coefficient.
SMOOTH_DEGREE, SMOOTH_ROWS_PER_TERM = 5, 4
# A short piece bends too: at least this degree, as far as its rows allow.
LEAST_DEGREE = 2
# -2 log likelihood of one standard deviation: of all correlations and scatters this near to the best the largest is taken.
LIKELIHOOD_MARGIN = 1.0
# A trend has two numbers, so only a third repeat of one specimen distinguishes it from scatter.
TREND_REPEATS = 3
# Few repeats know their scatter badly; it is taken so large that equal tests differ significantly as often as this p-value says.
CAUTIOUS_P = 0.01
ScatterSource = Literal["stated", "repeats", "unknown"]

# The median of |z| where z is standard normal.
MEDIAN_OF_ABSOLUTE_NORMAL = 0.6745
# Neighbouring rows are no more correlated than this: beyond it a curve would hardly have two independent rows.
HIGHEST_CORRELATION = 0.98
TRIED_CORRELATIONS = tuple(float(r) for r in np.linspace(0.0, 0.96, 49))
# Differences of these orders show noise: what a curve's own bend adds to them falls with the order, and noise does not.
DIFFERENCE_ORDERS = (2, 3, 4)
# Rows this far apart show how noise of neighbours is correlated.
LONG_STRIDE = 3
# The variance of second differences of independent rows over that of a row.
SECOND_DIFFERENCE_VARIANCE = 6.0
# The standard error of the square of a median of absolute normal values, as a share of it, times the root of their number.
SQUARED_MEDIAN_ERROR = 2.33
# A series of which a smooth curve leaves a smaller share shows no noise; nor does a difference with less of its variance.
LEAST_FREE_SHARE = LEAST_VARIANCE_LEFT_SHARE = 0.1
# Sizes of a scatter that are tried, 5 % apart.
TRIED_SCATTERS = 190
# A column whose noise is a smaller share of its largest value counts as free of noise.
SMALLEST_NOISE_SHARE = 1e-6
# The noise of a row is no smaller than this share of the mean noise of its series, however little the imposed column adds to it.
SMALLEST_ROW_SHARE = 0.1


@dataclass(frozen=True)
class RowNoise:
    """Noise of the rows of one series.

    Attributes
    ----------
    sd : (k,) standard deviation of each row, SI.
    correlation : of the noise of neighbouring rows.
    stated : whether the dataset states the sd, and the rows are not rougher.
    """

    sd: np.ndarray
    correlation: float
    stated: bool

    @property
    def weight_sd(self) -> np.ndarray:
        """(k,) sd of independent rows that would say as much about anything smooth: its square is sd^2 times the sum of the
        correlations.

        If rows were whitened by their correlation, differences of neighbours would count, and a wrong model would be fitted to
        the slopes of the data.
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
    scale, offset : sd of the relative size of a curve, and of a constant as a share of the curve's largest value.
    source : where they are known from.
    repeats : the number of differences between repeats that they rest on.
    """

    scale: float
    offset: float
    source: ScatterSource
    repeats: int


def smooth_basis(series: Series, degree: int = SMOOTH_DEGREE) -> np.ndarray:
    """Orthonormal functions (k, m) of which smooth curves consist: polynomials between the bends of the programme.

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
        count = min(max(len(inside) // SMOOTH_ROWS_PER_TERM, LEAST_DEGREE), degree, max(len(inside) - 2, 0))
        for column in np.polynomial.legendre.legvander(x, count).T:
            whole = np.zeros(len(rows))
            whole[inside] = column
            columns.append(whole)
    basis, triangle = np.linalg.qr(np.array(columns).T)
    return basis[:, np.abs(np.diag(triangle)) > 1e-8]


def row_noise(series: Sequence[Series]) -> list[RowNoise]:
    """Noise of each series.

    A stated sd is that of a row by itself. How much neighbouring rows differ then says how they are correlated: second
    differences of AR(1) noise have the variance 2 (1 - r) (3 - r) sd^2. They are taken from what a smooth curve leaves. Their
    median is taken, so that a kink does not count, and the least over several orders of differences, so that a bend does not.
    Where no sd is stated, sd and correlation of what a smooth curve leaves are found by restricted maximum likelihood, or from
    the differences if these show less. All series share one correlation because they come from one machine.

    The correlation is looked for in the predicted column's own noise. That of the imposed column enters what a model answers to
    that column, and not the measured rows, which would look too smooth beside the sum of both, that is correlated.
    """
    sizes = [_roughness(one) for one in series]
    rough = [float(np.sqrt(SECOND_DIFFERENCE_VARIANCE) * min(one.values(), default=0.0)) for one in sizes]
    stated = [np.hypot(one.noise_sd or 0.0, float(np.sqrt(np.mean(one.imposed_sd**2)))) for one in series]
    known = [
        one.noise_sd is not None and sd > SMALLEST_NOISE_SHARE * np.abs(one.measured).max()
        for one, sd in zip(series, stated, strict=True)
    ]
    # Few rows show their roughness badly: the statement is contradicted only beyond two standard errors of the median.
    errors = [SQUARED_MEDIAN_ERROR / np.sqrt(max(_free(one), 1)) for one in series]
    most = [
        THRESHOLDS.stated_noise_factor * (1.0 + error) * np.sqrt(SECOND_DIFFERENCE_VARIANCE) * sd
        for sd, error in zip(stated, errors, strict=True)
    ]
    believed = [k for k in range(len(series)) if known[k] and rough[k] <= most[k]]
    own = [({k: size / sd for k, size in sizes[n].items()}, _free(series[n])) for n in believed if (sd := series[n].noise_sd)]
    shared = _shared_correlation(own) if believed else None
    unknown = [k for k in range(len(series)) if not known[k]]
    estimated = _unstated([series[k] for k in unknown], shared) if unknown else ([], 0.0)
    noise = []
    for k, one in enumerate(series):
        floor = SMALLEST_NOISE_SHARE * float(np.abs(one.measured).max())
        if not known[k]:
            shown = estimated[0][unknown.index(k)] if _free(one) else THRESHOLDS.unknown_noise_share * np.abs(one.measured).max()
            sd = max(shown, floor)
            noise.append(RowNoise(np.full(len(one.measured), sd), estimated[1], False))
        elif k in believed:
            each = np.hypot(one.noise_sd or 0.0, one.imposed_sd)
            noise.append(RowNoise(np.maximum(each, max(floor, SMALLEST_ROW_SHARE * stated[k])), shared or 0.0, True))
        else:  # rows differ by more than the dataset says
            noise.append(RowNoise(np.full(len(one.measured), rough[k] / np.sqrt(SECOND_DIFFERENCE_VARIANCE)), 0.0, False))
    return noise


def row_noise_beside(series: Sequence[Series], rows: Sequence[RowNoise], answer: np.ndarray) -> list[RowNoise]:
    """Noise of each series beside what a model answers (n,) SI.

    Where a dataset states no noise, it is known from what smooth curves leave, and what bends where the programme does not, such
    as a tool that loses contact, counts as noise. A smooth curve through what the model leaves has fewer such bends. Both are
    bounds from above, so the smaller one is taken. Where the programme bends at every row, neither shows the noise.
    """
    ends = np.cumsum([len(one.measured) for one in series])[:-1]
    left = [replace(one, measured=one.measured - part) for one, part in zip(series, np.split(answer, ends), strict=True)]
    beside = []
    for one, before, after in zip(series, rows, row_noise(left), strict=True):
        least = SMALLEST_NOISE_SHARE * float(np.abs(one.measured).max())
        smaller = after.weight_sd.mean() < before.weight_sd.mean() and after.sd.min() > least
        beside.append(after if smaller and _free(one) and not before.stated else before)
    return beside


def _free(series: Series) -> int:
    """How many rows show noise beyond those that a smooth curve takes up: none of a programme that bends at every row."""
    free = len(series.measured) - smooth_basis(series).shape[1]
    return free if free > LEAST_FREE_SHARE * len(series.measured) else 0


def _roughness(series: Series, stride: int = 1) -> dict[int, float]:
    """Order -> the sd of independent rows of which a smooth curve would leave differences of that order with the same median.

    Parameters
    ----------
    stride : rows between those that are differenced.
    """
    sizes: dict[int, float] = {}
    if not _free(series):
        return sizes
    basis = smooth_basis(series)
    left = series.measured - basis @ (basis.T @ series.measured)
    for order in DIFFERENCE_ORDERS:
        every = comb(2 * order, order)
        variance = every - np.sum(_differences(basis, order, stride) ** 2, axis=1)  # for rows of unit variance
        kept = variance > LEAST_VARIANCE_LEFT_SHARE * every
        if kept.any():
            each = np.abs(_differences(left, order, stride)[kept]) / np.sqrt(variance[kept])
            sizes[order] = float(np.median(each)) / MEDIAN_OF_ABSOLUTE_NORMAL
    return sizes


def _differences(columns: np.ndarray, order: int, stride: int) -> np.ndarray:
    """Differences (m, ...) of an order of rows (k, ...) that are some rows apart."""
    for _ in range(order):
        columns = columns[stride:] - columns[:-stride]
    return columns


def _shared_correlation(rows: Sequence[tuple[dict[int, float], int]]) -> float:
    """The correlation of neighbouring rows.

    Second differences know it best. A bend makes them too large, and the correlation too small, so that of a higher order is
    taken where it exceeds theirs by two standard errors. A correlation within one standard error of none is none: half of the
    independent series would have one otherwise.

    Parameters
    ----------
    rows : of each series the roughness over the sd that is stated, by the order of differences, and how many rows show it.
    """
    by_order = {}
    for order in DIFFERENCE_ORDERS:
        sizes = [(by[order], number) for by, number in rows if order in by]
        if sizes:
            variance = sum(size**2 * number for size, number in sizes) / sum(number for _, number in sizes)
            by_order[order] = _correlation(variance, order)
    if not by_order:
        return 0.0
    second = by_order[min(by_order)]
    # The error of a median, by the slope of 2 (1 - r) (3 - r).
    count = sum(number for by, number in rows if by)
    error = SQUARED_MEDIAN_ERROR / np.sqrt(count) * (1.0 - second) * (3.0 - second) / (4.0 - 2.0 * second)
    highest = max(by_order.values())
    likely = highest if highest > second + 2.0 * error else second
    return float(likely) if likely > error else 0.0


def _correlation(variance: float, order: int) -> float:
    """The correlation of AR(1) rows of unit variance, between 0 and the highest, from the variance of their differences.

    Parameters
    ----------
    variance : as a multiple of that of independent rows.
    order : of the differences.
    """

    def excess(r: float) -> float:
        return _variance(r, order) - variance

    if excess(0.0) <= 0.0:
        return 0.0
    return HIGHEST_CORRELATION if excess(HIGHEST_CORRELATION) >= 0.0 else float(brentq(excess, 0.0, HIGHEST_CORRELATION))


def _unstated(series: Sequence[Series], shared: float | None) -> tuple[list[float], float]:
    """The sd of each series and their correlation where nothing is stated: the smaller of two bounds from above.

    One is that of :func:`_likely`, in which a bend that the programme does not have counts as correlated noise. The other is
    that of the medians of second differences, which a bend does not change: of the correlations with which differences of
    neighbours and of every third row agree within two standard errors the highest is taken, and the sd that belongs to it.
    """
    likely, correlation = _likely(series, shared)
    sizes = [[_roughness(one, stride).get(2, 0.0) for stride in (1, LONG_STRIDE)] for one in series]
    if shared is not None or min(map(min, sizes)) == 0.0:
        return likely, correlation
    counts = np.array([_free(one) for one in series], dtype=float)
    ratio = np.average([np.log(far / near) for near, far in sizes], weights=counts)
    error = np.sqrt(2.0) * 0.5 * SQUARED_MEDIAN_ERROR / np.sqrt(counts.sum())
    variances = {r: (_variance(r, 2), _variance(r**LONG_STRIDE, 2)) for r in TRIED_CORRELATIONS}
    agreeing = [r for r, (near, far) in variances.items() if 0.5 * np.log(far / near) <= ratio + 2.0 * error]
    highest = max(agreeing, default=0.0)
    shown = [near / np.sqrt(variances[highest][0]) for near, _ in sizes]

    def weight(sds: Sequence[float], r: float) -> float:
        return float(np.sum(np.square(sds)) * (1.0 + r) / (1.0 - r))

    return (shown, highest) if weight(shown, highest) < weight(likely, correlation) else (likely, correlation)


def _variance(r: float, order: int) -> float:
    """The variance of differences of AR(1) rows over that of differences of independent rows."""
    lags = np.arange(-order, order + 1)
    weights = np.array([(-1.0) ** k * comb(2 * order, order + k) for k in lags]) / comb(2 * order, order)
    return float(weights @ r ** np.abs(lags))


def _likely(series: Sequence[Series], shared: float | None) -> tuple[list[float], float]:
    """The sd of each series, and the correlation they share, by restricted maximum likelihood."""
    bases = [smooth_basis(one) for one in series]

    def terms(r: float) -> tuple[float, list[float]]:
        total, sds = 0.0, []
        for one, basis in zip(series, bases, strict=True):
            y, X = whiten_rows(one.measured, r), whiten_rows(basis, r)
            Q, R = np.linalg.qr(X)
            left = y - Q @ (Q.T @ y)
            free = max(len(y) - X.shape[1], 1)
            variance = max(float(left @ left) / free, 1e-300)
            size = (len(y) - 1) * np.log(1.0 - r * r)  # log of the determinant of the rows' correlation
            total += free * np.log(variance) + size + 2.0 * float(np.log(np.abs(np.diag(R))).sum())
            sds.append(float(np.sqrt(variance)))
        return total, sds

    if shared is None:
        # Of the correlations about as likely as the best the highest is taken: if correlated noise is taken for white, a part of
        # it is taken for physics.
        tried = [terms(r)[0] for r in TRIED_CORRELATIONS]
        likely = min(tried) + LIKELIHOOD_MARGIN
        shared = max(r for r, value in zip(TRIED_CORRELATIONS, tried, strict=True) if value <= likely)
    return terms(shared)[1], shared


def whiten_rows(columns: np.ndarray, correlation: float) -> np.ndarray:
    """Columns (k, ...) in which AR(1) noise of unit variance has become independent, of unit variance."""
    if correlation == 0.0:
        return columns.copy()
    out = columns.copy()
    out[1:] = (columns[1:] - correlation * columns[:-1]) / np.sqrt(1.0 - correlation**2)
    return out


def scatter(series: Sequence[Series], rows: Sequence[RowNoise]) -> Scatter:
    """Scatter between nominally equal tests: as stated, or from repeats.

    Each repeat is a scale and an offset of their mean, known as well as the noise of its rows allows. The variances of both come
    from restricted maximum likelihood. Few repeats leave much room; the largest variances about as likely as the best are taken.
    """
    stated = [one.scatter for one in series if one.scatter is not None]
    sets: dict[str, list[int]] = {}
    for number, one in enumerate(series):
        if one.peers:
            sets.setdefault(one.peers, []).append(number)
    repeats = []
    for numbers in sets.values():
        peers = [series[k] for k in numbers]
        if len({one.test for one in peers}) < 2:
            continue
        pairs, noise = _scales_and_offsets(peers, [rows[k] for k in numbers])
        order = np.array([one.trend for one in peers])
        regular = np.ones((len(peers), 1))
        # Where one specimen is tested again and again, a trend is a drift and not scatter.
        enough = len(peers) >= TREND_REPEATS
        if enough and len(set(order)) == len(order) and len({one.specimen for one in peers}) == 1:
            regular = np.column_stack([regular, order])
        irregular = pairs - regular @ np.linalg.lstsq(regular, pairs, rcond=None)[0]
        repeats.append((len(peers) - regular.shape[1], irregular.T @ irregular, noise))
    free = sum(entry[0] for entry in repeats)
    if not free:
        return Scatter(max(stated), 0.0, "stated", 0) if stated else Scatter(0.0, 0.0, "unknown", 0)
    scale, offset = _likely_scatter(repeats)
    if stated:
        return Scatter(max(stated), min(offset, max(stated)), "stated", free)
    return Scatter(scale, offset, "repeats", free)


def _likely_scatter(sets: Sequence[tuple[int, np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Largest likely sd of scale and of offset, from (degrees of freedom, sums of squares (2, 2), noise (2, 2)) of each set."""
    squares = np.zeros(2) + sum(np.diag(entry[1]) for entry in sets)
    tried = [np.concatenate([[0.0], np.sqrt(total) * np.geomspace(1e-2, 100.0, TRIED_SCATTERS)]) for total in squares]
    s, o = np.meshgrid(*tried, indexing="ij")
    value = np.zeros(s.shape)  # -2 log likelihood
    for count, square, noise in sets:
        a, b, c = s**2 + noise[0, 0], o**2 + noise[1, 1], noise[0, 1]
        determinant = np.maximum(a * b - c * c, 1e-300)
        value += count * np.log(determinant)
        value += (b * square[0, 0] - 2.0 * c * square[0, 1] + a * square[1, 1]) / determinant
    likely = value <= value.min() + LIKELIHOOD_MARGIN
    weights = np.exp(-0.5 * (value - value.min()))
    known = np.mean([np.diag(entry[2]) for entry in sets], axis=0)
    scale = max(s[likely].max(), _cautious(tried[0], weights.sum(axis=1), float(known[0])))
    offset = max(o[likely].max(), _cautious(tried[1], weights.sum(axis=0), float(known[1])))
    return float(scale), float(offset)


def _cautious(sizes: np.ndarray, weights: np.ndarray, noise: float) -> float:
    """The sd with which a difference is as seldom significant as with all that the sd may be, each by its weight.

    Two or three repeats know their scatter badly. If the likeliest were taken for known, differences between further tests would
    be significant far too often, as normal numbers over an estimated sd are: they are Student's (1908), and so is this with sizes
    that are even on a logarithmic scale.

    Parameters
    ----------
    noise : the variance that the noise of the rows adds to a difference.
    """
    total = np.sqrt(sizes**2 + noise)
    shares = weights / weights.sum()
    top = -float(norm.ppf(0.5 * CAUTIOUS_P))

    def excess(q: float) -> float:
        return float(shares @ (2.0 * norm.sf(q / np.maximum(total, 1e-300)))) - CAUTIOUS_P

    q = brentq(excess, 0.0, 2.0 * top * float(total.max()))
    return float(np.sqrt(max((q / top) ** 2 - noise, 0.0)))


def _scales_and_offsets(peers: Sequence[Series], rows: Sequence[RowNoise]) -> tuple[np.ndarray, np.ndarray]:
    """Nominally equal curves against their mean.

    Returns
    -------
    (k, 2), the size of each curve relative to their mean and its shift as a share of the largest value; (2, 2), the covariance
    of the noise in both.
    """
    end = min(one.time_s[-1] for one in peers)
    grid = np.unique(np.concatenate([one.time_s[one.time_s <= end] for one in peers]))
    values = np.array([np.interp(grid, one.time_s, one.measured) for one in peers])
    mean = values.mean(axis=0)
    top = float(np.abs(mean).max())
    design = np.column_stack([mean, np.full(len(grid), top)])
    pairs = np.linalg.lstsq(design, values.T, rcond=None)[0].T
    information = np.zeros((2, 2))
    for one, row in zip(peers, rows, strict=True):
        common = one.time_s <= end
        own = np.column_stack([np.interp(one.time_s[common], grid, mean), np.full(int(common.sum()), top)])
        own /= row.weight_sd[common, None]
        information += own.T @ own / len(peers)
    return pairs, np.linalg.pinv(information)
