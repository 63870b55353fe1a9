"""Hexahedra inside a closed surface: a grid of cubes, a layer from its outer faces to the surface, and nodes that are then moved.

The layer gives each hexahedron at most one face on the surface, so that none is flattened where a corner of the grid meets a
smooth surface (Schneiders 1996, Engng. Comput. 12:168-177). Nodes then move to where the mean ratio of all corners is best
(Knupp 2000), those of the surface along it, and those of its sharp edges along these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from explicitfe.fem.bones.distance import distance_field
from explicitfe.fem.bones.surface import TriangleSurface, in_mm
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.fem.mesh.quality import scaled_jacobians
from explicitfe.fem.mesh.size import check_size
from explicitfe.fem.mesh.triangles import triangle_samples
from explicitfe.platform.errors import InputError
from explicitfe.simulate.meshes.sharp_edges import Patches, patches_at, pillow_patches

_CORE_DEPTH = 0.1  # of a cube: corners of the grid's cubes lie so deep inside at least
_FARTHEST_NODE_CUBES = 1.5  # cubes; so near to each point of the surface is a node of the mesh
_PER_CUBE = 3  # nodes of the field of distances along a cube
_SMOOTHING_ROUNDS, _STEPS_PER_ROUND = 12, 25
_PROJECTION_STEPS = 2
_WORST_QUALITY = 0.1  # scaled Jacobian below which sharp edges are rounded
# The edges that leave a corner of a hexahedron, in right-handed order.
_EDGES = np.array([(1, 3, 4), (2, 0, 5), (3, 1, 6), (0, 2, 7), (7, 5, 0), (4, 6, 1), (5, 7, 2), (6, 4, 3)])


def mesh_surface(surface: TriangleSurface, size_m: float) -> HexMesh:
    """Hexahedra with edges of about ``size_m`` inside a closed surface, the largest piece of it that cubes fit into.

    Raises
    ------
    InputError : the surface is thinner than three elements everywhere, or its inside needs too many of them.
    """
    low, high = surface.box_m
    check_size(int(np.prod(np.ceil((high - low) / size_m))), "the grid", "increase --size")
    count = np.ceil((high - low) / size_m).astype(int) + 2
    first = 0.5 * (low + high - size_m * count)
    region = np.stack([first, first + size_m * count])
    field = distance_field(surface, spacing_m=size_m / _PER_CUBE, smoothing_m=0.0, region=region)
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in count), indexing="ij"), axis=-1)
    points = first + size_m * grid.reshape(-1, 3)
    deep = (field.at(points)[0] < -_CORE_DEPTH * size_m).reshape(grid.shape[:3])
    core = np.ones(count, dtype=bool)
    for i, j, k in np.ndindex(2, 2, 2):
        core &= deep[i : i + count[0], j : j + count[1], k : k + count[2]]
    core = _without_hinges(core)
    if not core.any():
        extent = " x ".join(f"{1e3 * length:.3g}" for length in high - low)
        raise InputError(
            f"no cube of {1e3 * size_m:g} mm lies inside the surface, which is {extent} mm large; decrease --size, or give the "
            "unit of its lengths with --unit."
        )
    number = np.arange(len(points)).reshape(grid.shape[:3])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cells = np.argwhere(core)
    hexes = np.stack([number[tuple((cells + corner).T)] for corner in corners], axis=1)
    used, hexes = np.unique(hexes, return_inverse=True)
    points, hexes = points[used], hexes.reshape(-1, 8)
    element, face = free_faces(hexes)
    quads = hexes[element[:, None], FACES[face]]
    inner, outer = np.unique(quads, return_inverse=True)
    layer = np.concatenate([quads, len(points) + outer.reshape(quads.shape)], axis=1)  # FACES are seen from outside
    points = np.concatenate([points, points[inner]])
    mesh = _fit_layer(points, hexes, layer, Patches(surface, size_m), surface, size_m)
    if scaled_jacobians(mesh.points, mesh.hexes).min() < _WORST_QUALITY:  # such as where four edges meet
        mesh = _fit_layer(points, hexes, layer, Patches(surface, size_m, sharpest=-np.inf), surface, size_m)
    return mesh


def _fit_layer(
    points: np.ndarray, hexes: np.ndarray, layer: np.ndarray, patches: Patches, surface: TriangleSurface, size_m: float
) -> HexMesh:
    """The hexahedra (m, 8) of the grid with a layer (f, 8) around them that reaches to the patches of the surface."""
    points, quads = points.copy(), layer[:, :4]
    label = patches.labels(quads, points)
    around = patches_at(layer[:, 4:], label)
    points[list(around)] = patches.places(list(around.values()), points[list(around)])[0]
    points, layer, label, sheets = pillow_patches(points, layer, label)
    around = patches_at(layer[:, 4:], label)
    faces = points[layer[:, 4:]]
    sides = 0.5 * (faces + np.roll(faces, 1, axis=1))
    _check_whole(surface, np.concatenate([faces, sides, faces.mean(axis=1, keepdims=True)], axis=1), size_m)
    hexes = np.concatenate([hexes, layer, sheets])
    return HexMesh(_improve(points, hexes, np.array(list(around)), list(around.values()), patches), hexes)


def _check_whole(surface: TriangleSurface, points: np.ndarray, size_m: float) -> None:
    """InputError where a part of the surface has no point (f, k, 3) of the mesh's faces near it."""
    samples, _ = triangle_samples(surface.corners, 0.5 * size_m, surface.box_m)
    away = scipy.spatial.cKDTree(points.reshape(-1, 3)).query(samples)[0]
    if away.max() > _FARTHEST_NODE_CUBES * size_m:
        triangles, n = surface.triangles, len(surface.points)
        ends = triangles[:, [0, 0]].ravel(), triangles[:, 1:].ravel()
        piece = scipy.sparse.csgraph.connected_components(scipy.sparse.coo_array((np.ones(len(ends[0])), ends), shape=(n, n)))[1]
        # A cavity has a negative volume.
        bodies = np.count_nonzero(np.bincount(piece[triangles[:, 0]], weights=np.linalg.det(surface.corners)) > 0.0)
        why = f"is thinner than three elements of {1e3 * size_m:g} mm and would be missing; decrease --size"
        if bodies > 1:
            why = f"belongs to one of {bodies} separate bodies, of which one is meshed; save each into a file of its own"
        raise InputError(f"a part of the surface around {in_mm(samples[away.argmax()])} {why}.")


