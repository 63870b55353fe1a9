"""Hourglass control by an assumed strain: what an exactly bent and twisted element would store.

In the element's frame e_i = dX/dxi_i the hourglass modes eta zeta, zeta xi, xi eta bend and twist the element. Of their strains
only those are kept that a thin plate has (Belytschko & Bindeman 1993; Puso 2000): the field proportional to zeta has e11 from
zeta xi, e22 from eta zeta and e12 from both, in plane stress, and so on around; transverse shears, which lock bending, and
the volume change, which locks at Poisson's ratio 1/2, are left out. The mode xi eta zeta is held by uniaxial stress.

With the frame carried along, a_i = F e_i, the mean square of that strain over the element is, as an addition to I1_bar,

    delta = (1 / 96) { sum over the fields ij of [2 A^2 + 2 B^2 + 2 A B + 1/2 S^2] + 1/2 sum_i (q_4 . a_i / |a_i|^2)^2 },
    A = q_k . a_i / |a_i|^2,  B = q_l . a_j / |a_j|^2,  S = (q_i . a_i + q_j . a_j) / (|a_i| |a_j|),

and the element stores V W(I1_bar + delta): the law itself says how stiff the element is in bending, now and here. That is
objective, zero on every affine field, and its forces are the derivatives of an energy. For a beam or a plate of bricks it is
exact at Poisson's ratio 1/2, whatever their proportions. No number is fitted, and the bulk modulus does not enter.
"""

from __future__ import annotations

import numpy as np

from explicitfe.fem.elements.hex8 import MODES
from explicitfe.platform.compiled.jit import leaf

HAS_BARRIER = True  # at the corners, elements/barrier.py: it reads the frame


def constants(corners: np.ndarray, geometry: np.ndarray) -> np.ndarray:
    """What the kernels read of each element, (m, 9): the frame e_1, e_2, e_3 [m]."""
    return (MODES[:3] @ corners / 8.0).reshape(-1, 9)


@leaf
def of_shape(modes, g):
    """The same from the modes of the three components of the reference shape."""
    x, y, z = modes
    return (
        0.125 * x[0], 0.125 * y[0], 0.125 * z[0],
        0.125 * x[1], 0.125 * y[1], 0.125 * z[1],
        0.125 * x[2], 0.125 * y[2], 0.125 * z[2],
    )  # fmt: skip


@leaf
def _carried(F, c):
    """The frame as it lies now, a_i = F e_i, and 1 / |a_i|^2."""
    a1 = (
        F[0] * c[0] + F[1] * c[1] + F[2] * c[2],
        F[3] * c[0] + F[4] * c[1] + F[5] * c[2],
        F[6] * c[0] + F[7] * c[1] + F[8] * c[2],
    )
    a2 = (
        F[0] * c[3] + F[1] * c[4] + F[2] * c[5],
        F[3] * c[3] + F[4] * c[4] + F[5] * c[5],
        F[6] * c[3] + F[7] * c[4] + F[8] * c[5],
    )
    a3 = (
        F[0] * c[6] + F[1] * c[7] + F[2] * c[8],
        F[3] * c[6] + F[4] * c[7] + F[5] * c[8],
        F[6] * c[6] + F[7] * c[7] + F[8] * c[8],
    )
    n1 = a1[0] * a1[0] + a1[1] * a1[1] + a1[2] * a1[2]
    n2 = a2[0] * a2[0] + a2[1] * a2[1] + a2[2] * a2[2]
    n3 = a3[0] * a3[0] + a3[1] * a3[1] + a3[2] * a3[2]
    # one division instead of three: eight of them take 24 cycles of a Skylake-X
    n12 = n1 * n2
    w = 1.0 / (n12 * n3)
    w12 = w * n3
    return a1, a2, a3, w12 * n2, w12 * n1, w * n12


@leaf
def _along(qx, qy, qz, k, a):
    """q_k . a."""
    return qx[k] * a[0] + qy[k] * a[1] + qz[k] * a[2]


@leaf
def _strains(F, qx, qy, qz, c):
    """The carried frame and the amplitudes of its strains: bending A, B of each field, twist s, and f of xi eta zeta."""
    a1, a2, a3, w1, w2, w3 = _carried(F, c)
    bending = (
        w2 * _along(qx, qy, qz, 2, a2),
        w3 * _along(qx, qy, qz, 1, a3),
        w1 * _along(qx, qy, qz, 2, a1),
        w3 * _along(qx, qy, qz, 0, a3),
        w1 * _along(qx, qy, qz, 1, a1),
        w2 * _along(qx, qy, qz, 0, a2),
    )
    t1, t2, t3 = _along(qx, qy, qz, 0, a1), _along(qx, qy, qz, 1, a2), _along(qx, qy, qz, 2, a3)
    third = (w1 * _along(qx, qy, qz, 3, a1), w2 * _along(qx, qy, qz, 3, a2), w3 * _along(qx, qy, qz, 3, a3))
    return (a1, a2, a3), (w1, w2, w3), bending, (t1 + t2, t1 + t3, t2 + t3), third


