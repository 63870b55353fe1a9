"""The stable step of central differences: dt < 2 / omega_max, with omega_max of the current state.

Two answers. ``element_bounds`` is a bound: no element vibrates faster than its own, and no mesh faster than its fastest
element (Irons & Treharne 1971). ``HighestFrequency`` finds the true one of the whole mesh, from below, so the step that is
used stays a stated fraction under it (``FRACTION``).
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
from scipy.linalg import eigh_tridiagonal

from explicitfe.materials import volumetric

FRACTION = 0.9  # of the limit that the iteration gives


def element_bounds(
    gradients: np.ndarray,
    volumes: np.ndarray,
    displacement: np.ndarray,
    law: ModuleType,
    constants: np.ndarray,
    hourglass_largest: np.ndarray,
    density: np.ndarray,
) -> np.ndarray:
    """Upper bound of the highest angular frequency squared of each element at displacement u, (m,) 1/s^2.

    omega^2 <= (8 / rho) (M tr(b b^T) + lambda / V), with b = B F^-1 the gradient in the current shape, lambda the largest
    eigenvalue of the hourglass stiffness and M a bound of the current tangent. With h = dF F^-1 the second variation of
    W(I1_bar) + U(J) is

        W' [2 b_bar:(h^T h) - 8/3 (b_bar:h) tr h + 4/9 I1_bar (tr h)^2 + 2/3 I1_bar tr(h h)] + 4 W'' (dev b_bar : h)^2
        + U'' J^2 (tr h)^2 + U' J [(tr h)^2 - tr(h h)]

    and each |tr h|^2 and |h|^2 is at most tr(b b^T) |u|^2. (The largest eigenvalue of b b^T in place of the trace would
    be too small: a volume change adds the contributions of the three directions.)

    Parameters
    ----------
    gradients, volumes, displacement : (m, 8, 3) 1/m, (m,) m^3, (m, 8, 3) m at the corners.
    law : module of leaves (``slope``, ``curvature``).
    constants, density : (m, k), (m,) kg/m^3.
    hourglass_largest : (m,) N/m. Largest eigenvalue of each element's hourglass stiffness.
    """
    F = np.eye(3) + displacement.transpose(0, 2, 1) @ gradients
    J = np.linalg.det(F)
    spatial = gradients @ np.linalg.inv(F)
    b_bar = np.cbrt(J)[:, None, None] ** -2 * (F @ F.transpose(0, 2, 1))
    I1_bar = np.trace(b_bar, axis1=1, axis2=2)
    size = np.linalg.norm(b_bar, axis=(1, 2))
    deviator = size**2 - I1_bar**2 / 3.0
    c = constants.T
    slope = law.slope.py_func(I1_bar, c)
    bulk = c[-1]  # every law lists its bulk modulus last
    tangent = (
        volumetric.curvature.py_func(J, bulk) * J**2
        + 2.0 * np.abs(volumetric.pressure.py_func(J, bulk)) * J
        + slope * (2.0 * np.linalg.eigvalsh(b_bar)[:, -1] + 8.0 / 3.0 * size + 10.0 / 9.0 * I1_bar)
        + 4.0 * law.curvature.py_func(I1_bar, c) * deviator
    )
    return 8.0 / density * (tangent * np.sum(spatial**2, axis=(1, 2)) + hourglass_largest / volumes)


class HighestFrequency:
    """Estimates the highest angular frequency of the whole mesh, keeping its vector from call to call.

    Lanczos iteration on A = M^-1/2 K M^-1/2 (Parlett 1998, chapter 13), a power iteration that uses all its vectors: the
    tangent K is applied by differencing the internal force, so no matrix is ever formed. A start from the last vector alone
    would stay blind to an element that has stiffened elsewhere: noise is mixed in, and finds it.

    Parameters
    ----------
    minus_force : function that fills its second argument with minus the internal force at its first, both node rows.
    inverse_mass : (N, 4) 1/kg, 0 where held.
    length_m : typical element size; the force is differenced over a millionth of it.
    """

    NOISE = 0.3  # of the length of the start vector

    def __init__(
        self, minus_force: Callable[[np.ndarray, np.ndarray], object], inverse_mass: np.ndarray, length_m: float
    ) -> None:
        self._minus_force = minus_force
        self._root = np.sqrt(inverse_mass)
        self._length = length_m
        # Fixed seeds: a run repeated is the same run.
        self._noise = self._unit(np.random.default_rng(20051).standard_normal(inverse_mass.shape))
        self.vector = self._unit(np.random.default_rng(20052).standard_normal(inverse_mass.shape))

    def __call__(self, u: np.ndarray, force: np.ndarray, turns: int) -> float:
        """Highest angular frequency [1/s] at displacement u, whose minus internal force is ``force`` (both node rows).

        The estimate comes from below and grows with the number of turns, one force evaluation each. NaN where the force is
        not finite.
        """
        basis = [self._unit(self.vector + self.NOISE * self._noise)]
        diagonal: list[float] = []
        beside: list[float] = []
        for _ in range(turns):
            response = self._apply(basis[-1], u, force)
            diagonal.append(float(np.vdot(basis[-1], response)))
            response -= diagonal[-1] * basis[-1]
            if beside:
                response -= beside[-1] * basis[-2]
            beside.append(float(np.linalg.norm(response)))
            if not np.isfinite(beside[-1]):
                return float("nan")
            if beside[-1] <= 1e-12 * abs(diagonal[0]):  # the basis spans an invariant space
                break
            basis.append(response / beside[-1])
        last = len(diagonal) - 1
        values, vectors = eigh_tridiagonal(diagonal, beside[:last], select="i", select_range=(last, last))
        self.vector = self._unit(sum(weight * v for weight, v in zip(vectors[:, 0], basis, strict=False)))
        return float(np.sqrt(values[0]))

    def _apply(self, vector: np.ndarray, u: np.ndarray, force: np.ndarray) -> np.ndarray:
        direction = self._root * vector
        step = 1e-6 * self._length / np.abs(direction).max()
        response = np.empty_like(u)
        self._minus_force(u + step * direction, response)
        return self._root * (force - response) / step

    def _unit(self, vector: np.ndarray) -> np.ndarray:
        free = vector * (self._root > 0.0)
        return free / np.linalg.norm(free)
