"""Yeoh: W = C10 (I1_bar - 3) + C20 (I1_bar - 3)^2 + C30 (I1_bar - 3)^3 + U(J) (Yeoh 1993).

Gerard et al. (2005, eq. 1) use the first two terms for the tongue.
"""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from explicitfe.fem.materials.law import Law
from explicitfe.fem.materials.stability import check_stability
from explicitfe.platform.compiled.jit import leaf


class Yeoh(Law):
    """Constants of the Yeoh law with two or three terms; the initial shear modulus is 2 C10.

    C20 and C30 may be negative if the law stays stable for principal stretches between 0.5 and 2; see ``stability``.
    """

    reads: ClassVar[tuple[str, ...]] = ("C10_Pa", "C20_Pa", "C30_Pa")

    law: Literal["yeoh"] = "yeoh"
    C10_Pa: float = Field(gt=0.0, description="first Yeoh constant [Pa]")
    C20_Pa: float = Field(description="second Yeoh constant [Pa]; may be negative where the law stays stable")
    C30_Pa: float = Field(default=0.0, description="third Yeoh constant [Pa]; may be negative where the law stays stable")

    @model_validator(mode="after")
    def _stable(self) -> Self:
        if min(self.C20_Pa, self.C30_Pa) < 0.0:
            check_stability(self)
        return self

    @property
    def shear_modulus_Pa(self) -> float:
        return 2.0 * self.C10_Pa


@leaf
def isochoric(I1_bar, c):
    """W without U [Pa]; c = (C10, C20, C30, K)."""
    x = I1_bar - 3.0
    return (c[0] + (c[1] + c[2] * x) * x) * x


@leaf
def slope(I1_bar, c):
    """dW/dI1_bar [Pa]."""
    x = I1_bar - 3.0
    return c[0] + (2.0 * c[1] + 3.0 * c[2] * x) * x
