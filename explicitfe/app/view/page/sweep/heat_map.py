"""A measure of a sweep over two factors: the mean of the runs at each pair of values, as a table whose cells have colours."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from explicitfe.results.documents.sweep_to_draw import SweepColumn, SweepToDraw

# A factor with more values than this is no grid to read.
MOST_VALUES_OF_A_FACTOR = 24
# Light enough for dark letters everywhere, dark enough to tell apart: ends of the scale, as shares of the colour of the page.
FAINTEST_PERCENT, STRONGEST_PERCENT = 6.0, 50.0
DIGITS_OF_THE_RANGE = 3


@dataclass(frozen=True, eq=False)
class HeatMap:
    """A measure over two factors.

    Attributes
    ----------
    measure, across, up : the measure, and the factors along the columns and the rows.
    columns, rows : (c,), (r,) values of the factors, from low to high; indices of the levels of one with texts.
    mean : (r, c) of the measure; NaN where no run finished.
    """

    measure: SweepColumn
    across: SweepColumn
    up: SweepColumn
    columns: np.ndarray
    rows: np.ndarray
    mean: np.ndarray

    @property
    def column_words(self) -> list[str]:
        """The values of the first factor."""
        return _words(self.across, self.columns)

    @property
    def table(self) -> list[tuple[str, list[tuple[str, str]]]]:
        """Rows from high to low: the value of the second factor, and the number and strength of colour of each cell.

        A strength is a share in %. Numbers have three digits of their range.
        """
        low, high = np.nanmin(self.mean), np.nanmax(self.mean)
        span = float(high - low) or 1.0
        decimals = max(0, DIGITS_OF_THE_RANGE - 1 - math.floor(math.log10(span)))
        strength = np.nan_to_num(FAINTEST_PERCENT + (STRONGEST_PERCENT - FAINTEST_PERCENT) * (self.mean - low) / span)
        cells = [
            [(f"{value:.{decimals}f}" if np.isfinite(value) else "", f"{share:.0f}") for value, share in pairs]
            for pairs in np.stack([self.mean, strength], axis=-1).tolist()
        ]
        return list(zip(_words(self.up, self.rows), cells, strict=True))[::-1]


def heat_maps(sweep: SweepToDraw) -> Iterator[HeatMap]:
    """Heat maps of the main measures; none unless exactly two factors vary, each with a few values."""
    if len(sweep.factors) != 2:
        return
    across, up = sweep.factors
    (columns, column), (rows, row) = (np.unique(factor.values, return_inverse=True) for factor in (across, up))
    if not (2 <= len(columns) <= MOST_VALUES_OF_A_FACTOR and 2 <= len(rows) <= MOST_VALUES_OF_A_FACTOR):
        return
    for measure in sweep.shown_measures:
        usable = np.isfinite(measure.values)
        cell = row[usable] * len(columns) + column[usable]
        runs, sums = (np.bincount(cell, weights, len(rows) * len(columns)) for weights in (None, measure.values[usable]))
        mean = np.divide(sums, runs, out=np.full(len(sums), np.nan), where=runs > 0).reshape(len(rows), len(columns))
        if np.isfinite(mean).any():
            yield HeatMap(measure, across, up, columns, rows, mean)


def _words(factor: SweepColumn, values: np.ndarray) -> list[str]:
    return [factor.levels[int(value)] if factor.levels else f"{value:.3g}" for value in values]
