"""The weight of a body as forces on its nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.elements import hex8
from explicitfe.fem.inputs.argument import vector
from explicitfe.fem.inputs.bounds import bounds_of
from explicitfe.fem.materials import Law
from explicitfe.fem.mesh.checked_arrays import check_range
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.attached import AttachedMass
from explicitfe.fem.model.model import Inclusion, NodalLoad
from explicitfe.fem.model.profile import Profile
from explicitfe.platform.errors import InputError, shortened


def gravity_load(
    mesh: HexMesh,
    material: Law,
    acceleration_m_s2: Sequence[float],
    inclusions: Sequence[Inclusion] = (),
    masses: Sequence[AttachedMass] = (),
) -> NodalLoad:
    """Weight of a body: the lumped mass of every node times an acceleration, constant in time.

    Parameters
    ----------
    mesh : the body.
    material : its constants, with the density.
    acceleration_m_s2 : (3,) acceleration along x, y and z, m/s^2, such as (0.0, 0.0, -9.81).
    inclusions : elements of other tissues, with their own density.
    masses : masses that are fixed to nodes.

    Returns
    -------
    The load, for ``Model(loads=(...,))``.

    Raises
    ------
    InputError : an argument of another type, or an acceleration above 10 000 m/s^2.
    """
    if not isinstance(mesh, HexMesh):
        raise InputError(f"gravity_load: mesh must be a HexMesh, not {shortened(repr(mesh))}.")
    if not isinstance(material, Law):
        raise InputError(f"gravity_load: material must hold the constants of a law, not {shortened(repr(material))}.")
    acceleration = vector("gravity_load: acceleration_m_s2", acceleration_m_s2, bounds_of("acceleration_m_s2").largest)
    for part in inclusions:
        check_range("gravity_load: inclusions", part.elements, mesh.element_count, "element")
    mass = nodal_mass(mesh, material, inclusions)
    for extra in masses:
        np.add.at(mass, extra.nodes, extra.mass_kg)
    force = mass[:, None] * np.array(acceleration)
    heaviest, largest = float(np.abs(force).max()), bounds_of("force_N").largest
    if heaviest > largest:
        extent_mm = 1e3 * float(np.ptp(mesh.points, axis=0).max())
        raise InputError(
            f"gravity: the mesh is {extent_mm:.0f} mm long, and the weight at one of its nodes is {heaviest:.0f} N; the largest "
            f"permitted force is {largest:g} N. Check the unit of length of the mesh, and the density."
        )
    return NodalLoad("gravity", np.arange(mesh.node_count), force, Profile.constant())


def nodal_mass(mesh: HexMesh, material: Law, inclusions: Sequence[Inclusion] = ()) -> np.ndarray:
    """Lumped mass of the tissue at each node, (n,) kg."""
    volumes = hex8.geometry(mesh.points[mesh.hexes])[:, hex8.VOLUME]
    density = np.full(mesh.element_count, material.density_kg_m3)
    for part in inclusions:
        density[part.elements] = part.material.density_kg_m3
    return hex8.lumped_mass(mesh.hexes, volumes * density, mesh.node_count)
