"""Laws of the first invariant: W_iso(I1_bar). A law's module has the leaves ``isochoric(I1_bar, c)`` and ``slope(I1_bar, c)``."""

from __future__ import annotations

from explicitfe.fem.materials.kinematics import isochoric_invariant, isochoric_stress
from explicitfe.platform.compiled.jit import PLACEHOLDER, leaf

LEAVES = ("isochoric", "slope")  # that the module of a law has: the energy and its slope

# Placeholders, bound to those.
law_isochoric = law_slopes = PLACEHOLDER


def isochoric_at(at, c):
    """W_iso [Pa] at the invariants ``at``."""
    return law_isochoric(at[0], c)


def slopes_at(at, c):
    """dW_iso/dI1_bar [Pa], as a tuple of one."""
    return (law_slopes(at[0], c),)


@leaf
def invariants(F, cof, J):
    """I1_bar, as a tuple of one."""
    return (isochoric_invariant(F, J),)


@leaf
def raised(at, delta):
    """The invariants with delta in them."""
    return (at[0] + delta,)


@leaf
def lowered(at, delta):
    """The invariants without the delta that is in them."""
    return (at[0] - delta,)


@leaf
def stiffened(slopes, more, factor):
    """The slopes with ``more`` added to that by I1_bar, times a factor."""
    return ((slopes[0] + more) * factor,)


@leaf
def total(slopes):
    """dW/ddelta [Pa]: delta adds to each invariant."""
    return slopes[0]


@leaf
def first_stress(F, cof, J, at, slopes, pressure):
    """First Piola-Kirchhoff stress [Pa] of W_iso with these slopes at the invariants ``at``, and of a pressure U'."""
    return isochoric_stress(F, cof, J, at[0], slopes[0], pressure)


@leaf
def second_stress(slopes, C, inverse, square):
    """Isochoric second Piola-Kirchhoff stress [Pa], (11, 22, 33, 12, 13, 23): 2 W' J^(-2/3) (1 - tr C / 3 C^-1).

    ``inverse`` is C^-1 in the same order, ``square`` J^(-2/3).
    """
    a = 2.0 * slopes[0] * square
    b = -(1.0 / 3.0) * a * (C[0] + C[1] + C[2])
    return a + b * inverse[0], a + b * inverse[1], a + b * inverse[2], b * inverse[3], b * inverse[4], b * inverse[5]
