"""Stress of a law in homogeneous tests, without elements: uniaxial and equibiaxial load with free sides, and simple shear.

The principal Kirchhoff stresses are tau_i = b_i - (b_1 + b_2 + b_3) / 3 + J U'(J), with b_i = stretch_i dW_iso/dstretch_i
(Holzapfel 2000, eq. 6.81 to 6.83). Under uniaxial or equibiaxial load only the change of volume J is unknown. With the difference
D = b_loaded - b_free at the isochoric stretch a = stretch J^(-1/3), the free sides require K/2 (J^2 - 1) = D/3 or 2 D/3, and the
nominal stress is D / stretch. Newton's method solves this equation for all stretches at once.

All functions accept complex stretches, so that a complex step gives exact derivatives.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from explicitfe.fem.materials.law import Law
from explicitfe.fem.materials.volumetric import bulk_modulus

Mode = Literal["uniaxial", "biaxial", "shear"]
# Share of D that the pressure carries, and the exponent of the free stretch: free = a^exponent at constant volume.
FREE_SIDES = {"uniaxial": (1.0 / 3.0, -0.5), "biaxial": (2.0 / 3.0, -2.0)}
COMPLEX_STEP = 1e-30
MOST_STRETCH_ITERATIONS = 50
CONVERGED_CHANGE = 1e-14  # of J


def nominal_stress(law: Law, mode: Mode, imposed: np.ndarray) -> np.ndarray:
    """Nominal stress (n,) Pa at stretches or at amounts of simple shear (n,).

    Parameters
    ----------
    law : the constants; Poisson's ratio counts.
    mode : "uniaxial" and "biaxial" take stretches, "shear" takes the amount of shear gamma.
    """
    if mode == "shear":
        stretch = 0.5 * (imposed + np.sqrt(imposed * imposed + 4.0))
        b = law.stretch_derivative(np.stack([stretch, 1.0 / stretch, np.ones_like(stretch)]))
        return (b[0] - b[1]) / (stretch + 1.0 / stretch)
    share, _ = FREE_SIDES[mode]
    K = bulk_modulus(law.shear_modulus_Pa, law.poisson)
    J = np.ones_like(imposed)
    for _ in range(MOST_STRETCH_ITERATIONS):
        # The slope may come from real parts: it decides only how fast the iteration converges.
        a = imposed.real * J.real ** (-1.0 / 3.0)
        D_slope = stress_difference(law, mode, a + 1j * COMPLEX_STEP).imag / COMPLEX_STEP
        residual = 0.5 * K * (J * J - 1.0) - share * stress_difference(law, mode, imposed * J ** (-1.0 / 3.0))
        change = residual / (K * J.real + share * D_slope * a / (3.0 * J.real))
        J = np.where(change.real < 0.5 * J.real, J - change, 0.5 * J)
        if not (np.abs(change) > CONVERGED_CHANGE).any():
            break
    return stress_difference(law, mode, imposed * J ** (-1.0 / 3.0)) / imposed


def nominal_slope(law: Law, mode: Mode, imposed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nominal stress (n,) Pa, and its derivative with respect to the stretch or shear (n,) Pa."""
    shifted = nominal_stress(law, mode, np.asarray(imposed, dtype=float) + 1j * COMPLEX_STEP)
    return shifted.real, shifted.imag / COMPLEX_STEP


def stress_difference(law: Law, mode: Mode, stretch: np.ndarray) -> np.ndarray:
    """D (n,) Pa: Kirchhoff stress along the load minus that of a free side, at isochoric stretches (n,)."""
    free = stretch ** FREE_SIDES[mode][1]
    third = free if mode == "uniaxial" else stretch
    b = law.stretch_derivative(np.stack([stretch, free, third]))
    return b[0] - b[1]
