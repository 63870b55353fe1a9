"""Points on the surface of a mesh with their tributary areas, for springs, pressures and ties.

Two by two Gauss points on every piece of a face: the held area is then that of the mesh's own surface, and a force per
area on it is shared among the nodes as the shape functions ask.
"""

from __future__ import annotations

import numpy as np

from explicitfe.fem.mesh.hexmesh import CORNERS, FACES, HexMesh, MaterialPoints, free_faces, shape_functions, shape_gradients
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.kept import kept

# Natural coordinates of the four points, in each of the two directions; every weight is 1.
_GAUSS = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]) / np.sqrt(3.0)
# Pieces of a face along a radius, and the most along a face: a smaller radius has too few points to be even.
_PIECES_PER_RADIUS, _MOST_PIECES = 4.0, 64


def points_on_pieces(
    element: np.ndarray, corners: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[MaterialPoints, np.ndarray]:
    """Two by two Gauss points on rectangular pieces of the faces of elements.

    Parameters
    ----------
    element : (k,) the element of each piece.
    corners : (k, 8, 3) m. Its corners.
    lower, upper : (k, 3) Natural coordinates of the bounds of each piece; the same along one axis, where it is flat.

    Returns
    -------
    The 4 k points, piece after piece, and their areas (4 k,), m^2.
    """
    half = 0.5 * (upper - lower)
    flat = np.argmin(half, axis=1)
    across = np.array([[1, 2], [0, 2], [0, 1]])[flat]
    row = np.arange(len(element))[:, None]
    natural = np.repeat(0.5 * (lower + upper)[:, None], len(_GAUSS), axis=1)
    for k in (0, 1):
        axis = across[:, [k]]
        natural[row, np.arange(len(_GAUSS)), axis] += _GAUSS[:, k] * half[row, axis]
    natural = natural.reshape(-1, 3)

    corners = np.repeat(corners, len(_GAUSS), axis=0)
    tangents = np.einsum("pai,pac->pci", corners, shape_gradients(natural))
    first, second = np.repeat(across, len(_GAUSS), axis=0).T
    point = np.arange(len(natural))
    normal = np.cross(tangents[point, first], tangents[point, second])
    share = np.repeat(half[row, across].prod(axis=1), len(_GAUSS))
    points = MaterialPoints(
        element=np.repeat(element, len(_GAUSS)),
        natural=natural,
        position=np.einsum("pa,pai->pi", shape_functions(natural), corners),
    )
    return points, share * np.linalg.norm(normal, axis=1)


def points_on_faces(mesh: HexMesh, element: np.ndarray, face: np.ndarray, cuts: int = 1) -> tuple[MaterialPoints, np.ndarray]:
    """Gauss points on faces of elements, each cut into ``cuts`` by ``cuts`` pieces, with their areas, m^2; face after face.

    Parameters
    ----------
    element, face : (k,) as :func:`explicitfe.fem.mesh.hexmesh.free_faces` gives them.
    """
    bounds = CORNERS[FACES[face]]
    low, high = bounds.min(axis=1), bounds.max(axis=1)
    across = np.array([[1, 2], [0, 2], [0, 1]])[np.argmin(high - low, axis=1)]
    row = np.arange(len(element))
    index = np.zeros((len(element), cuts * cuts, 3))
    for axis, count in zip(across.T, np.indices((cuts, cuts)).reshape(2, -1), strict=True):
        index[row, :, axis] = count
    number = np.repeat(row, cuts * cuts)
    step = (high - low) / cuts
    lower = low[number] + index.reshape(-1, 3) * step[number]
    element = element[number]
    return points_on_pieces(element, mesh.points[mesh.hexes[element]], lower, lower + step[number])


def points_on_set(mesh: HexMesh, name: str) -> tuple[MaterialPoints, np.ndarray]:
    """Points on the faces of the surface whose four nodes belong to a node set, with their areas (k,), m^2.

    Raises
    ------
    InputError
        The mesh has no such set, or the set covers no face.
    """
    nodes = mesh.nodes_of(name)
    element, face = free_faces(mesh.hexes)
    inside = np.isin(mesh.hexes[element[:, None], FACES[face]], nodes).all(axis=1)
    element, face = element[inside], face[inside]
    if not len(element):
        raise InputError(
            f'the node set "{name}" contains no complete face of the surface, so it has no area; '
            "include all four nodes of each face."
        )
    return points_on_faces(mesh, element, face)


def surface_within(mesh: HexMesh, place: np.ndarray, radius_m: float) -> tuple[MaterialPoints, np.ndarray]:
    """Points on the surface within a distance of a place (3,) m, with their areas (k,), m^2.

    Faces are cut into pieces of about a quarter of the radius, so that the area hardly depends on the mesh.
    """
    element, face = free_faces(mesh.hexes)
    corners = mesh.points[mesh.hexes[element[:, None], FACES[face]]]
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    # a face within the radius has a corner that is no farther than the radius and its own size
    near = np.linalg.norm(corners - place, axis=2).min(axis=1) <= radius_m + size
    element, face, size = element[near], face[near], size[near]
    if not len(element):
        return MaterialPoints(element, np.zeros((0, 3)), np.zeros((0, 3))), np.zeros(0)
    cuts = min(int(np.ceil(_PIECES_PER_RADIUS * size.max() / radius_m)), _MOST_PIECES)
    points, areas = points_on_faces(mesh, element, face, cuts)
    inside = np.linalg.norm(points.position - place, axis=1) <= radius_m
    return MaterialPoints(points.element[inside], points.natural[inside], points.position[inside]), areas[inside]


@kept(8)
def surface_areas(mesh: HexMesh) -> np.ndarray:
    """The area of the surface that belongs to each node, (n,) m^2: a quarter of each face that it is a corner of."""
    element, face = free_faces(mesh.hexes)
    corners = mesh.hexes[element[:, None], FACES[face]]
    x = mesh.points[corners]
    areas = 0.5 * np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), axis=1)
    return np.bincount(corners.ravel(), np.repeat(areas / 4.0, 4), mesh.node_count)


