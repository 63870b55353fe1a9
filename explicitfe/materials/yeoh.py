"""Yeoh: W = C10 (I1_bar - 3) + C20 (I1_bar - 3)^2 + U(J) (Yeoh 1993; for the tongue Gerard et al. 2005, eq. 1)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from explicitfe.compiled.jit import leaf
from explicitfe.materials.kinematics import isochoric_invariant, isochoric_stress
from explicitfe.materials.law import Law
from explicitfe.materials.volumetric import bulk_modulus, pressure
from explicitfe.materials.volumetric import energy as volumetric_energy


class Yeoh(Law):
    """Constants of the two-parameter Yeoh law; the initial shear modulus is 2 C10."""

    law: Literal["yeoh"] = "yeoh"
    C10_Pa: float = Field(gt=0.0, description="first Yeoh constant [Pa]")
    C20_Pa: float = Field(ge=0.0, description="second Yeoh constant [Pa]")

    @property
    def shear_modulus_Pa(self) -> float:
        return 2.0 * self.C10_Pa

    def constants(self) -> tuple[float, ...]:
        return self.C10_Pa, self.C20_Pa, bulk_modulus(self.shear_modulus_Pa, self.poisson)


CONSTANTS = 3


@leaf
def energy(F, J, delta, c):
    """W [Pa]; c = (C10, C20, K)."""
    return isochoric(isochoric_invariant(F, J) + delta, c) + volumetric_energy(J, c[2])


@leaf
def isochoric(I1_bar, c):
    """W without U [Pa]."""
    return (c[0] + c[1] * (I1_bar - 3.0)) * (I1_bar - 3.0)


@leaf
def stress(F, cof, J, delta, c):
    """First Piola-Kirchhoff stress P = dW/dF [Pa], 9 numbers row by row."""
    I1_bar = isochoric_invariant(F, J)
    return isochoric_stress(F, cof, J, I1_bar, slope(I1_bar + delta, c), pressure(J, c[2]))


@leaf
def slope(I1_bar, c):
    """dW/dI1_bar [Pa]."""
    return c[0] + 2.0 * c[1] * (I1_bar - 3.0)
