"""A preload: the zero of displacement is not first touch but where the tool bore this force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, Self

from pydantic import Field

from explicitfe.fem.effects.affected import ModelT, tool_of
from explicitfe.fem.effects.effect import Conditions, Description, Effect, Rig, Sought


class Preload(Effect):
    """Force of the tool where displacements begin to count."""

    about: ClassVar[Description] = Description(
        title="preload",
        equation="d = 0 where F = F0",
        source="-",
        where="loading",
        strength="F0 (N)",
        plausible=0.05,
        needs="the raw force at the first row",
        neighbours="contact-offset, force-offset",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"force_N": Sought((0.005, 0.02, 0.08), 0.0, 0.3, scale="force_N")}
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    acts_on = "tool"
    pointwise = True
    force_N: float = Field(ge=0.0, description="force at displacement 0 [N]")

    @property
    def strength(self) -> float:
        return self.force_N

    def apply(self, model: ModelT) -> ModelT:
        return replace(model, tool=replace(tool_of(model), preload_N=self.force_N))

    def on_rig(self, rig: Rig) -> Rig:
        return replace(rig, preload_N=self.force_N)

    @classmethod
    def stated_in(cls, conditions: Conditions) -> Self | None:
        """Its force is that of each test, see ``in_test``."""
        return cls(force_N=0.0) if "preload_N" in conditions else None

    def in_test(self, conditions: Conditions) -> Self:
        """With the force that was measured, where one was."""
        if "preload_N" not in conditions:
            return self
        return self.model_copy(update={"force_N": max(float(str(conditions["preload_N"])), 0.0)})
