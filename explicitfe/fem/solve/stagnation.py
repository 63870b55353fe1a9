"""Detection of a relaxation that makes no more progress."""

from __future__ import annotations

import numpy as np

# A load is approached in halves if neither the residual nor the kinetic energy has fallen by a tenth in so many iterations. The
# slowest mode needs some of its periods to die out: where the tissue is nearly incompressible, fictitious masses are large, and
# one period alone is longer than the first number.
ITERATIONS_WITHOUT_PROGRESS = 8000
PERIODS_WITHOUT_PROGRESS = 2.0
MOST_ITERATIONS_WITHOUT_PROGRESS = 60_000
SHARE_THAT_IS_PROGRESS = 0.9


class Stagnation:
    """Iterations without progress of the attempt to reach one load.

    Parameters
    ----------
    slowly : a fall by a tenth may take any number of checks; else it has to come from one check to the next.
    """

    def __init__(self, *, slowly: bool) -> None:
        self.slowly = slowly
        self.first = self.residual = self.kinetic = np.inf
        self.idle, self.limit = 0, float(ITERATIONS_WITHOUT_PROGRESS)

    @property
    def is_stalled(self) -> bool:
        """Whether the attempt should be given up."""
        return self.idle >= self.limit

    def count(self, iterations: int) -> None:
        """Count iterations as idle until :meth:`check` finds progress."""
        self.idle += iterations

    def check(self, residual: float, kinetic_ratio: float, stiffness: float) -> None:
        """Compare with the smallest values so far: a load has converged if both are small, so the fall of either is progress.

        Parameters
        ----------
        stiffness : Rayleigh quotient of the last increment, the square of the slowest angular frequency per iteration.
        """
        self.first = residual if self.first == np.inf else self.first
        falls = residual < SHARE_THAT_IS_PROGRESS * self.residual or kinetic_ratio < SHARE_THAT_IS_PROGRESS**2 * self.kinetic
        if falls:
            self.idle = 0
        if falls or not self.slowly:
            self.residual, self.kinetic = min(self.residual, residual), min(self.kinetic, kinetic_ratio)
        periods = PERIODS_WITHOUT_PROGRESS * 2.0 * np.pi / np.sqrt(max(stiffness, np.finfo(float).tiny))
        self.limit = float(np.clip(periods, ITERATIONS_WITHOUT_PROGRESS, MOST_ITERATIONS_WITHOUT_PROGRESS))

    def share(self, tolerance: float) -> float:
        """Share of the way from the first residual to the tolerance, on a logarithmic scale."""
        return float(np.clip(np.log(self.first / self.residual) / np.log(max(self.first / tolerance, 1.0 + 1e-9)), 0.0, 1.0))
