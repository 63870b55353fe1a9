"""Material stability: the stresses of a law must increase with the deformation, for all stretches in use.

A law is stable over a range of principal stretches if, at constant volume, the nominal stress and the Kirchhoff stress both
increase with the stretch in uniaxial and equibiaxial load, and the shear stress increases in simple shear. The condition on the
Kirchhoff stress over the logarithmic strain is Drucker's, as Abaqus checks it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from explicitfe.fem.materials.law import Law

STRETCHES_IN_USE = (0.5, 2.0)  # principal stretches for which constants are checked where nothing else is known
STRETCHES_CHECKED = 201
COMPLEX_STEP = 1e-30


@dataclass(frozen=True)
class Loss:
    """Loss of stability: the first stretch, seen from 1, at which a stress stops increasing, and the load."""

    stretch: float
    load: str


def loss_of_stability(law: Law, stretches: tuple[float, float] = STRETCHES_IN_USE) -> Loss | None:
    """The loss of stability nearest to the reference state, or None if the law is stable.

    Parameters
    ----------
    law : the constants.
    stretches : smallest and largest principal stretch in use, at most and at least 1.
    """
    low, high = stretches
    # All principal stretches stay within the range: at constant volume the other two are stretch^(-1/2), or the third stretch^-2.
    ranges = {
        "uniaxial tension": (0, 1.0, min(high, low**-2.0)),
        "uniaxial compression": (0, 1.0, max(low, high**-2.0)),
        "equibiaxial tension": (1, 1.0, min(high, low**-0.5)),
        "equibiaxial compression": (1, 1.0, max(low, high**-0.5)),
        "shear": (2, 1.0, min(high, 1.0 / low)),
    }
    losses = []
    for load, (kind, begin, end) in ranges.items():
        stretch = np.linspace(begin, end, STRETCHES_CHECKED)
        kirchhoff, nominal = _tangents(law, kind, stretch)
        lost = ~((kirchhoff > 0.0) & (nominal > 0.0))
        if lost.any():
            losses.append(Loss(float(stretch[lost.argmax()]), load))
    return min(losses, key=lambda loss: abs(np.log(loss.stretch)), default=None)


def check_stability(law: Law) -> None:
    """Refuse constants that are unstable within ``STRETCHES_IN_USE``.

    Raises
    ------
    ValueError : with the stretch at which stability is lost.
    """
    loss = loss_of_stability(law)
    if loss is not None:
        negative = ", ".join(f"{key} = {value:g}" for key in law.reads if (value := getattr(law, key)) < 0.0)
        raise ValueError(
            f"with {negative or 'these constants'} the law loses stability at a stretch of {loss.stretch:.3g} in {loss.load}: "
            "the stress stops increasing there. Laws must be stable for stretches "
            f"from {STRETCHES_IN_USE[0]:g} to {STRETCHES_IN_USE[1]:g}; "
            "increase the negative constants or add a positive third term."
        )


def _tangents(law: Law, kind: int, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (n,) Pa at constant volume: Kirchhoff stress by logarithmic strain, nominal stress by stretch."""
    shifted = stretch + 1j * COMPLEX_STEP
    free = shifted ** (-0.5, -2.0, -1.0)[kind]
    third = (free, shifted, np.ones_like(shifted))[kind]
    b = law.stretch_derivative(np.stack([shifted, free, third]))
    if kind == 2:  # The shear stress is dW/dgamma with gamma = stretch - 1 / stretch.
        tangent = ((b[0] - b[1]) / (shifted + 1.0 / shifted)).imag / COMPLEX_STEP
        return tangent, tangent
    difference = b[0] - b[1]
    return stretch * difference.imag / COMPLEX_STEP, (difference / shifted).imag / COMPLEX_STEP
