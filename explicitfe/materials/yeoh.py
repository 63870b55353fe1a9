"""Yeoh: W = C10 (I1_bar - 3) + C20 (I1_bar - 3)^2 + U(J) (Yeoh 1993; for the tongue Gerard et al. 2005, eq. 1)."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from explicitfe.compiled.jit import leaf
from explicitfe.materials.law import Law


class Yeoh(Law):
    """Constants of the two-parameter Yeoh law; the initial shear modulus is 2 C10."""

    reads: ClassVar[tuple[str, ...]] = ("C10_Pa", "C20_Pa")

    law: Literal["yeoh"] = "yeoh"
    C10_Pa: float = Field(gt=0.0, description="first Yeoh constant [Pa]")
    C20_Pa: float = Field(ge=0.0, description="second Yeoh constant [Pa]")

    @property
    def shear_modulus_Pa(self) -> float:
        return 2.0 * self.C10_Pa


@leaf
def isochoric(I1_bar, c):
    """W without U [Pa]; c = (C10, C20, K)."""
    return (c[0] + c[1] * (I1_bar - 3.0)) * (I1_bar - 3.0)


@leaf
def slope(I1_bar, c):
    """dW/dI1_bar [Pa]."""
    return c[0] + 2.0 * c[1] * (I1_bar - 3.0)
