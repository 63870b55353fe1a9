"""Neo-Hooke: W = C10 (I1_bar - 3) + U(J) (Rivlin 1948), the simplest law of rubber elasticity."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from explicitfe.fem.materials.law import Law
from explicitfe.platform.compiled.jit import leaf


class NeoHooke(Law):
    """Constant of the neo-Hooke law; the initial shear modulus is 2 C10."""

    reads: ClassVar[tuple[str, ...]] = ("C10_Pa",)

    law: Literal["neo-hooke"] = "neo-hooke"
    C10_Pa: float = Field(gt=0.0, description="half the shear modulus [Pa]")

    @property
    def shear_modulus_Pa(self) -> float:
        return 2.0 * self.C10_Pa


@leaf
def isochoric(I1_bar, c):
    """W without U [Pa]; c = (C10, K)."""
    return c[0] * (I1_bar - 3.0)


@leaf
def slope(I1_bar, c):
    """dW/dI1_bar [Pa]."""
    return c[0] + 0.0 * I1_bar
