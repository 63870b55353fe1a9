"""The test of a residual against smooth curves, compared with the singular value decomposition of all rows."""

from dataclasses import dataclass

import numpy as np
import pytest

from explicitfe.inverse.close_loop.statistics.covariance import outside
from explicitfe.inverse.close_loop.statistics.lack_of_fit import IMITATION_SINE, lack_of_fit


@dataclass
class Row:
    stated: bool = True


@dataclass
class Noise:
    smooth: np.ndarray
    rows: tuple[Row, ...] = (Row(),)


@dataclass
class Fit:
    movable: np.ndarray
    residual: np.ndarray


def test_no_decomposition_of_all_rows_is_needed():
    """Three parameters nearly imitate smooth functions, three others do not."""
    rng = np.random.default_rng(3)
    smooth = np.linalg.qr(rng.normal(size=(400, 40)))[0]
    near = smooth[:, :3] + 0.01 * rng.normal(size=(400, 3))
    fit = Fit(np.column_stack([near, rng.normal(size=(400, 3))]), rng.normal(size=400))
    U, sines, _ = np.linalg.svd(outside(fit.movable, smooth), full_matrices=False)
    U = U[:, sines > IMITATION_SINE]
    lack = lack_of_fit(fit, Noise(smooth))
    assert U.shape[1] == 37
    assert lack.free == 37
    assert lack.chi2 == pytest.approx(np.sum((U.T @ outside(fit.movable, fit.residual)) ** 2), rel=1e-9)
