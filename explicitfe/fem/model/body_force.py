"""A force per volume as forces on nodes."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.elements import hex8
from explicitfe.fem.mesh.checked_arrays import number_array
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.model import NodalLoad
from explicitfe.fem.model.profile import Profile


def body_force(mesh: HexMesh, name: str, force_N_m3: np.ndarray, profile: Profile | None = None) -> NodalLoad:
    """A body force of fixed direction, as a field over the elements.

    Parameters
    ----------
    mesh : the body.
    name : of the load, for messages.
    force_N_m3 : (m, 3) force per volume at rest in each element at profile value 1, N/m^3.
    profile : activation profile; constant if left out.

    Returns
    -------
    The load, for ``Model(loads=(...,))``. Each element gives an eighth of its force to each of its nodes, as of its mass.

    Raises
    ------
    InputError : an array of another shape, or a number that is not finite.
    """
    density = number_array("body_force: force_N_m3", force_N_m3, (mesh.element_count, 3))
    volumes = hex8.geometry(mesh.points[mesh.hexes])[:, hex8.VOLUME]
    force = np.stack([hex8.lumped_mass(mesh.hexes, volumes * density[:, k], mesh.node_count) for k in range(3)], axis=1)
    return NodalLoad(name, np.arange(mesh.node_count), force, Profile.constant() if profile is None else profile)
