"""The covariance of what is not physics, and the whitening by it.

Sigma = rows (white or AR(1)) + a scale and an offset of each test + sum of d d^T, d being what the numerics or an assumed
dimension change. The first part is banded, the rest is of low rank, so nothing of the size rows x rows is ever formed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from explicitfe.discrepancy.noise import RowNoise, Scatter, whitened_rows
from explicitfe.discrepancy.system import Answer, Series


@dataclass(frozen=True, eq=False)
class Covariance:
    """Sigma of all series together.

    Attributes
    ----------
    series, rows, scatter : see :mod:`explicitfe.discrepancy.noise`.
    floors : name -> change (n,) SI of all rows, one standard deviation of it.
    """

    series: Sequence[Series]
    rows: Sequence[RowNoise]
    scatter: Scatter
    floors: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        columns = [self.by_rows(d[:, None])[:, 0] for d in (*self._tests(), *self.floors.values())]
        V = np.array(columns).T if columns else np.zeros((sum(len(s.measured) for s in self.series), 0))
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
        return np.concatenate(
            [
                whitened_rows(columns[part] / row.sd[:, None], row.correlation)
                for part, row in zip(self.slices(), self.rows, strict=True)
            ]
        )

    def _tests(self) -> list[np.ndarray]:
        """A scale and an offset of each test, one standard deviation."""
        found: dict[tuple[str, str], np.ndarray] = {}
        total = sum(len(s.measured) for s in self.series)
        for one, part in zip(self.series, self.slices(), strict=True):
            largest = float(np.abs(one.measured).max())
            for kind, sd, shape in (
                ("scale", self.scatter.scale, one.measured),
                ("offset", self.scatter.offset, np.full(len(one.measured), largest)),
            ):
                if sd > 0.0:
                    found.setdefault((kind, one.test), np.zeros(total))[part] = sd * shape
        return list(found.values())


def stacked(answer: Answer) -> np.ndarray:
    """Rows of all series, one after the other."""
    return np.concatenate(answer)


def measured(series: Sequence[Series]) -> np.ndarray:
    """All measured rows."""
    return np.concatenate([one.measured for one in series])
