"""The free surfaces of a body as arrays for contact with each other."""

from __future__ import annotations

import numpy as np
import scipy

from explicitfe.fem.bones.surface import in_mm
from explicitfe.fem.forces.surface_search import find_touching_at_rest
from explicitfe.fem.materials.law import Law
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces, shape_functions
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.mesh.surface_points import points_on_faces, surface_areas
from explicitfe.fem.model.model import Model
from explicitfe.platform.compiled.contact_arrays import (
    ALIKE,
    CELLS,
    FACES_NEAR,
    FARTHEST,
    NUMBERS,
    REACH,
    RUBBING,
    SKIN,
    SPEED,
    STIFFER,
    TRIANGLES_NEAR,
    ZETA,
    Surfaces,
)
from explicitfe.platform.compiled.jit import kernel
from explicitfe.platform.errors import InputError

# How deep a point may lie below a face when it begins to touch it, in mean edges of that, and no deeper than its element is
# thick: behind that there may be other points of the same surface. And the skin, in mean edges of all.
DEEPEST_EDGES, SKIN_EDGES = 0.3, 0.2
# The contact stiffness times the edge is so many times Young's modulus, and no more than so many times the modulus of a pressure
# wave, which sets the stable step. Pressure over depth has doubled at so many edges.
STIFFNESS_SHARE, WAVE_SHARE, GROWTH_EDGES = 18.0, 4.5, 0.025
# How far a node may move in a step, as a share of the smallest depth at which a point may begin to touch.
FARTHEST_SHARE = 0.15
# Faces whose normals have a larger cosine are on opposite sides of a wall.
MOST_ALIKE = 0.5
# How many times deeper points are looked for at rest: tissue between two faces that is pressed to a quarter of its thickness
# does not touch itself. And the cosine of the normals of faces that face each other.
REST_DEEPER, MOST_OPPOSED = 4.0, -0.5
PIECES = 2  # along an edge of a face, each with two by two points
_NONE = np.zeros(0)


def surfaces_of(model: Model, place: np.ndarray, mass: np.ndarray) -> Surfaces:
    """Surfaces; without nodes where the model has no contact of surfaces.

    Parameters
    ----------
    place : (n,) row of each node in computing order.
    mass : (n,) kg.

    Raises
    ------
    InputError : two bodies overlap at rest.
    """
    contact, mesh = model.surfaces, model.mesh
    if contact is None:
        nobody = np.zeros(0, dtype=np.int64)
        nothing = np.zeros((0, 3))
        return _arrays(nobody, nobody, _NONE, nothing, np.zeros((0, 4)), nothing, nobody, [], np.zeros((0, 4)), _NONE, _NONE)
    element, face = free_faces(mesh.hexes)
    quads = mesh.hexes[element[:, None], FACES[face]]
    nodes = np.unique(quads)
    faces = np.searchsorted(nodes, quads)
    corners = mesh.points[quads]
    edges_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    numbers = np.zeros(NUMBERS)
    # A damper that takes the velocity before the step shortens the stable step to sqrt(1 + zeta^2) - zeta of that without it
    # (Belytschko et al. 2014, section 6.2.3), as if the spring were stiffer by the inverse square of that.
    stiffer = (np.sqrt(1.0 + contact.damping**2) + contact.damping) ** 2
    numbers[[SKIN, RUBBING, ALIKE]] = SKIN_EDGES * edges_m.mean(), contact.friction, MOST_ALIKE
    numbers[[ZETA, STIFFER]] = contact.damping, stiffer
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    thickness_m = volumes(mesh.points, mesh.hexes)[element] / (0.5 * np.linalg.norm(across, axis=1))
    edge_m = edges_m.mean(axis=1)
    deepest = np.minimum(DEEPEST_EDGES * edge_m, thickness_m)
    numbers[FARTHEST] = FARTHEST_SHARE * deepest.min()
    stiffness = model.in_elements(_contact_modulus)[element] / edge_m
    if contact.stiffness_Pa_m is not None:
        stiffness[:] = contact.stiffness_Pa_m
    of_faces = np.column_stack([deepest, stiffness, GROWTH_EDGES * edge_m])
    points, areas_m2 = points_on_faces(mesh, element, face, PIECES)
    per_face = len(areas_m2) // len(quads)
    share = np.take_along_axis(shape_functions(points.natural), FACES[np.repeat(face, per_face)], axis=1)
    # each of the points of a face moves with its share of the masses of the corners
    of_points = np.einsum("qc,qc->q", share, mass[np.repeat(quads, per_face, axis=0)]) / per_face
    rows = place[nodes].astype(np.int64)
    own = _own_faces(mesh, nodes, faces)
    area = surface_areas(mesh)[nodes]
    body = _bodies(mesh)[nodes[faces[:, 0]]].astype(np.int64)
    while True:
        halves = 0.5 * areas_m2
        surfaces = _arrays(rows, nodes, area, mesh.points[nodes], faces, of_faces, body, own, share, halves, of_points, numbers)
        behind = _behind_an_edge(surfaces, body, across)
        if not len(behind):
            break
        for one in np.unique(behind[:, 0]):
            own[one] = np.union1d(own[one], behind[behind[:, 0] == one, 1])
    _check_apart(mesh, nodes, surfaces)
    return surfaces


