"""Poisson's ratio below that of the model: the tissue loses volume under pressure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from explicitfe.effects.affected import LawT, ModelT
from explicitfe.effects.effect import Description, Effect, Sought


class Compressible(Effect):
    """Poisson's ratio, instead of that of the material."""

    about: ClassVar[Description] = Description(
        title="compressible tissue",
        equation="K = 2 G (1 + nu) / (3 (1 - 2 nu))",
        source="linear elasticity",
        where="material",
        strength="1 - 2 nu",
        plausible=0.4,
        needs="a wide and a narrow tool on a thin layer; with one tool it is mistaken for another C10",
        neighbours="C10 itself, drainage (needs time), layer",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"poisson": Sought((0.49, 0.47, 0.4), 0.2, 0.499, none=0.499)}
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    acts_on = "material"
    pointwise = True
    without_tool = True
    poisson: float = Field(ge=0.0, lt=0.5, description="Poisson's ratio")

    @property
    def strength(self) -> float:
        return 1.0 - 2.0 * self.poisson

    def in_law(self, law: LawT) -> LawT:
        return law.model_copy(update={"poisson": self.poisson})

    def apply(self, model: ModelT) -> ModelT:
        return replace(model, material=self.in_law(model.material))
