"""Muscle force that rises in time: tau df/dt + f = command, instead of the command itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import ModelT
from explicitfe.fem.effects.effect import Description, Effect, Sought


class ActivationLag(Effect):
    """Time constant of a first-order rise."""

    about: ClassVar[Description] = Description(
        title="activation lag",
        equation="tau df/dt + f = command",
        source="first-order activation dynamics (Zajac 1989, section III)",
        where="loading",
        strength="tau (ms)",
        plausible=100.0,
        needs="a trajectory from its onset",
        neighbours="damping, viscoelastic (act on the way back too)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"tau_ms": Sought((5.0, 20.0, 60.0), 0.0, 300.0)}
    requires: ClassVar[tuple[str, ...]] = ("muscles",)
    acts_on = "muscle"
    tau_ms: float = Field(ge=0.0, description="time constant [ms]")

    @property
    def strength(self) -> float:
        return self.tau_ms

    @property
    def transient(self) -> bool:
        return self.tau_ms > 0.0

    def apply(self, model: ModelT) -> ModelT:
        if self.tau_ms == 0.0:
            return model
        tau = 1e-3 * self.tau_ms
        muscles = [load for load in model.loads if load.of_muscle]
        lagged = {id(load): replace(load, profile=replace(load.profile, lag_s=tau)) for load in muscles}
        return replace(
            model,
            loads=tuple(lagged.get(id(load), load) for load in model.loads),
            pulls=tuple(replace(pull, profile=replace(pull.profile, lag_s=tau)) for pull in model.pulls),
            stresses=tuple(replace(stress, profile=replace(stress.profile, lag_s=tau)) for stress in model.stresses),
        )
