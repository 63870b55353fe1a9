"""How much wider than the noise alone says an interval has to be, as the residual of a fit shows it.

Noise that is as stated and independent from row to row leaves a residual of its own size that often changes its sign. Where the
law does not describe the data, or where neighbouring rows err alike, intervals that count independent noise only are too narrow,
often by a factor of ten and more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution

# The residual is larger than the noise where chance would make it so large in less than this share of all fits.
MISFIT_P = 0.01
# Neighbouring residuals that are correlated by more than this are no independent rows; fewer rows than these do not tell.
CORRELATED_RESIDUALS = 0.5
FEWEST_CORRELATED_ROWS = 20


@dataclass(frozen=True)
class Widening:
    """By how much intervals are wider than from independent noise alone, and why.

    Attributes
    ----------
    misfit : rms of the residual over the noise; 1 where chance makes it as large, or where the noise was estimated from it.
    correlation : of neighbouring residuals; 0 where they count as independent.
    rows, effective : rows, and independent rows that say as much.
    """

    misfit: float = 1.0
    correlation: float = 0.0
    rows: int = 1
    effective: float = 1.0

    @property
    def factor(self) -> float:
        """Standard errors are so many times those from independent noise alone."""
        return float(self.misfit * np.sqrt(self.rows / self.effective))


def widening_of(residuals: Sequence[np.ndarray], chi2: float, free: int, *, noise_estimated: bool) -> Widening:
    """What the residual of a fit says.

    Parameters
    ----------
    residuals : of each curve (k,), over the noise of its rows.
    chi2, free : their sum of squares, and its degrees of freedom.
    noise_estimated : the noise is that of the residual itself, so that it is never too small.
    """
    misfit = 1.0
    if not noise_estimated and free > 0 and chi2_distribution.sf(chi2, free) < MISFIT_P:
        misfit = float(np.sqrt(chi2 / free))
    rows = sum(len(r) for r in residuals)
    squares = sum(float(r @ r) for r in residuals)
    correlation = sum(float(r[1:] @ r[:-1]) for r in residuals) / squares if squares > 0.0 else 0.0
    if rows <= FEWEST_CORRELATED_ROWS or correlation <= CORRELATED_RESIDUALS:
        return Widening(misfit, 0.0, rows, float(rows))
    # As in a series whose rows go together like those of an autoregressive one of first order.
    effective = max(rows * (1.0 - correlation) / (1.0 + correlation), 1.0)
    return Widening(misfit, correlation, rows, effective)
