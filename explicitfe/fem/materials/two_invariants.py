"""Laws of two invariants: W_iso(I1_bar, I2_bar). A law's module has the leaves ``isochoric(I1_bar, I2_bar, c)`` and ``slopes``.

With I2_bar = J^(-4/3) I2, I2 = (tr C)^2 / 2 - tr C^2 / 2 and dI2/dC = tr C 1 - C (Holzapfel 2000, eq. 6.30 and 6.110),

    S_iso = 2 W_1 J^(-2/3) (1 - I1 / 3 C^-1) + 2 W_2 J^(-4/3) (I1 1 - C - 2 I2 / 3 C^-1),  P_iso = F S_iso.
"""

from __future__ import annotations

from explicitfe.fem.materials.kinematics import isochoric_invariant, right_cauchy_green
from explicitfe.platform.compiled.jit import PLACEHOLDER, leaf
from explicitfe.platform.compiled.simd import inverse_cube_root

LEAVES = ("isochoric", "slopes")  # that the module of a law has: the energy and its two slopes

# Placeholders, bound to those.
law_isochoric = law_slopes = PLACEHOLDER


def isochoric_at(at, c):
    """W_iso [Pa] at the invariants ``at``."""
    return law_isochoric(at[0], at[1], c)


def slopes_at(at, c):
    """dW_iso/dI1_bar and dW_iso/dI2_bar [Pa]."""
    return law_slopes(at[0], at[1], c)


@leaf
def invariants(F, cof, J):
    """I1_bar, and I2_bar = J^(-4/3) |cof F|^2."""
    root = inverse_cube_root(J)
    square = root * root
    second = (
        cof[0] * cof[0] + cof[1] * cof[1] + cof[2] * cof[2]
        + cof[3] * cof[3] + cof[4] * cof[4] + cof[5] * cof[5]
        + cof[6] * cof[6] + cof[7] * cof[7] + cof[8] * cof[8]
    )  # fmt: skip
    return isochoric_invariant(F, J), second * (square * square)


@leaf
def raised(at, delta):
    """The invariants with delta in them: a small deviatoric strain e adds 2 e:e to either."""
    return at[0] + delta, at[1] + delta


@leaf
def lowered(at, delta):
    """The invariants without the delta that is in them."""
    return at[0] - delta, at[1] - delta


@leaf
def stiffened(slopes, more, factor):
    """The slopes with ``more`` added to that by I1_bar, times a factor."""
    return (slopes[0] + more) * factor, slopes[1] * factor


@leaf
def total(slopes):
    """dW/ddelta [Pa]: delta adds to each invariant."""
    return slopes[0] + slopes[1]


@leaf
def first_stress(F, cof, J, at, slopes, pressure):
    """First Piola-Kirchhoff stress [Pa] of W_iso with these slopes at the invariants ``at``, and of a pressure U'.

    P = a F - b F C + p cof F, with a = 2 J^(-2/3) (W_1 + W_2 I1_bar), b = 2 J^(-4/3) W_2 and
    p = U' - 2 (W_1 I1_bar + 2 W_2 I2_bar) / (3 J).
    """
    root = inverse_cube_root(J)
    square = root * root
    a = 2.0 * square * (slopes[0] + slopes[1] * at[0])
    b = 2.0 * (square * square) * slopes[1]
    p = pressure - (2.0 / 3.0) * (slopes[0] * at[0] + 2.0 * slopes[1] * at[1]) * (square * root)
    C = right_cauchy_green(F)
    S = (a - b * C[0], a - b * C[1], a - b * C[2], -b * C[3], -b * C[4], -b * C[5])
    return (
        F[0] * S[0] + F[1] * S[3] + F[2] * S[4] + p * cof[0],
        F[0] * S[3] + F[1] * S[1] + F[2] * S[5] + p * cof[1],
        F[0] * S[4] + F[1] * S[5] + F[2] * S[2] + p * cof[2],
        F[3] * S[0] + F[4] * S[3] + F[5] * S[4] + p * cof[3],
        F[3] * S[3] + F[4] * S[1] + F[5] * S[5] + p * cof[4],
        F[3] * S[4] + F[4] * S[5] + F[5] * S[2] + p * cof[5],
        F[6] * S[0] + F[7] * S[3] + F[8] * S[4] + p * cof[6],
        F[6] * S[3] + F[7] * S[1] + F[8] * S[5] + p * cof[7],
        F[6] * S[4] + F[7] * S[5] + F[8] * S[2] + p * cof[8],
    )


@leaf
def second_stress(slopes, C, inverse, square):
    """Isochoric second Piola-Kirchhoff stress [Pa], (11, 22, 33, 12, 13, 23), as in the head of this file.

    ``inverse`` is C^-1 in the same order, ``square`` J^(-2/3).
    """
    first = C[0] + C[1] + C[2]
    second = (C[0] * C[1] - C[3] * C[3]) + (C[0] * C[2] - C[4] * C[4]) + (C[1] * C[2] - C[5] * C[5])
    b = 2.0 * slopes[1] * (square * square)
    a = 2.0 * slopes[0] * square + b * first
    p = -(2.0 / 3.0) * (slopes[0] * square * first + b * second)
    return (
        a - b * C[0] + p * inverse[0],
        a - b * C[1] + p * inverse[1],
        a - b * C[2] + p * inverse[2],
        p * inverse[3] - b * C[3],
        p * inverse[4] - b * C[4],
        p * inverse[5] - b * C[5],
    )
