"""Stress of a law in homogeneous tests, without elements: uniaxial, equibiaxial and planar load with free sides, simple shear.

The principal Kirchhoff stresses are tau_i = b_i - (b_1 + b_2 + b_3) / 3 + J U'(J), with b_i = stretch_i dW_iso/dstretch_i
(Holzapfel 2000, eq. 6.81 to 6.83). At a given stretch only the change of volume J is unknown: a free side, without stress,
requires K/2 (J^2 - 1) = (b_1 + b_2 + b_3) / 3 - b_free, and the nominal stress is (b_loaded - b_free) / stretch. Newton's method
solves this equation for all stretches at once. An incompressible law, with Poisson's ratio 0.5, has J = 1.

All functions accept complex stretches, so that a complex step gives exact derivatives.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from explicitfe.fem.materials.law import Law
from explicitfe.fem.materials.volumetric import bulk_modulus

Mode = Literal["uniaxial", "biaxial", "planar", "shear"]
INCOMPRESSIBLE = 0.5  # Poisson's ratio
COMPLEX_STEP = 1e-30
MOST_STRETCH_ITERATIONS = 50
CONVERGED_CHANGE = 1e-14  # of J


def nominal_stress(law: Law, mode: Mode, imposed: np.ndarray) -> np.ndarray:
    """Nominal stress (n,) Pa at stretches or at amounts of simple shear (n,).

    Parameters
    ----------
    law : the constants; Poisson's ratio counts, and 0.5 is incompressible.
    mode : "uniaxial", "biaxial" and "planar" (the width is held) take stretches, "shear" takes the amount of shear gamma.
    """
    if mode == "shear":
        stretch = 0.5 * (imposed + np.sqrt(imposed * imposed + 4.0))
        b = law.stretch_derivative(np.stack([stretch, 1.0 / stretch, np.ones_like(stretch)]))
        return (b[0] - b[1]) / (stretch + 1.0 / stretch)
    incompressible = law.poisson == INCOMPRESSIBLE
    J = np.ones(1) if incompressible else np.ones_like(imposed)
    for _ in range(0 if incompressible else MOST_STRETCH_ITERATIONS):
        # The slope may come from real parts: it decides only how fast the iteration converges.
        slope = _on_free_side(law, mode, imposed.real, J.real + 1j * COMPLEX_STEP).imag / COMPLEX_STEP
        change = _on_free_side(law, mode, imposed, J) / slope
        J = np.where(change.real < 0.5 * J.real, J - change, 0.5 * J)
        if not (np.abs(change) > CONVERGED_CHANGE).any():
            break
    b = _deviatoric(law, mode, imposed, J)
    return (b[0] - b[1]) / imposed


def nominal_slope(law: Law, mode: Mode, imposed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nominal stress (n,) Pa, and its derivative with respect to the stretch or shear (n,) Pa."""
    shifted = nominal_stress(law, mode, np.asarray(imposed, dtype=float) + 1j * COMPLEX_STEP)
    return shifted.real, shifted.imag / COMPLEX_STEP


def principal_stretches(mode: Mode, stretch: np.ndarray) -> np.ndarray:
    """Stretches (3, n) at constant volume: along the load, of a free side, and the third one."""
    free = stretch ** {"uniaxial": -0.5, "biaxial": -2.0, "planar": -1.0}[mode]
    return np.stack([stretch, free, {"uniaxial": free, "biaxial": stretch, "planar": np.ones_like(stretch)}[mode]])


def _deviatoric(law: Law, mode: Mode, stretch: np.ndarray, J: np.ndarray) -> np.ndarray:
    """b_i (3, n) Pa, of the directions of :func:`principal_stretches`, at stretches and changes of volume (n,)."""
    root = J ** (-1.0 / 3.0)
    along = stretch * root
    if mode != "planar":
        return law.stretch_derivative(principal_stretches(mode, along))
    return law.stretch_derivative(np.stack([along, 1.0 / (along * root), root * np.ones_like(along)]))


def _on_free_side(law: Law, mode: Mode, stretch: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Kirchhoff stress (n,) Pa on a free side."""
    b = _deviatoric(law, mode, stretch, J)
    return 0.5 * bulk_modulus(law.shear_modulus_Pa, law.poisson) * (J * J - 1.0) - (b.sum(axis=0) / 3.0 - b[1])
