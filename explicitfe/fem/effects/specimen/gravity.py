"""Weight of the tissue: the specimen sags before it is touched, and what is pushed aside is lifted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import SpecimenT, ToolT
from explicitfe.fem.effects.effect import Description, Effect, Sought


class Gravity(Effect):
    """Acceleration along -z."""

    about: ClassVar[Description] = Description(
        title="gravity",
        equation="f = rho g",
        source="-",
        where="loading",
        strength="g (m/s^2)",
        plausible=9.81,
        needs="the density, and specimens of two heights",
        neighbours="C10 itself, preload",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"acceleration_m_s2": Sought((9.81,), 0.0, 12.0)}
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    acts_on = "specimen"
    acceleration_m_s2: float = Field(default=9.81, ge=0.0, description="acceleration [m/s^2]")

    @property
    def strength(self) -> float:
        return self.acceleration_m_s2

    def prepare(self, specimen: SpecimenT, tool: ToolT) -> tuple[SpecimenT, ToolT]:
        return specimen.model_copy(update={"gravity_m_s2": (0.0, 0.0, -self.acceleration_m_s2)}), tool
