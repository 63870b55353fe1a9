"""The weight of a body as forces on its nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.elements import hex8
from explicitfe.materials import Law
from explicitfe.mesh.hexmesh import HexMesh
from explicitfe.model.model import NodalLoad
from explicitfe.model.profile import Profile


def gravity_load(mesh: HexMesh, material: Law, acceleration_m_s2: Sequence[float]) -> NodalLoad:
    """The lumped mass of every node times the acceleration (x, y, z) m/s^2, constant in time."""
    volumes = hex8.geometry(mesh.points[mesh.hexes])[:, hex8.VOLUME]
    mass = hex8.lumped_mass(mesh.hexes, volumes * material.density_kg_m3, mesh.node_count)
    force = mass[:, None] * np.array(acceleration_m_s2)
    return NodalLoad("gravity", np.arange(mesh.node_count), force, Profile.constant())
