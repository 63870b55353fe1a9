"""A test of a residual against smooth curves: physics is smooth between the bends of a loading protocol, and noise is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import f as f_distribution

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, orthonormal, outside
from explicitfe.inverse.close_loop.statistics.refit import BestFit

# Of a direction that the constants nearly imitate, the noise of the imposed column in their derivatives remains: a direction
# counts if the sine of its angle to what they imitate is larger.
IMITATION_SINE = 0.3
# The F-test assumes that the noise is known no better than from so many rows.
LEAST_DEGREES_OF_NOISE = 5.0


@dataclass(frozen=True)
class LackOfFit:
    """The part of a residual that a smooth curve explains.

    Attributes
    ----------
    chi2, free : whitened sum of squares along the smooth functions outside the model's span, and the number of these functions.
    p : p-value of so large a sum by chance.
    """

    chi2: float
    free: int
    p: float


def lack_of_fit(fit: BestFit, covariance: Covariance, explained: np.ndarray | None = None) -> LackOfFit:
    """Test the residual of a fit against smooth functions.

    The plain sum over all rows would test the stated noise rather than the model, because 5 % more noise in a thousand rows is
    significant. Where the noise was estimated from the rows, the test is an F-test.

    Parameters
    ----------
    explained : (n, k) whitened columns that count as explained.
    """
    span = fit.movable if explained is None else np.column_stack([fit.movable, explained])
    axes, Q = orthonormal(span), covariance.smooth
    # Of the smooth functions outside the span only those along `imitated` change their length; the others stay orthonormal.
    _, cosine, imitated = np.linalg.svd(axes.T @ Q, full_matrices=False)
    along = Q.T @ outside(span, fit.residual)
    of_imitated = (imitated @ along) ** 2
    square = 1.0 - np.minimum(cosine, 1.0) ** 2
    kept = square > IMITATION_SINE**2
    free = Q.shape[1] - len(kept) + int(kept.sum())
    size = float(along @ along - of_imitated.sum() + (of_imitated[kept] / square[kept]).sum())
    if not free:
        p = 1.0
    elif all(row.stated for row in covariance.rows):
        p = float(chi2_distribution.sf(size, free))
    else:
        known = max(covariance.effective - free, LEAST_DEGREES_OF_NOISE)
        p = float(f_distribution.sf(size / free, free, known))
    return LackOfFit(size, free, p)