def highest_contact(surfaces: Surfaces, velocity: np.ndarray, inverse_mass: np.ndarray) -> float:
    """Bound of the square of the frequency of nodes that rest on another surface alone [1/s^2]; note the speed at the start.

    Parameters
    ----------
    velocity, inverse_mass : (N, 4) node rows [m/s], [1/kg].

    Notes
    -----
    The springs of the points around a node add up to its half of the pressure; the points of the other side are taken to be as
    stiff, and both bodies give way.
    """
    surfaces.numbers[SPEED] = np.linalg.norm(velocity[surfaces.node], axis=1).max(initial=0.0)
    stiffness = np.zeros(len(surfaces.node))
    springs = surfaces.part * surfaces.stiffness[surfaces.point_face]
    np.add.at(stiffness, surfaces.face[surfaces.point_face], springs[:, None] * surfaces.share)
    highest = (stiffness * inverse_mass[surfaces.node].max(axis=1)).max(initial=0.0)
    return float(4.0 * surfaces.numbers[STIFFER] * highest)


def state_of_contact(surfaces: Surfaces) -> np.ndarray:
    """What a restart needs: the faces that points touch, the numbers, and the depth of pairs of bodies since the last sample."""
    return np.concatenate([surfaces.held, surfaces.numbers, surfaces.pairs.ravel()])


def restore_contact(surfaces: Surfaces, state: np.ndarray) -> None:
    """Take over the result of ``state_of_contact``."""
    held, surfaces.numbers[:], pairs = np.split(state, [len(surfaces.held), len(surfaces.held) + NUMBERS])
    surfaces.held[:], surfaces.pairs[:] = held, pairs.reshape(surfaces.pairs.shape)


def _contact_modulus(tissue: Law) -> float:
    """Contact stiffness times the edge of an element [Pa]."""
    shear_Pa = tissue.shear_modulus_Pa
    wave_Pa = tissue.constants()[-1] + 4.0 / 3.0 * shear_Pa
    return min(STIFFNESS_SHARE * 2.0 * (1.0 + tissue.poisson) * shear_Pa, WAVE_SHARE * wave_Pa)