def _without_hinges(core: np.ndarray) -> np.ndarray:
    """The largest part of cubes that faces connect, without places at which its surface touches itself.

    These are corners around which the cubes, or the empty places, are connected by no faces.
    """
    core = core.copy()
    while True:
        label, count = scipy.ndimage.label(core)
        if count > 1:
            core = label == 1 + np.argmax(np.bincount(label.ravel())[1:])
        padded = np.pad(core, 1)
        blocks = np.lib.stride_tricks.sliding_window_view(padded, (2, 2, 2)).reshape(-1, 8)
        kinds, of = np.unique(blocks, axis=0, return_inverse=True)
        bad = np.array([max(scipy.ndimage.label(k.reshape(2, 2, 2) == full)[1] for full in (True, False)) > 1 for k in kinds])
        places = np.argwhere(bad[of.ravel()].reshape([n - 1 for n in padded.shape]))
        if not len(places):
            return core
        for place in places:
            first = np.argwhere(padded[tuple(slice(p, p + 2) for p in place)])[0]
            core[tuple(place + first - 1)] = False


def _improve(
    points: np.ndarray, hexes: np.ndarray, outer: np.ndarray, around: Sequence[frozenset[int]], patches: Patches
) -> np.ndarray:
    """Nodes in better places: all those inside, and those on the surface, ``outer``, along the patches ``around`` them."""
    size = float(np.linalg.norm(points[hexes[:, 0]] - points[hexes[:, 1]], axis=1).mean())
    best, best_quality = points, scaled_jacobians(points, hexes).min()
    for turn in range(_SMOOTHING_ROUNDS):
        free = patches.places(around, points[outer])[1]
        # The floor of the volume falls, so that inverted corners unfold first and shapes are refined then.
        floor = 0.3 * 0.5**turn

        def cost(x: np.ndarray, floor: float = floor, free: np.ndarray = free) -> tuple[float, np.ndarray]:
            value, slope = _shape_cost(x.reshape(-1, 3), hexes, floor)
            slope[outer] = np.einsum("kij,kj->ki", free, slope[outer])
            return value, slope.ravel()

        result = scipy.optimize.minimize(
            cost, (points / size).ravel(), jac=True, method="L-BFGS-B", options={"maxiter": _STEPS_PER_ROUND}
        )
        points = size * result.x.reshape(-1, 3)
        for _ in range(_PROJECTION_STEPS):
            points[outer] = patches.places(around, points[outer])[0]
        quality = scaled_jacobians(points, hexes).min()
        if quality > best_quality:
            best, best_quality = points, quality
    return best


def _shape_cost(points: np.ndarray, hexes: np.ndarray, floor: float) -> tuple[float, np.ndarray]:
    """Sum over all corners of (|e1|² + |e2|² + |e3|²) / (3 v^(2/3)), 1 for a cube, squared; and its gradient (n, 3).

    v is the volume of the three edges; below the floor it is replaced by a smooth function above 0.
    """
    value, slope = 0.0, np.zeros_like(points)
    for corner, others in enumerate(_EDGES):
        edges = points[hexes[:, others]] - points[hexes[:, corner], None]
        a, b, c = np.moveaxis(edges, 1, 0)
        cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        volume = np.einsum("mi,mi->m", a, cofactor[:, 0])
        root = np.sqrt(volume**2 + 4.0 * floor**2)
        above = 0.5 * (volume + root)
        squared = np.einsum("mji,mji->m", edges, edges)
        ratio = squared / (3.0 * above ** (2.0 / 3.0))
        value += float(ratio @ ratio)
        of_edges = (
            2.0
            * ratio[:, None, None]
            * (
                2.0 * edges / (3.0 * above ** (2.0 / 3.0))[:, None, None]
                - (2.0 / 3.0 * ratio / above * 0.5 * (1.0 + volume / root))[:, None, None] * cofactor
            )
        )
        np.add.at(slope, hexes[:, others], of_edges)
        np.add.at(slope, hexes[:, corner], -of_edges.sum(axis=1))
    return value, slope
