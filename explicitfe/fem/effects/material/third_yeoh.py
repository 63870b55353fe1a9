"""Third term of the Yeoh law: W + C30 (I1_bar - 3)^3, stiffening at large strain (Yeoh 1993, eq. 6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, number
from explicitfe.platform.compiled.jit import Template

AT = MEMORY = 0


class ThirdYeoh(MaterialEffect):
    """Third Yeoh constant."""

    about: ClassVar[Description] = Description(
        title="third Yeoh term",
        equation="W + C30 (I1_bar - 3)^3",
        source="Yeoh (1993) Rubber Chem. Technol. 66:754-771, eq. 6",
        where="material",
        strength="C30 (Pa)",
        plausible=1000.0,
        needs="strains above about 0.4",
        neighbours="fibres (other directions), layer (small strains too), base friction (another radius)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"C30_Pa": Sought((0.1, 0.5, 2.0), 0.0, 50.0, scale="third_Pa")}
    C30_Pa: float = Field(ge=0.0, description="third Yeoh constant [Pa]")

    @property
    def strength(self) -> float:
        return self.C30_Pa

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"stiffen": stiffen}

    def values(self, increment_s: float) -> tuple[float, ...]:
        return (self.C30_Pa,)


def stiffen(I1_bar, blocks, block):
    """What is added to dW/dI1_bar, and to W [Pa]."""
    x = I1_bar - 3.0
    c = number(blocks, block, AT)
    return 3.0 * c * x * x, c * x * x * x
