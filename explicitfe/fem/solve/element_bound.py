"""A bound of the highest frequency of an element by itself, of how it is deformed now.

An element vibrates fastest by changing its volume: omega_e^2 = tr A, A = cof F M cof F^T, with M from the gradients of its shape
functions. In a mesh neighbours keep an element from vibrating along all directions at once, so the fastest vibration of a mesh
may lie along one, and a mesh that is pressed flat stiffens by more than tr A. Of the p-norms of the eigenvalues of A,

    tr A <= 3^(1 - 1/p) (tr A^p)^(1/p),

a bound at every p, and as large as tr A where A is isotropic; the larger p, the more it follows the stiffest direction. Here p
is 8.
"""

from __future__ import annotations

from explicitfe.fem.materials.kinematics import cofactor
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import square_root

ISOTROPIC = 3.0 ** (7.0 / 8.0)


@leaf
def volume_stiffness(F, shape):
    """A bound of the square of an element's own frequency [1/s^2] at a deformation gradient F: 3^(7/8) tr(A^8)^(1/8).

    A = cof F M cof F^T; ``shape`` has xx, yy, zz, xy, xz, yz of M.
    """
    c = cofactor(F)
    x, y, z = (c[0], c[1], c[2]), (c[3], c[4], c[5]), (c[6], c[7], c[8])
    mx, my, mz = times(x, shape), times(y, shape), times(z, shape)
    A = square(square((dot(x, mx), dot(y, my), dot(z, mz), dot(x, my), dot(x, mz), dot(y, mz))))
    size = A[0] * A[0] + A[1] * A[1] + A[2] * A[2] + 2.0 * (A[3] * A[3] + A[4] * A[4] + A[5] * A[5])
    return ISOTROPIC * square_root(square_root(square_root(size)))


@leaf
def times(c, shape):
    """M c."""
    return (
        shape[0] * c[0] + shape[3] * c[1] + shape[4] * c[2],
        shape[3] * c[0] + shape[1] * c[1] + shape[5] * c[2],
        shape[4] * c[0] + shape[5] * c[1] + shape[2] * c[2],
    )


@leaf
def dot(a, b):
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@leaf
def square(A):
    """A A of a symmetric matrix: xx, yy, zz, xy, xz, yz."""
    return (
        A[0] * A[0] + A[3] * A[3] + A[4] * A[4],
        A[3] * A[3] + A[1] * A[1] + A[5] * A[5],
        A[4] * A[4] + A[5] * A[5] + A[2] * A[2],
        (A[0] + A[1]) * A[3] + A[4] * A[5],
        (A[0] + A[2]) * A[4] + A[3] * A[5],
        (A[1] + A[2]) * A[5] + A[3] * A[4],
    )
