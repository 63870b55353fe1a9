"""The covariance Sigma of what is not physics, and the whitening by it.

Sigma = rows + a scale and an offset of each test + sum of d d^T, where d is what other numerics or another value of an assumed
length change. The first part is diagonal and the others are of low rank, so no matrix of the size rows x rows is ever formed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from explicitfe.inverse.close_loop.statistics.noise import RowNoise, Scatter, smooth_basis
from explicitfe.inverse.close_loop.statistics.system import Answer, Series

# Directions whose singular value is smaller, as a share of the largest, are none.
RANK_SHARE = 1e-10


@dataclass(frozen=True, eq=False)
class Covariance:
    """Sigma of all series together.

    Attributes
    ----------
    series, rows, scatter : see :mod:`explicitfe.inverse.close_loop.statistics.noise`.
    floors : name -> change (n,) SI of all rows, one standard deviation of it.
    shape : (n,) SI, the answer that a test's scale multiplies. If it were the measured rows, a model that answers nothing at all
        would be off by a scale only (Peelle's puzzle, D'Agostini 1994). Beyond what was measured it counts less again: a
        model could otherwise make the scatter as large as it likes by answering too much.
    """

    series: Sequence[Series]
    rows: Sequence[RowNoise]
    scatter: Scatter
    floors: Mapping[str, np.ndarray] = field(default_factory=dict)
    shape: np.ndarray | None = None

    def at(self, answer: np.ndarray) -> Covariance:
        """The covariance where a model answers (n,)."""
        return replace(self, shape=answer) if self.scatter.scale > 0.0 else self

    def rows_of(self, test: str) -> np.ndarray:
        """Which rows (n,) belong to a test."""
        return np.concatenate([np.full(len(one.measured), one.test == test) for one in self.series])

    def without_scatter(self) -> Covariance:
        """As if equal tests did not differ."""
        return (
            self
            if self.scatter.scale == self.scatter.offset == 0.0
            else replace(self, scatter=replace(self.scatter, scale=0.0, offset=0.0))
        )

    def of_rows(self) -> Covariance:
        """The noise of the rows alone."""
        return replace(self.without_scatter(), floors={}) if self.floors else self.without_scatter()

    @cached_property
    def shared(self) -> np.ndarray:
        """(n, m) V, whitened by the rows: what many rows have in common. Whitened by the rows, Sigma is 1 + V V^T."""
        columns = [*(d for _, d in self._scatter_columns()), *self.floors.values()]
        count = sum(len(one.measured) for one in self.series)
        return self.by_rows(np.array(columns).reshape(len(columns), count).T)

    def scaled_slopes(self, residual: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Slopes (n, p) of an answer with what the likely scale of each test adds to it, given measured - answer (n,)."""
        columns = self._scatter_columns()
        scales = [k for k, (kind, _) in enumerate(columns) if kind == "scale"]
        if not scales:
            return slopes
        V = self.shared
        size = np.linalg.solve(V.T @ V + np.eye(V.shape[1]), V.T @ self.by_rows(residual[:, None])[:, 0])
        change = self._slopes_of_shape(slopes)
        scaled = slopes.copy()
        for k in scales:
            rows_of_test = columns[k][1] != 0.0
            scaled[rows_of_test] += self.scatter.scale * size[k] * change[rows_of_test]
        return scaled

    @cached_property
    def _shrinking(self) -> tuple[np.ndarray, np.ndarray]:
        """Axes (n, m) of what rows have in common, and the share (m,) by which whitening shortens columns along each."""
        V = self.shared
        axes, s, _ = np.linalg.svd(V, full_matrices=False) if V.size else (V, np.zeros(0), None)
        return axes, 1.0 - 1.0 / np.sqrt(1.0 + s**2)

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """Sigma^(-1/2) of columns (n,) or (n, k): noise of the covariance Sigma becomes independent and of unit variance."""
        flat = columns.ndim == 1
        axes, shares = self._shrinking
        y = self.by_rows(columns[:, None] if flat else columns)
        y = y - axes @ (shares[:, None] * (axes.T @ y))
        return y[:, 0] if flat else y

    @cached_property
    def smooth(self) -> np.ndarray:
        """Orthonormal whitened functions (n, m) of which smooth curves between the bends of the protocol consist."""
        bases = [smooth_basis(one) for one in self.series]
        return np.linalg.qr(self.whiten(block_diag(*bases)))[0]

    @cached_property
    def log_determinant(self) -> float:
        """Log determinant of Sigma over that of the noise of the rows alone."""
        V = self.shared
        return float(np.linalg.slogdet(np.eye(V.shape[1]) + V.T @ V)[1]) if V.size else 0.0

    @property
    def effective(self) -> float:
        """Effective number of data."""
        return float(sum(row.effective for row in self.rows))

    def slices(self) -> list[slice]:
        """The rows of each series among all."""
        ends = np.cumsum([0, *(len(s.measured) for s in self.series)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def floor_of(self, number: int, slopes: np.ndarray) -> float:
        """Rms [SI] of what is not physics in a series: noise of its rows, and what no parameter can imitate of the floors.

        The scatter between tests does not count.

        Parameters
        ----------
        slopes : (n, p) SI, derivatives of the answer by the parameters of the model.
        """
        rows = self.rows[number].sd
        part = self.slices()[number]
        columns = self.by_rows(np.column_stack([slopes, *self.floors.values()]))
        left = outside(columns[:, : slopes.shape[1]], columns[:, slopes.shape[1] :])[part] * self.rows[number].weight_sd[:, None]
        return float(np.sqrt(np.mean(rows**2) + (left**2).sum() / len(rows)))

    def by_rows(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n, k) whitened by the noise of the rows alone."""
        return columns / np.concatenate([row.weight_sd for row in self.rows])[:, None]

    def _scatter_columns(self) -> list[tuple[str, np.ndarray]]:
        """("scale" or "offset", one standard deviation (n,) SI of it) for each test."""
        columns: dict[tuple[str, str], np.ndarray] = {}
        shape = measured_rows(self.series) if self.shape is None else self.shape * np.sqrt(2.0 / (1.0 + self._excess**2))
        for one, part in zip(self.series, self.slices(), strict=True):
            largest = float(np.abs(one.measured).max())
            constant = np.full(len(one.measured), largest)
            for kind, sd, column in (("scale", self.scatter.scale, shape[part]), ("offset", self.scatter.offset, constant)):
                if sd > 0.0:
                    columns.setdefault((kind, one.test), np.zeros(len(shape)))[part] = sd * column
        return [(kind, column) for (kind, _), column in columns.items()]

    @cached_property
    def _excess(self) -> np.ndarray:
        """Of each row (n,) the sum of squares of what its series answers, over that of what was measured."""
        assert self.shape is not None
        ratios = [
            np.full(
                len(one.measured), float(self.shape[part] @ self.shape[part]) / max(float(one.measured @ one.measured), 1e-300)
            )
            for one, part in zip(self.series, self.slices(), strict=True)
        ]
        return np.concatenate(ratios)

    def _slopes_of_shape(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (n, p) of what a test's scale multiplies: shape sqrt(2 / (1 + excess^2))."""
        if self.shape is None:
            return np.zeros_like(slopes)
        change = slopes.copy()
        for part in self.slices():
            answer, excess = self.shape[part], self._excess[part.start]
            square = max(float(answer @ answer), 1e-300)
            change[part] -= 2.0 * excess**2 / (1.0 + excess**2) / square * np.outer(answer, answer @ slopes[part])
        return change * np.sqrt(2.0 / (1.0 + self._excess**2))[:, None]


def stack(answer: Answer) -> np.ndarray:
    """The rows (n,) of an answer to all series, one after the other."""
    return np.concatenate(answer)


def measured_rows(series: Sequence[Series]) -> np.ndarray:
    """The measured rows of all series, one after the other, SI."""
    return np.concatenate([one.measured for one in series])


def outside(J: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The part of columns (n, k) that lies outside the span of J (n, p)."""
    U = orthonormal(J)
    return columns - U @ (U.T @ columns)


def orthonormal(J: np.ndarray) -> np.ndarray:
    """Orthonormal axes (n, q) of the span of J (n, p)."""
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    return U[:, s > RANK_SHARE * max(s.max(initial=0.0), 1e-300)]
