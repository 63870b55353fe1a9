"""A force on a face of a body, shared out over its nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.errors import InputError
from explicitfe.mesh.hexmesh import FACES, HexMesh
from explicitfe.model.model import NodalLoad
from explicitfe.model.profile import Profile


def face_load(mesh: HexMesh, name: str, force_N: Sequence[float], profile: Profile | None = None) -> NodalLoad:
    """A force spread evenly over a face: a uniform traction of fixed direction.

    Parameters
    ----------
    mesh : the body.
    name : node set that holds the nodes of the face.
    force_N : (3,) N, the whole force.
    profile : its course in time; on all the time if left out.

    Raises
    ------
    InputError : the mesh has no such set, or its nodes are no face of any element.
    """
    nodes = mesh.nodes_of(name)
    faces = mesh.hexes[:, FACES].reshape(-1, 4)
    faces = faces[np.isin(faces, nodes).all(axis=1)]
    if not len(faces):
        raise InputError(f'the node set "{name}" holds no whole face of an element; a force cannot be spread over it.')
    corners = mesh.points[faces]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
    share = np.bincount(faces.ravel(), np.repeat(areas / 4.0, 4), mesh.node_count)[nodes] / areas.sum()
    return NodalLoad(name, nodes, share[:, None] * np.asarray(force_N, dtype=float), profile or Profile.constant())
