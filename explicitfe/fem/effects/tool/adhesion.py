"""Adhesion: the tool holds what touches it, with a stress that falls to nothing within a reach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import ModelT, tool_of
from explicitfe.fem.effects.effect import Description, Effect, Sought


class Adhesion(Effect):
    """Strength and reach of a cohesive contact."""

    about: ClassVar[Description] = Description(
        title="adhesion of the tool",
        equation="pull = s (1 - gap / reach) for 0 < gap < reach, s in contact",
        source="linear softening cohesive law (Hillerborg, Modeer & Petersson 1976)",
        where="contact",
        strength="s (Pa)",
        plausible=500.0,
        needs="a pull-off test: unload until the tool detaches and record the negative force",
        neighbours="force-offset (there from the start), viscoelastic",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "stress_Pa": Sought((0.02, 0.1, 0.4), 0.0, 1.0, scale="pressure_Pa"),
        "reach_mm": Sought((0.03, 0.15), 0.005, 0.5, scale="displacement_mm", kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("tool", "force that pulls")
    acts_on = "tool"
    in_revolution = False
    depends_on_path = True
    stress_Pa: float = Field(ge=0.0, description="largest pull [Pa]")
    reach_mm: float = Field(default=0.2, gt=0.0, description="gap at which nothing is left of it [mm]")

    @property
    def strength(self) -> float:
        return self.stress_Pa

    def apply(self, model: ModelT) -> ModelT:
        return replace(model, tool=replace(tool_of(model), adhesion_Pa=self.stress_Pa, reach_m=1e-3 * self.reach_mm))
