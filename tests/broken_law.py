"""A material law that does not come from an energy: tests of the energy balance have to notice it.

In a file of its own, so that a kernel bound to it stays in the cache while the tests around it are edited.
"""

from __future__ import annotations

from explicitfe.fem.materials import law_of
from explicitfe.platform.compiled.jit import leaf

SHARE = 0.1  # of the shear modulus 2 C10
yeoh_stress = law_of("yeoh").stress


@leaf
def circulating_stress(F, cof, J, delta, c):
    """The Yeoh stress and k (F_12 in P_13, -F_13 in P_12): dP_13/dF_12 = -dP_12/dF_13, so it has no energy."""
    P = yeoh_stress(F, cof, J, delta, c)
    k = 2.0 * SHARE * c[0]
    return P[0], P[1] - k * F[2], P[2] + k * F[1], P[3], P[4], P[5], P[6], P[7], P[8]
