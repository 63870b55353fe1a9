"""Noise of measured rows: white or correlated, and the scatter between nominally equal tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular


@dataclass(frozen=True)
class Noise:
    """What is added to the rows of a dataset.

    Attributes
    ----------
    level : sd of one row, relative to the largest value of the dataset.
    sd : the same in the unit of the rows.
    rho : correlation from row to row (AR(1)); 0 is white.
    scale_sd : of a factor of each curve, relative.
    offset_sd : of an offset of each curve, in the unit of the rows.
    """

    level: float
    sd: float
    rho: float = 0.0
    scale_sd: float = 0.0
    offset_sd: float = 0.0

    def add_to(self, rng: np.random.Generator, curves: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The curves (k,) as they are measured."""
        measured = []
        for values in curves:
            steps = rng.standard_normal(len(values))
            steps[1:] *= np.sqrt(1.0 - self.rho**2)
            for row in range(1, len(steps) if self.rho > 0.0 else 0):
                steps[row] += self.rho * steps[row - 1]
            factor, offset = 1.0 + self.scale_sd * rng.standard_normal(), self.offset_sd * rng.standard_normal()
            measured.append(factor * values + offset + self.sd * steps)
        return measured


class Whitener:
    """Turns differences of curves into numbers of unit variance each.

    Parameters
    ----------
    noise : their noise.
    curves : the true curves (k,), which scatter scales.
    counted : whether a curve counts.
    """

    def __init__(self, noise: Noise, curves: Sequence[np.ndarray], counted: Sequence[bool]) -> None:
        self.noise = noise
        self.counted = list(counted)
        self.ends = np.cumsum([len(values) for values in curves])[:-1]
        self._roots = None
        if noise.scale_sd > 0.0 or noise.offset_sd > 0.0:
            self._roots = [np.linalg.cholesky(self._covariance(values)) for values in curves]

    def __call__(self, difference: np.ndarray) -> np.ndarray:
        """Whitened difference of all rows (n,); only of the curves that count."""
        parts = np.split(difference, self.ends)
        return np.concatenate([self._whiten(part, k) for k, part in enumerate(parts) if self.counted[k]])

    def _covariance(self, values: np.ndarray) -> np.ndarray:
        steps = np.arange(len(values))
        rows = (
            self.noise.sd**2 * self.noise.rho ** np.abs(steps[:, None] - steps)
            if self.noise.rho
            else (self.noise.sd**2 * np.eye(len(values)))
        )
        return rows + self.noise.scale_sd**2 * np.outer(values, values) + self.noise.offset_sd**2

    def _whiten(self, part: np.ndarray, number: int) -> np.ndarray:
        if self._roots is not None:
            return solve_triangular(self._roots[number], part, lower=True)
        white = part / self.noise.sd
        if self.noise.rho > 0.0:
            white[1:] = (white[1:] - self.noise.rho * white[:-1]) / np.sqrt(1.0 - self.noise.rho**2)
        return white
