"""A few columns of many that foretell tests which they were not fitted to: sparse regression with coefficients above zero.

Columns are added one by one, each time the one that lowers the misfit most with all coefficients fitted again (orthogonal
matching pursuit, Pati et al. 1993, with non-negative least squares, Lawson & Hanson 1974). How many are kept is decided by tests
left out in turn, by the rule of one standard error (Breiman et al. 1984): the fewest that are about as good as the best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

# Of the columns that would lower the misfit most by themselves, so many are fitted to see which one does.
TRIED_COLUMNS = 4


@dataclass(frozen=True, eq=False)
class Regression:
    """What a sparse regression is asked.

    Attributes
    ----------
    columns : (n, k) whitened answers to one unit of each coefficient.
    target : (n,) what they are to add up to, whitened.
    tests : (n,) to which test each row belongs.
    unit : (n,) what a whitened row is worth as a share of its curve's largest value.
    always : numbers of the columns that are in the law anyhow.
    """

    columns: np.ndarray
    target: np.ndarray
    tests: np.ndarray
    unit: np.ndarray
    always: Sequence[int] = ()

    def fitted(self, chosen: Sequence[int], rows: np.ndarray | None = None) -> np.ndarray:
        """Coefficients of the chosen columns, none below zero, from all rows or from some."""
        A, b = self.columns[:, list(chosen)], self.target
        if rows is not None:
            A, b = A[rows], b[rows]
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        return nnls(A / size, b)[0] / size

    def misfit(self, chosen: Sequence[int]) -> float:
        """Sum of squares that the chosen columns leave."""
        left = self.target - self.columns[:, list(chosen)] @ self.fitted(chosen)
        return float(left @ left)

    def left_out_errors(self, chosen: Sequence[int]) -> np.ndarray:
        """Rms error of each test, as a share of its curves' largest values, with coefficients from all others."""
        errors = []
        for test in dict.fromkeys(self.tests.tolist()):
            own = self.tests == test
            left = self.target[own] - self.columns[np.ix_(own, list(chosen))] @ self.fitted(chosen, ~own)
            errors.append(float(np.sqrt(np.mean((left * self.unit[own]) ** 2))))
        return np.array(errors)


def sparse(regression: Regression, most: int) -> list[int]:
    """Numbers of the columns of the most compact law that foretells left-out tests about as well as the best one.

    Parameters
    ----------
    most : columns at most, beside those that are always in.
    """
    sizes = np.maximum(np.linalg.norm(regression.columns, axis=0), 1e-300)
    chosen = list(regression.always)
    path = [chosen]
    for _ in range(most):
        left = regression.target - regression.columns[:, chosen] @ regression.fitted(chosen)
        Q, _ = np.linalg.qr(regression.columns[:, chosen] / sizes[chosen])
        own = regression.columns / sizes
        own = own - Q @ (Q.T @ own)
        length = np.linalg.norm(own, axis=0)
        gain = np.where(length > 1e-6, own.T @ left / np.maximum(length, 1e-6), 0.0)
        gain[chosen] = 0.0
        tried = [int(k) for k in np.argsort(-gain)[:TRIED_COLUMNS] if gain[k] > 0.0]
        if not tried:
            break
        best = min(tried, key=lambda k: regression.misfit([*chosen, k]))
        wanted = [*chosen, best]
        # A column that the new one has made needless is taken out again.
        needless = [k for k, c in zip(wanted, regression.fitted(wanted), strict=True) if c == 0.0 and k not in regression.always]
        chosen = [k for k in wanted if k not in needless]
        if any(set(chosen) == set(earlier) for earlier in path):
            break
        path.append(chosen)
    errors = [regression.left_out_errors(each) for each in path]
    best_errors = min(errors, key=lambda e: float(e.mean()))
    for columns, each in zip(path, errors, strict=True):
        worse = each - best_errors
        if worse.mean() <= np.std(worse, ddof=1) / np.sqrt(len(worse)):
            return columns
    return path[0]
