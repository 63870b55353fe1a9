"""Moduli that change with depth: factor 1 + g (1 - 2 z / height) from 1 - g at the surface to 1 + g at the base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.affected import ModelT
from explicitfe.fem.effects.effect import Description, Effect, Sought


class StiffnessGradient(Effect):
    """Relative change of the moduli with depth."""

    about: ClassVar[Description] = Description(
        title="stiffness gradient with depth",
        equation="moduli x (1 + g (1 - 2 z / height))",
        source="-",
        where="specimen",
        strength="g",
        plausible=0.8,
        needs="two tool radii, or two heights",
        neighbours="layer, base-slip",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"g": Sought((-0.3, -0.7, 0.3, 0.7), -0.9, 0.9)}
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    acts_on = "specimen"
    g: float = Field(gt=-1.0, lt=1.0, description="stiffer below (positive) or above (negative)")

    @property
    def strength(self) -> float:
        return self.g

    def stiffness_at(self, r_m: np.ndarray, depth_m: np.ndarray, height_m: float, spread_m: np.ndarray) -> np.ndarray:
        return 1.0 + self.g * (2.0 * depth_m / height_m - 1.0)

    def apply(self, model: ModelT) -> ModelT:
        mesh = model.mesh
        z = mesh.points[mesh.hexes].mean(axis=1)[:, 2]
        low, high = mesh.points[:, 2].min(), mesh.points[:, 2].max()
        factor = 1.0 + self.g * (1.0 - 2.0 * (z - low) / (high - low))
        return replace(model, stiffness=factor if model.stiffness is None else factor * np.asarray(model.stiffness))
