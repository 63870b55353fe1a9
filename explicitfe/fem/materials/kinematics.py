"""Parts of the deformation gradient that every law needs. F is a tuple of 9, row by row: F[3 i + j] = dx_i / dX_j."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import inverse_cube_root


@leaf
def cofactor(F):
    """Cofactor of F, J F^-T, row by row."""
    return (
        F[4] * F[8] - F[5] * F[7],
        F[5] * F[6] - F[3] * F[8],
        F[3] * F[7] - F[4] * F[6],
        F[2] * F[7] - F[1] * F[8],
        F[0] * F[8] - F[2] * F[6],
        F[1] * F[6] - F[0] * F[7],
        F[1] * F[5] - F[2] * F[4],
        F[2] * F[3] - F[0] * F[5],
        F[0] * F[4] - F[1] * F[3],
    )


@leaf
def determinant(F, cof):
    """J = det F, from F and its cofactor."""
    return F[0] * cof[0] + F[1] * cof[1] + F[2] * cof[2]


@leaf
def right_cauchy_green(F):
    """C = F^T F: 11, 22, 33, 12, 13, 23."""
    return (
        F[0] * F[0] + F[3] * F[3] + F[6] * F[6],
        F[1] * F[1] + F[4] * F[4] + F[7] * F[7],
        F[2] * F[2] + F[5] * F[5] + F[8] * F[8],
        F[0] * F[1] + F[3] * F[4] + F[6] * F[7],
        F[0] * F[2] + F[3] * F[5] + F[6] * F[8],
        F[1] * F[2] + F[4] * F[5] + F[7] * F[8],
    )


@leaf
def inverse_C(cof, J):
    """C^-1 = (cof F)^T cof F / J^2: 11, 22, 33, 12, 13, 23."""
    w = 1.0 / (J * J)
    return (
        w * (cof[0] * cof[0] + cof[3] * cof[3] + cof[6] * cof[6]),
        w * (cof[1] * cof[1] + cof[4] * cof[4] + cof[7] * cof[7]),
        w * (cof[2] * cof[2] + cof[5] * cof[5] + cof[8] * cof[8]),
        w * (cof[0] * cof[1] + cof[3] * cof[4] + cof[6] * cof[7]),
        w * (cof[0] * cof[2] + cof[3] * cof[5] + cof[6] * cof[8]),
        w * (cof[1] * cof[2] + cof[4] * cof[5] + cof[7] * cof[8]),
    )


@leaf
def plus(a, b):
    """Sum of two symmetric tensors: 11, 22, 33, 12, 13, 23."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


@leaf
def minus(a, b):
    """Difference of two symmetric tensors: 11, 22, 33, 12, 13, 23."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5])


@leaf
def times(factor, a):
    """A symmetric tensor times a factor: 11, 22, 33, 12, 13, 23."""
    return (factor * a[0], factor * a[1], factor * a[2], factor * a[3], factor * a[4], factor * a[5])


@leaf
def squared_size(S, C):
    """tr(S C S C) of a second Piola-Kirchhoff stress S, which is tr(tau^2) of the Kirchhoff stress tau = F S F^T."""
    a, b, c, d, e, f = S
    m00, m01, m02 = a * C[0] + d * C[3] + e * C[4], a * C[3] + d * C[1] + e * C[5], a * C[4] + d * C[5] + e * C[2]
    m10, m11, m12 = d * C[0] + b * C[3] + f * C[4], d * C[3] + b * C[1] + f * C[5], d * C[4] + b * C[5] + f * C[2]
    m20, m21, m22 = e * C[0] + f * C[3] + c * C[4], e * C[3] + f * C[1] + c * C[5], e * C[4] + f * C[5] + c * C[2]
    return m00 * m00 + m11 * m11 + m22 * m22 + 2.0 * (m01 * m10 + m02 * m20 + m12 * m21)


@leaf
def isochoric_invariant(F, J):
    """I1_bar = J^(-2/3) tr(F^T F): the first invariant of the volume-preserving part."""
    root = inverse_cube_root(J)
    trace = (
        F[0] * F[0] + F[1] * F[1] + F[2] * F[2]
        + F[3] * F[3] + F[4] * F[4] + F[5] * F[5]
        + F[6] * F[6] + F[7] * F[7] + F[8] * F[8]
    )  # fmt: skip
    return trace * (root * root)


@leaf
def isochoric_stress(F, cof, J, I1_bar, slope, pressure):
    """P of W(I1_bar) + U(J): 2 W' J^(-2/3) (F - (tr C / 3) F^-T) + U' cof F, with slope = W' and pressure = U'.

    Bonet & Wood (2008), eq. 6.55 with the volumetric part of section 6.5.
    """
    root = inverse_cube_root(J)
    square = root * root
    a = 2.0 * slope * square
    b = pressure - 2.0 * slope * I1_bar * (1.0 / 3.0) * (square * root)
    return (
        a * F[0] + b * cof[0],
        a * F[1] + b * cof[1],
        a * F[2] + b * cof[2],
        a * F[3] + b * cof[3],
        a * F[4] + b * cof[4],
        a * F[5] + b * cof[5],
        a * F[6] + b * cof[6],
        a * F[7] + b * cof[7],
        a * F[8] + b * cof[8],
    )
