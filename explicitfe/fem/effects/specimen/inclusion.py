"""An inclusion: a ball inside the specimen, below the tool, that is softer or stiffer than what is around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.affected import ModelT
from explicitfe.fem.effects.effect import Description, Effect, Sought
from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh

# An element's share of the ball is counted on a grid of so many points along each of its edges.
POINTS_PER_EDGE = 4


class InclusionBelowTool(Effect):
    """Stiffness, size and depth of a ball on the axis of the tool."""

    about: ClassVar[Description] = Description(
        title="inclusion below the tool",
        equation="moduli x ratio where |x - centre| < radius",
        source="geometry; an element across the surface has the mean of the moduli (Voigt)",
        where="specimen",
        strength="log of the ratio",
        plausible=3.0,
        needs="two tool radii, or depths that reach from the surface to the inclusion",
        neighbours="layer (at the surface), stiffness-gradient, third-yeoh",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "ratio": Sought((0.5, 0.15, 2.0, 6.0), 0.02, 50.0, kind="log", none=1.0),
        "radius_mm": Sought((0.25,), 0.05, 0.45, scale="height_mm", kind="log"),
        "depth_mm": Sought((0.4,), 0.1, 0.8, scale="height_mm", kind="log"),
    }
    variant_of: ClassVar[str] = "stiffness-gradient"
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    acts_on = "specimen"
    ratio: float = Field(gt=0.0, description="its moduli relative to the tissue around it")
    radius_mm: float = Field(gt=0.0, description="radius of the ball [mm]")
    depth_mm: float = Field(gt=0.0, description="depth of its centre below the surface [mm]")

    @property
    def strength(self) -> float:
        return self.ratio - 1.0

    def stiffness_at(self, r_m: np.ndarray, depth_m: np.ndarray, height_m: float, spread_m: np.ndarray) -> np.ndarray:
        inside = 1e-3 * self.radius_mm - np.hypot(r_m, depth_m - 1e-3 * self.depth_mm)
        return 1.0 + (self.ratio - 1.0) * np.clip(0.5 + inside / spread_m, 0.0, 1.0)

    def apply(self, model: ModelT) -> ModelT:
        mesh = model.mesh
        centre = np.array([0.0, 0.0, mesh.points[:, 2].max() - 1e-3 * self.depth_mm])
        share = _share_inside(mesh, centre, 1e-3 * self.radius_mm)
        factor = 1.0 + (self.ratio - 1.0) * share
        return replace(model, stiffness=factor if model.stiffness is None else factor * np.asarray(model.stiffness))


def _share_inside(mesh: HexMesh, centre: np.ndarray, radius_m: float) -> np.ndarray:
    """Share of each element (m,) that lies in a ball, by points spread evenly over its reference cube."""
    places = (2.0 * np.arange(POINTS_PER_EDGE) + 1.0) / POINTS_PER_EDGE - 1.0
    inside = np.zeros(len(mesh.hexes))
    for place in np.stack(np.meshgrid(places, places, places), axis=-1).reshape(-1, 3):
        weights = np.prod(1.0 + place * CORNERS, axis=1) / 8.0
        points = np.einsum("c,mci->mi", weights, mesh.points[mesh.hexes])
        inside += np.linalg.norm(points - centre, axis=1) < radius_m
    return inside / POINTS_PER_EDGE**3
