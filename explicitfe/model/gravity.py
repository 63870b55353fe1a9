"""The weight of a body as forces on its nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.elements import hex8
from explicitfe.materials import Law
from explicitfe.mesh.hexmesh import HexMesh
from explicitfe.model.model import Inclusion, NodalLoad
from explicitfe.model.profile import Profile


def gravity_load(
    mesh: HexMesh, material: Law, acceleration_m_s2: Sequence[float], inclusions: Sequence[Inclusion] = ()
) -> NodalLoad:
    """The lumped mass of every node times the acceleration (x, y, z) m/s^2, constant in time.

    ``inclusions`` are elements of other tissues, whose density counts there.
    """
    volumes = hex8.geometry(mesh.points[mesh.hexes])[:, hex8.VOLUME]
    density = np.full(mesh.element_count, material.density_kg_m3)
    for part in inclusions:
        density[part.elements] = part.material.density_kg_m3
    mass = hex8.lumped_mass(mesh.hexes, volumes * density, mesh.node_count)
    force = mass[:, None] * np.array(acceleration_m_s2)
    return NodalLoad("gravity", np.arange(mesh.node_count), force, Profile.constant())
