"""A base that is not bonded: it gives way sideways, traction = displacement / compliance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.affected import AffectedModel, ModelT
from explicitfe.fem.effects.effect import Description, Effect, Sought
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.platform.compiled.arrays import Springs


class BaseSlip(Effect):
    """Sideways compliance of the base."""

    about: ClassVar[Description] = Description(
        title="slip of the base",
        equation="t = -u / c, u sideways at the base",
        source="Winkler support",
        where="boundary",
        strength="c (mm/kPa)",
        plausible=100.0,
        needs="two heights, or two tool radii",
        neighbours="C10 itself, stiffness-gradient, compressible",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"compliance_mm_kPa": Sought((0.03, 0.2, 1.0), 0.0, 30.0, scale="slip_mm_kPa")}
    requires: ClassVar[tuple[str, ...]] = ("tool", "bonded base")
    acts_on = "specimen"
    compliance_mm_kPa: float = Field(ge=0.0, description="displacement of the base per sideways stress [mm/kPa]; 0 is bonded")

    @property
    def strength(self) -> float:
        return self.compliance_mm_kPa

    @property
    def base_compliance_m_Pa(self) -> float:
        return 1e-6 * self.compliance_mm_kPa

    def apply(self, model: ModelT) -> ModelT:
        if self.compliance_mm_kPa == 0.0:
            return model
        mesh, held = model.mesh, model.held.copy()
        base = np.flatnonzero(mesh.points[:, 2] == mesh.points[:, 2].min())
        area = _areas(mesh, base)
        stiffness = np.zeros((len(base), 3))
        turned = np.zeros(mesh.node_count, dtype=bool)
        if model.sector is not None:
            np.add.at(area, model.sector.partners, area[model.sector.nodes])
            turned[model.sector.nodes] = True
        middle = np.hypot(mesh.points[:, 0], mesh.points[:, 1]) == 0.0
        for axis in (0, 1):
            by_symmetry = _by_symmetry(model, axis)
            free = ~by_symmetry[base] & ~middle[base] & ~turned[base]
            held[base[free], axis] = False
            stiffness[free, axis] = area[base][free] / (1e-6 * self.compliance_mm_kPa)
        return replace(model, held=held, support=Springs(base, stiffness))


def _by_symmetry(model: AffectedModel, axis: int) -> np.ndarray:
    """Nodes whose component is held by a plane of symmetry: those of the plane, if its nodes above the base are held too."""
    mesh = model.mesh
    plane = np.abs(mesh.points[:, axis]) < 1e-12
    above = plane & (mesh.points[:, 2] > mesh.points[:, 2].min())
    return plane & bool(model.held[above, axis].all()) if above.any() else np.zeros(mesh.node_count, dtype=bool)


def _areas(mesh: HexMesh, base: np.ndarray) -> np.ndarray:
    """Area of the base that each node stands for [m^2], (n,)."""
    inside = np.zeros(mesh.node_count, dtype=bool)
    inside[base] = True
    faces = mesh.hexes[:, :4]
    faces = faces[inside[faces].all(axis=1)]
    x, y = mesh.points[faces][..., 0], mesh.points[faces][..., 1]
    area = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    return np.bincount(faces.ravel(), np.repeat(area / 4.0, 4), mesh.node_count)
