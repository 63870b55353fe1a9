"""The covariance of what is not physics, and the whitening by it.

Sigma = rows + a scale and an offset of each test + sum of d d^T, d being what the numerics or an assumed dimension change. The
first part is diagonal, the rest is of low rank, so nothing of the size rows x rows is ever formed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from explicitfe.close_loop.statistics.noise import RowNoise, Scatter
from explicitfe.close_loop.statistics.system import Answer, Series


@dataclass(frozen=True, eq=False)
class Covariance:
    """Sigma of all series together.

    Attributes
    ----------
    series, rows, scatter : see :mod:`explicitfe.close_loop.statistics.noise`.
    floors : name -> change (n,) SI of all rows, one standard deviation of it.
    shape : (n,) SI, what a test's scale multiplies: an answer. Were it the measured rows, a model that answers nothing at all
        would be off by a scale only (Peelle's puzzle, D'Agostini 1994).
    """

    series: Sequence[Series]
    rows: Sequence[RowNoise]
    scatter: Scatter
    floors: Mapping[str, np.ndarray] = field(default_factory=dict)
    shape: np.ndarray | None = None

    def at(self, answer: np.ndarray) -> Covariance:
        """The covariance where a model answers (n,)."""
        return replace(self, shape=answer) if self.scatter.scale > 0.0 else self

    def of_rows(self) -> Covariance:
        """The part of the rows; itself if there is no other."""
        if not self.floors and self.scatter.scale == self.scatter.offset == 0.0:
            return self
        return Covariance(self.series, self.rows, replace(self.scatter, scale=0.0, offset=0.0))

    @cached_property
    def shared(self) -> np.ndarray:
        """(n, m), whitened by the rows: what many rows have in common. Sigma is that of the rows and this times its transpose."""
        columns = [*(d for _, d in self._tests()), *self.floors.values()]
        count = sum(len(one.measured) for one in self.series)
        return self.by_rows(np.array(columns).reshape(len(columns), count).T)

    def factors(self, residual: np.ndarray) -> np.ndarray:
        """Likely scale (n,) of each row's test, given measured - answer (n,)."""
        columns = self._tests()
        scales = [k for k, (kind, _) in enumerate(columns) if kind == "scale"]
        if not scales:
            return np.ones(len(residual))
        V = self.shared
        size = np.linalg.solve(V.T @ V + np.eye(V.shape[1]), V.T @ self.by_rows(residual[:, None])[:, 0])
        found = np.ones(len(residual))
        for k in scales:
            mine = columns[k][1] != 0.0
            found[mine] += self.scatter.scale * size[k]
        return found

    def __post_init__(self) -> None:
        V = self.shared
        A, s, _ = np.linalg.svd(V, full_matrices=False) if V.size else (V, np.zeros(0), None)
        object.__setattr__(self, "_axes", A)
        object.__setattr__(self, "_shrink", 1.0 - 1.0 / np.sqrt(1.0 + s**2))

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """Sigma^(-1/2) of columns (n,) or (n, k): of unit variance and independent if they have the covariance Sigma."""
        flat = columns.ndim == 1
        y = self.by_rows(columns[:, None] if flat else columns)
        y = y - self._axes @ (self._shrink[:, None] * (self._axes.T @ y))
        return y[:, 0] if flat else y

    @property
    def effective(self) -> float:
        """Effective number of data."""
        return float(sum(row.effective for row in self.rows))

    def slices(self) -> list[slice]:
        """Rows of each series."""
        ends = np.cumsum([0, *(len(s.measured) for s in self.series)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def floor_of(self, number: int) -> float:
        """Rms of what is not physics in a series: rows and floors, without the scatter between tests, SI."""
        rows = self.rows[number].sd
        part = self.slices()[number]
        return float(np.sqrt(np.mean(rows**2) + sum(np.mean(d[part] ** 2) for d in self.floors.values())))

    def by_rows(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n, k) whitened by the noise of the rows alone."""
        return columns / np.concatenate([row.weight_sd for row in self.rows])[:, None]

    def _tests(self) -> list[tuple[str, np.ndarray]]:
        """A scale and an offset of each test, one standard deviation."""
        found: dict[tuple[str, str], np.ndarray] = {}
        shape = measured(self.series) if self.shape is None else self.shape
        for one, part in zip(self.series, self.slices(), strict=True):
            largest = float(np.abs(one.measured).max())
            constant = np.full(len(one.measured), largest)
            for kind, sd, column in (("scale", self.scatter.scale, shape[part]), ("offset", self.scatter.offset, constant)):
                if sd > 0.0:
                    found.setdefault((kind, one.test), np.zeros(len(shape)))[part] = sd * column
        return [(kind, column) for (kind, _), column in found.items()]


def stacked(answer: Answer) -> np.ndarray:
    """Rows of all series, one after the other."""
    return np.concatenate(answer)


def measured(series: Sequence[Series]) -> np.ndarray:
    """All measured rows."""
    return np.concatenate([one.measured for one in series])
