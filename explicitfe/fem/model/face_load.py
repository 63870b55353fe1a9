"""A force on a face of a body, distributed over its nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.inputs.argument import vector
from explicitfe.fem.inputs.bounds import bounds_of
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh
from explicitfe.fem.model.model import NodalLoad
from explicitfe.fem.model.profile import Profile
from explicitfe.platform.errors import InputError, shortened


def face_load(mesh: HexMesh, name: str, force_N: Sequence[float], profile: Profile | None = None) -> NodalLoad:
    """A uniform traction of fixed direction on a face, as forces on its nodes.

    Parameters
    ----------
    mesh : the body.
    name : node set with the nodes of the face.
    force_N : (3,) resultant force at profile value 1, N.
    profile : activation profile; constant if left out.

    Returns
    -------
    The load, for ``Model(loads=(...,))``. Each face of an element gives a quarter of its share to each of its corners.

    Raises
    ------
    InputError : the mesh has no such set, its nodes make up no face of an element, or ``force_N`` is not three finite numbers.
    """
    _check_mesh(mesh)
    force = vector("face_load: force_N", force_N, bounds_of("force_N").largest)
    nodes = mesh.nodes_of(name)
    faces = mesh.hexes[:, FACES].reshape(-1, 4)
    faces = faces[np.isin(faces, nodes).all(axis=1)]
    if not len(faces):
        raise InputError(
            f'face_load: the node set "{name}" contains no complete face of an element; name another set, such as "x1" of a box.'
        )
    corners = mesh.points[faces]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
    share = np.bincount(faces.ravel(), np.repeat(areas / 4.0, 4), mesh.node_count)[nodes] / areas.sum()
    return NodalLoad(name, nodes, share[:, None] * np.array(force), Profile.constant() if profile is None else profile)


def _check_mesh(mesh: object) -> None:
    if not isinstance(mesh, HexMesh):
        raise InputError(f"face_load: mesh must be a HexMesh, not {shortened(repr(mesh))}.")