def _behind_an_edge(surfaces: Surfaces, part: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Faces (k, 2), of points and below these at rest, of one body, that do not face each other: there is a convex edge between.

    Such points do not touch, however far that face is. What comes so near later was at most REST_DEEPER times as deep at rest.
    """
    every = surfaces.numbers.copy()
    every[[ALIKE, REACH]] = np.inf
    touching, touched = _touching_faces(surfaces._replace(deepest=REST_DEEPER * surfaces.deepest, numbers=every))
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    facing = np.einsum("kx,kx->k", unit[touching], unit[touched]) < MOST_OPPOSED
    return np.unique(np.column_stack([touching, touched])[(part[touching] == part[touched]) & ~facing], axis=0)


def _touching_faces(surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
    """The faces whose points touch at rest, and those that they touch, (k,) each."""
    nodes = len(surfaces.node)
    unseen, nowhere = np.full((nodes, 3), np.nan), np.full(len(surfaces.held), -1)
    numbers = surfaces.numbers.copy()
    numbers[REACH] = np.inf
    at_rest = surfaces._replace(numbers=numbers, node=np.arange(nodes), seen=unseen, looked=unseen.copy(), held=nowhere)
    _touching_at(at_rest, np.zeros((nodes, 4)))
    count = int(surfaces.touches[0])
    return surfaces.point_face[surfaces.touching[:count]], surfaces.touched[:count].copy()


def _bodies(mesh: HexMesh) -> np.ndarray:
    """Which body each node belongs to, (n,)."""
    edges = mesh.hexes[:, [0, 1, 2, 3, 4, 5, 6, 0, 1, 2, 3]], mesh.hexes[:, [1, 2, 3, 0, 5, 6, 7, 4, 5, 6, 7]]
    ends = (np.ones(edges[0].size), (edges[0].ravel(), edges[1].ravel()))
    graph = scipy.sparse.coo_array(ends, shape=2 * (mesh.node_count,))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def _check_apart(mesh: HexMesh, nodes: np.ndarray, surfaces: Surfaces) -> None:
    """Refuse surfaces that touch at rest: what pushes there would set the body in motion."""
    touching, touched = _touching_faces(surfaces)
    count = len(touching)
    if not count:
        return
    deepest = int(np.argmax(surfaces.out[:count, 3]))
    node, other = (nodes[surfaces.face[faces[deepest], 0]] for faces in (touching, touched))
    part = _bodies(mesh)
    who = "the surface passes through itself"
    if part[node] != part[other]:
        names = [f'"{name}"' for name in (_name_of(mesh, part == part[one]) for one in (node, other)) if name]
        who = f"two bodies overlap ({' and '.join(names)})" if names else "two bodies overlap"
    raise InputError(
        f"{who} at rest: {count} points of the surfaces lie inside, the deepest {1e3 * surfaces.out[deepest, 3]:.2g} mm deep at "
        f"{in_mm(mesh.points[node])}; move them apart."
    )


def bodies_in_contact(mesh: HexMesh, surfaces: Surfaces) -> dict[str, float]:
    """Name of each body, in the order of ``Surfaces.body``, and the mean edge of its surface [m].

    The name is that of a node set with all nodes of the body, else "body", and a number where several have none.
    """
    edges_m: dict[str, float] = {}
    if not len(surfaces.body):
        return edges_m
    part = _bodies(mesh)
    for number in range(len(surfaces.pairs)):
        corners = surfaces.position[surfaces.face[surfaces.body == number]]
        name = _name_of(mesh, part == number) or "body"
        edge_m = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
        edges_m[name if name not in edges_m else f"{name}-{number}"] = edge_m
    return edges_m


def _name_of(mesh: HexMesh, of_body: np.ndarray) -> str:
    """A node set with all nodes of a body, which ``of_body`` (n,) marks; "" for none."""
    return next((name for name, members in mesh.node_sets.items() if of_body[members].sum() == of_body.sum()), "")


_touching_at = kernel(find_touching_at_rest)


def _own_faces(mesh: HexMesh, nodes: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """For each face the faces, rising, that have a corner in common with an element that touches it, itself included."""
    beside = _incidence(mesh.hexes, mesh.node_count)[:, nodes]
    corner = _incidence(faces, len(nodes))
    touching = (corner @ beside.T @ beside @ corner.T).tocsr()
    touching.sort_indices()
    return np.split(touching.indices.astype(np.int64), touching.indptr[1:-1])


def _across(faces: np.ndarray) -> np.ndarray:
    """For each edge of faces (f, 4), from its corner to the next, the other face and its edge; -1 where there is not just one."""
    across = np.full((len(faces), 4, 2), -1)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, number, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(number.ravel(), kind="stable")
    pairs = order[np.repeat(count == 2, count)].reshape(-1, 2)
    for one, other in (pairs.T, pairs[:, ::-1].T):
        across.reshape(-1, 2)[one] = np.stack(np.divmod(other, 4), axis=1)
    return across


def _incidence(corners: np.ndarray, count: int) -> scipy.sparse.csr_array:
    """Which of so many nodes each row of corners has, (rows, nodes)."""
    ends = corners.shape[1] * np.arange(len(corners) + 1)
    return scipy.sparse.csr_array((np.ones(corners.size), corners.ravel(), ends), shape=(len(corners), count))


def _arrays(
    node: np.ndarray,
    user: np.ndarray,
    area: np.ndarray,
    position: np.ndarray,
    face: np.ndarray,
    of_faces: np.ndarray,
    body: np.ndarray,
    own: list[np.ndarray],
    share: np.ndarray,
    part: np.ndarray,
    mass: np.ndarray,
    numbers: np.ndarray | None = None,
) -> Surfaces:
    nodes, points, bodies = len(node), len(part), int(body.max(initial=-1)) + 1
    deepest, stiffness, growth = np.ascontiguousarray(of_faces.T)
    return Surfaces(
        node=node,
        user=user.astype(np.int64),
        area=area,
        position=np.ascontiguousarray(position, dtype=float),
        face=np.ascontiguousarray(face, dtype=np.int64),
        across=_across(face),
        deepest=deepest,
        body=body,
        stiffness=stiffness,
        growth=growth,
        own=np.concatenate([*own, np.zeros(0, dtype=np.int64)]),
        own_start=np.concatenate([[0], np.cumsum([len(one) for one in own])]).astype(np.int64),
        point_face=np.repeat(np.arange(len(face)), points // max(len(face), 1)),
        share=np.ascontiguousarray(share),
        part=part,
        mass=mass,
        numbers=np.zeros(NUMBERS) if numbers is None else numbers,
        held=np.full(points, -1),
        place=np.zeros((nodes, 3)),
        seen=np.full((nodes, 3), np.nan),
        middle=np.zeros((len(face), 3)),
        low=np.zeros((len(face), 3)),
        high=np.zeros((len(face), 3)),
        near=np.zeros((len(face), FACES_NEAR), dtype=np.int32),
        near_count=np.zeros(len(face), dtype=np.int64),
        normal=np.zeros((len(face), 3)),
        looked=np.full((nodes, 3), np.nan),
        option=np.zeros((points, TRIANGLES_NEAR), dtype=np.int32),
        options=np.zeros(points, dtype=np.int64),
        waiting=np.zeros(points, dtype=np.int64),
        waiting_count=np.zeros(1, dtype=np.int64),
        trial=np.zeros(4 * FACES_NEAR, dtype=np.int64),
        distance=np.zeros(4 * FACES_NEAR),
        close=np.zeros(FACES_NEAR, dtype=np.int64),
        active=np.zeros(len(face), dtype=np.int64),
        active_count=np.zeros(1, dtype=np.int64),
        head=np.zeros(CELLS**3 if points else 0, dtype=np.int64),
        chain=np.zeros(len(face), dtype=np.int64),
        touching=np.zeros(points, dtype=np.int64),
        touches=np.zeros(1, dtype=np.int64),
        touched=np.zeros(points, dtype=np.int64),
        weight=np.zeros((points, 4)),
        stiff=np.zeros((points, 3)),
        out=np.zeros((points, 4)),
        pairs=np.zeros((bodies, bodies)),
        brake=np.zeros((points, 4)),
    )
