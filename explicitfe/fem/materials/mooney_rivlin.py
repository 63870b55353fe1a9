"""Mooney-Rivlin: W = C10 (I1_bar - 3) + C01 (I2_bar - 3) + U(J) (Mooney 1940; Rivlin & Saunders 1951)."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from explicitfe.fem.materials.law import Law
from explicitfe.platform.compiled.jit import leaf


class MooneyRivlin(Law):
    """Constants of the two-parameter Mooney-Rivlin law; the initial shear modulus is 2 (C10 + C01)."""

    invariants: ClassVar[tuple[str, ...]] = ("I1", "I2")
    reads: ClassVar[tuple[str, ...]] = ("C10_Pa", "C01_Pa")

    law: Literal["mooney-rivlin"] = "mooney-rivlin"
    C10_Pa: float = Field(gt=0.0, description="constant of the first invariant [Pa]")
    C01_Pa: float = Field(ge=0.0, description="constant of the second invariant [Pa]")

    @property
    def shear_modulus_Pa(self) -> float:
        return 2.0 * (self.C10_Pa + self.C01_Pa)


@leaf
def isochoric(I1_bar, I2_bar, c):
    """W without U [Pa]; c = (C10, C01, K)."""
    return c[0] * (I1_bar - 3.0) + c[1] * (I2_bar - 3.0)


@leaf
def slopes(I1_bar, I2_bar, c):
    """dW/dI1_bar and dW/dI2_bar [Pa]."""
    return c[0] + 0.0 * I1_bar, c[1] + 0.0 * I2_bar
