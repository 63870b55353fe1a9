"""The energy of a volume change, shared by every law: U(J) = K/4 (J^2 - 1 - 2 ln J) (Simo & Taylor 1982).

It grows without bound as J -> 0 and as J -> infinity, U''(1) = K, and its stress needs no logarithm. At Poisson's
ratio 0.499 it agrees with K/2 (J - 1)^2 to (J - 1)/2 of the pressure: J leaves 1 by less than 0.01 there.
"""

from __future__ import annotations

import math

from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import inverse_cube_root, log


def bulk_modulus(shear_modulus_Pa: float, poisson: float) -> float:
    """K [Pa] from the initial shear modulus [Pa] and Poisson's ratio: K = 2 G (1 + nu) / (3 (1 - 2 nu))."""
    compression = 3.0 * (1.0 - 2.0 * poisson)
    return 2.0 * shear_modulus_Pa * (1.0 + poisson) / compression if compression else math.inf


@leaf
def energy(J, K):
    """U(J) [Pa]."""
    return 0.25 * K * (J * J - 1.0 - 2.0 * log(J))


@leaf
def pressure(J, K):
    """U'(J) [Pa] = K/2 (J - 1/J). 1/J is the cube of J^(-1/3), which the law needs anyway."""
    root = inverse_cube_root(J)
    return 0.5 * K * (J - root * root * root)


@leaf
def pressure_slope(J, K):
    """U''(J) [Pa] = K/2 (1 + 1/J^2)."""
    return 0.5 * K * (1.0 + 1.0 / (J * J))
