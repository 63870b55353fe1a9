"""Energies of isotropic laws in plain numpy, and their stress by a complex step: a reference that knows nothing of the code.

P_ij = Im W(F + i h E_ij) / h with h = 1e-30: no difference is taken, so it is exact to rounding (Squire & Trapp 1998).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Energy = Callable[[np.ndarray], complex]
STEP = 1e-30


def invariants(F: np.ndarray) -> tuple[complex, complex, complex]:
    """I1_bar = J^(-2/3) tr C, I2_bar = J^(-4/3) ((tr C)^2 - tr C^2) / 2, and J."""
    C, J = F.T @ F, np.linalg.det(F)
    first = np.trace(C)
    return first * J ** (-2.0 / 3.0), 0.5 * (first**2 - np.trace(C @ C)) * J ** (-4.0 / 3.0), J


def series_energy(C10: float, C20: float = 0.0, C01: float = 0.0, C30: float = 0.0, C40: float = 0.0) -> Energy:
    """C10 x + C20 x^2 + C30 x^3 + C40 x^4 + C01 (I2_bar - 3) [Pa], x = I1_bar - 3."""

    def energy(F: np.ndarray) -> complex:
        first, second, _ = invariants(F)
        x = first - 3.0
        return C10 * x + C20 * x**2 + C30 * x**3 + C40 * x**4 + C01 * (second - 3.0)

    return energy


def volume_energy(K: float) -> Energy:
    """U = K/4 (J^2 - 1 - 2 ln J) [Pa]."""

    def energy(F: np.ndarray) -> complex:
        J = np.linalg.det(F)
        return 0.25 * K * (J * J - 1.0 - 2.0 * np.log(J))

    return energy


def derivative(F: np.ndarray, *energies: Energy) -> np.ndarray:
    """First Piola-Kirchhoff stress (3, 3) Pa, dW/dF of the sum of energies."""
    P = np.empty((3, 3))
    for entry in range(9):
        shifted = F.astype(complex)
        shifted.flat[entry] += 1j * STEP
        P.flat[entry] = sum(energy(shifted) for energy in energies).imag / STEP
    return P
