"""Factor by which intervals are wider than from independent noise alone, from the residual of a fit and the comparison of laws.

If the noise is as stated and independent from row to row, the residual has the size of the noise and changes its sign often. If
the law does not describe the data, or if neighbouring rows have correlated errors, intervals from independent noise are too
narrow, often by a factor of ten or more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution

# The residual is larger than the noise if chance makes it as large in less than this share of all fits.
MISFIT_P = 0.01
# Rows are not independent if neighbouring residuals correlate by more than this; the estimate needs more rows than these.
CORRELATED_RESIDUALS = 0.5
FEWEST_CORRELATED_ROWS = 20


@dataclass(frozen=True)
class Widening:
    """Factor of the intervals, and its causes.

    Attributes
    ----------
    misfit : rms of the residual over the noise; 1 where chance makes it as large, or where the noise was estimated from it.
    correlation : of neighbouring residuals; 0 where they count as independent.
    rows, effective : number of rows, and equivalent number of independent rows.
    model_form : factor for the error of the law itself; 1 where other laws and parts of the range agree with it.
    """

    misfit: float = 1.0
    correlation: float = 0.0
    rows: int = 1
    effective: float = 1.0
    model_form: float = 1.0

    @property
    def of_residual(self) -> float:
        """Standard errors over those from independent noise alone, as the residual shows."""
        return float(self.misfit * np.sqrt(self.rows / self.effective))

    @property
    def factor(self) -> float:
        """The same with the model-form error."""
        return self.of_residual * self.model_form


def widening_of(residuals: Sequence[np.ndarray], chi2: float, free: int, *, noise_estimated: bool) -> Widening:
    """The factor that the residual of a fit requires.

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
    # Effective sample size of a first-order autoregressive series.
    effective = max(rows * (1.0 - correlation) / (1.0 + correlation), 1.0)
    return Widening(misfit, correlation, rows, effective)