def surface_normals(mesh: HexMesh, points: MaterialPoints) -> np.ndarray:
    """Outward unit normals (k, 3) at points on the surface: that of the face of its element on which a point lies."""
    axis = np.argmax(np.abs(points.natural), axis=1)
    row = np.arange(len(axis))
    side = np.sign(points.natural[row, axis])
    tangents = np.einsum("pai,pac->pci", mesh.points[mesh.hexes[points.element]], shape_gradients(points.natural))
    normal = np.cross(tangents[row, (axis + 1) % 3], tangents[row, (axis + 2) % 3]) * side[:, None]
    return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


@kept(8)
def projected_areas(mesh: HexMesh) -> np.ndarray:
    """Area of the silhouette that belongs to each node along x, y and z, (n, 3) m^2: half of the absolute areas around it.

    The areas of all nodes of a convex body add up to its silhouette.
    """
    element, face = free_faces(mesh.hexes)
    corners = mesh.hexes[element[:, None], FACES[face]]
    x = mesh.points[corners]
    areas = 0.5 * np.abs(0.5 * np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]))
    nodes = corners.ravel()
    return np.stack([np.bincount(nodes, np.repeat(areas[:, k] / 4.0, 4), mesh.node_count) for k in range(3)], axis=1)


def outline(mesh: HexMesh) -> np.ndarray:
    """Edges (e, 2, 3) m of the surface at which two faces meet at more than 30 degrees, for simple drawings of a body."""
    element, face = free_faces(mesh.hexes)
    corners = mesh.hexes[element[:, None], FACES[face]]
    x = mesh.points[corners]
    normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    pairs, owner = edges[order], np.repeat(np.arange(len(corners)), 4)[order]
    twin = np.flatnonzero((pairs[1:] == pairs[:-1]).all(axis=1))
    sharp = np.sum(normal[owner[twin]] * normal[owner[twin + 1]], axis=1) < np.cos(np.radians(30.0))
    return np.asarray(mesh.points[pairs[twin[sharp]]])
