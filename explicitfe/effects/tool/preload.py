"""A preload: the zero of displacement is not first touch but where the tool bore this force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from pydantic import Field

from explicitfe.effects.effect import Description, Effect, Sought


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
    force_N: float = Field(ge=0.0, description="force at displacement 0 [N]")

    @property
    def strength(self) -> float:
        return self.force_N

    def apply(self, model: Any) -> Any:
        return replace(model, tool=replace(model.tool, preload_N=self.force_N))