@leaf
def invariant(F, qx, qy, qz, c):
    """delta: what the hourglass deformation adds to I1_bar on the mean of the element."""
    _, (w1, w2, w3), (A1, B1, A2, B2, A3, B3), (s12, s13, s23), (f1, f2, f3) = _strains(F, qx, qy, qz, c)
    bent = A1 * A1 + B1 * B1 + A1 * B1 + A2 * A2 + B2 * B2 + A2 * B2 + A3 * A3 + B3 * B3 + A3 * B3
    twisted = s12 * s12 * w1 * w2 + s13 * s13 * w1 * w3 + s23 * s23 * w2 * w3
    return (1.0 / 96.0) * (2.0 * bent + 0.5 * (twisted + f1 * f1 + f2 * f2 + f3 * f3))


@leaf
def force(F, qx, qy, qz, c, weight):
    """Derivatives of weight x delta by q_k of each component, 3 x 4, and by F, 9 numbers row by row; weight = V dW/dI1_bar."""
    frame, (w1, w2, w3), (A1, B1, A2, B2, A3, B3), (s12, s13, s23), (f1, f2, f3) = _strains(F, qx, qy, qz, c)
    a1, a2, a3 = frame
    m = (1.0 / 96.0) * weight

    # d_ki = d / d(q_k . a_i)
    x3, y3 = m * (4.0 * A3 + 2.0 * B3), m * (4.0 * B3 + 2.0 * A3)
    x2, y2 = m * (4.0 * A2 + 2.0 * B2), m * (4.0 * B2 + 2.0 * A2)
    x1, y1 = m * (4.0 * A1 + 2.0 * B1), m * (4.0 * B1 + 2.0 * A1)
    u12, u13, u23 = m * w1 * w2 * s12, m * w1 * w3 * s13, m * w2 * w3 * s23
    d21, d12 = x3 * w1, y3 * w2
    d31, d13 = x2 * w1, y2 * w3
    d32, d23 = x1 * w2, y1 * w3
    d11, d22, d33 = u12 + u13, u12 + u23, u13 + u23
    d41, d42, d43 = m * w1 * f1, m * w2 * f2, m * w3 * f3

    # l_i = 2 d / d|a_i|^2
    l1 = -w1 * (2.0 * (x3 * A3 + x2 * A2 + m * f1 * f1) + u12 * s12 + u13 * s13)
    l2 = -w2 * (2.0 * (y3 * B3 + x1 * A1 + m * f2 * f2) + u12 * s12 + u23 * s23)
    l3 = -w3 * (2.0 * (y2 * B2 + y1 * B1 + m * f3 * f3) + u13 * s13 + u23 * s23)

    d = (d11, d12, d13, d21, d22, d23, d31, d32, d33, d41, d42, d43)
    along = (l1, l2, l3)
    rx, b1x, b2x, b3x = _component(qx, (a1[0], a2[0], a3[0]), d, along)
    ry, b1y, b2y, b3y = _component(qy, (a1[1], a2[1], a3[1]), d, along)
    rz, b1z, b2z, b3z = _component(qz, (a1[2], a2[2], a3[2]), d, along)
    stress = (
        b1x * c[0] + b2x * c[3] + b3x * c[6], b1x * c[1] + b2x * c[4] + b3x * c[7], b1x * c[2] + b2x * c[5] + b3x * c[8],
        b1y * c[0] + b2y * c[3] + b3y * c[6], b1y * c[1] + b2y * c[4] + b3y * c[7], b1y * c[2] + b2y * c[5] + b3y * c[8],
        b1z * c[0] + b2z * c[3] + b3z * c[6], b1z * c[1] + b2z * c[4] + b3z * c[7], b1z * c[2] + b2z * c[5] + b3z * c[8],
    )  # fmt: skip
    return rx, ry, rz, stress


@leaf
def _component(q, a, d, along):
    """One component of r_k = sum_i d_ki a_i and of b_i = d / d a_i = sum_k d_ki q_k + l_i a_i, with l = ``along``."""
    a1, a2, a3 = a
    d11, d12, d13, d21, d22, d23, d31, d32, d33, d41, d42, d43 = d
    l1, l2, l3 = along
    r = (
        d11 * a1 + d12 * a2 + d13 * a3,
        d21 * a1 + d22 * a2 + d23 * a3,
        d31 * a1 + d32 * a2 + d33 * a3,
        d41 * a1 + d42 * a2 + d43 * a3,
    )
    b1 = d11 * q[0] + d21 * q[1] + d31 * q[2] + d41 * q[3] + l1 * a1
    b2 = d12 * q[0] + d22 * q[1] + d32 * q[2] + d42 * q[3] + l2 * a2
    b3 = d13 * q[0] + d23 * q[1] + d33 * q[2] + d43 * q[3] + l3 * a3
    return r, b1, b2, b3
