"""Neo-Hooke: W = C10 (I1_bar - 3) + U(J) (Rivlin 1948), the simplest law of rubber elasticity."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from explicitfe.compiled.jit import leaf
from explicitfe.materials.kinematics import isochoric_invariant, isochoric_stress
from explicitfe.materials.law import Law
from explicitfe.materials.volumetric import bulk_modulus, pressure
from explicitfe.materials.volumetric import energy as volumetric_energy


class NeoHooke(Law):
    """Constant of the neo-Hooke law; the initial shear modulus is 2 C10."""

    law: Literal["neo-hooke"]
    C10_Pa: float = Field(gt=0.0, description="half the shear modulus [Pa]")

    @property
    def shear_modulus_Pa(self) -> float:
        return 2.0 * self.C10_Pa

    def constants(self) -> tuple[float, ...]:
        return self.C10_Pa, bulk_modulus(self.shear_modulus_Pa, self.poisson)


CONSTANTS = 2


@leaf
def energy(F, J, delta, c):
    """W [Pa]; c = (C10, K)."""
    return isochoric(isochoric_invariant(F, J) + delta, c) + volumetric_energy(J, c[1])


@leaf
def isochoric(I1_bar, c):
    """W without U [Pa]."""
    return c[0] * (I1_bar - 3.0)


@leaf
def stress(F, cof, J, delta, c):
    """First Piola-Kirchhoff stress P = dW/dF [Pa], 9 numbers row by row."""
    return isochoric_stress(F, cof, J, isochoric_invariant(F, J), c[0], pressure(J, c[1]))


@leaf
def slope(I1_bar, c):
    """dW/dI1_bar [Pa]."""
    return c[0] + 0.0 * I1_bar
