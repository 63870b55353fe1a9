"""Hourglass control by a plain stiffness, for comparison: the element stores V W(I1_bar + delta), delta = c sum_k |q_k|^2.

The hourglass modes q_k vanish on every affine field, so the energy is zero under rigid motion and homogeneous strain at any
rotation, and the force is its derivative (Flanagan & Belytschko 1981; Joldes, Wittek & Miller 2008). It scales with the shear
modulus, never with the bulk modulus, which would lock bending. It does not know the proportions of the element.
"""

from __future__ import annotations

import numpy as np

from explicitfe.platform.compiled.jit import leaf

HAS_BARRIER = False
STIFFNESS_FACTOR = 1.0  # of the derived stiffness; the study of hourglass control tries what others would do


def constants(corners: np.ndarray, geometry: np.ndarray) -> np.ndarray:
    """What the kernels read of each element, (m, 1) 1/m^2: c = tr(B B^T) / 24.

    The factor is derived, not fitted: a cube of edge h gets the stiffness G h / 16, with which bending it by a relative rotation
    theta of two opposite faces stores the exact energy of an incompressible beam (E = 3 G), E V theta^2 / 24.

    Parameters
    ----------
    corners : (m, 8, 3) m. Not needed here.
    geometry : (m, hex8.GEOMETRY) the elements' numbers; tr(B B^T) = 8 sum_m b_m^2.
    """
    return STIFFNESS_FACTOR / 3.0 * np.sum(geometry[:, :18] ** 2, axis=1)[:, None]


@leaf
def of_shape(modes, g):
    """The same from the geometry of an element."""
    return (
        (STIFFNESS_FACTOR / 3.0)
        * (
            g[0] * g[0] + g[1] * g[1] + g[2] * g[2] + g[3] * g[3] + g[4] * g[4] + g[5] * g[5]
            + g[6] * g[6] + g[7] * g[7] + g[8] * g[8] + g[9] * g[9] + g[10] * g[10] + g[11] * g[11]
            + g[12] * g[12] + g[13] * g[13] + g[14] * g[14] + g[15] * g[15] + g[16] * g[16] + g[17] * g[17]
        ),
    )  # fmt: skip


@leaf
def invariant(F, qx, qy, qz, c):
    """delta: what the hourglass deformation adds to I1_bar."""
    square_x = qx[0] * qx[0] + qx[1] * qx[1] + qx[2] * qx[2] + qx[3] * qx[3]
    square_y = qy[0] * qy[0] + qy[1] * qy[1] + qy[2] * qy[2] + qy[3] * qy[3]
    square_z = qz[0] * qz[0] + qz[1] * qz[1] + qz[2] * qz[2] + qz[3] * qz[3]
    return c[0] * (square_x + square_y + square_z)


@leaf
def force(F, qx, qy, qz, c, weight):
    """Derivatives of weight x delta by q_k of each component, 3 x 4, and by F, zero here; weight = V dW/dI1_bar."""
    k = 2.0 * c[0] * weight
    zero = 0.0 * k
    return (
        (k * qx[0], k * qx[1], k * qx[2], k * qx[3]),
        (k * qy[0], k * qy[1], k * qy[2], k * qy[3]),
        (k * qz[0], k * qz[1], k * qz[2], k * qz[3]),
        (zero, zero, zero, zero, zero, zero, zero, zero, zero),
    )
