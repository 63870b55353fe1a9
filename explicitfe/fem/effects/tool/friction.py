"""Friction between tool and tissue (Coulomb), up to sticking."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import SpecimenT, ToolT
from explicitfe.fem.effects.effect import Description, Effect, Sought


class Friction(Effect):
    """Coulomb's coefficient."""

    about: ClassVar[Description] = Description(
        title="friction of the tool",
        equation="|t| <= mu p",
        source="Coulomb",
        where="contact",
        strength="mu",
        plausible=1.0,
        needs="unloading (a loop at the first cycle), or two tool radii",
        neighbours="softening (no loop before the first maximum), C20 (stiffens alike), base-slip",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"coefficient": Sought((0.1, 0.3, 1.0), 0.0, 1.0)}
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    acts_on = "tool"
    depends_on_path = True
    coefficient: float = Field(ge=0.0, le=1.0, description="coefficient; at 1 next to nothing slips")

    @property
    def strength(self) -> float:
        return self.coefficient

    def prepare(self, specimen: SpecimenT, tool: ToolT) -> tuple[SpecimenT, ToolT]:
        return specimen, tool.model_copy(update={"friction": self.coefficient})
