"""Fibres of a muscle that is given by elements: along a direction, or from one set of nodes to another.

From one set to another fibres follow the gradient of the harmonic function that is 0 on the first and 1 on the second, so that
they neither cross nor end in between, and follow a bent muscle.
"""

from __future__ import annotations

import numpy as np
import scipy

from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, MaterialPoints, shape_gradients
from explicitfe.fem.mesh.muscle_lines import Fibre, MuscleTissue, points_of_mesh
from explicitfe.fem.mesh.quality import volumes
from explicitfe.platform.errors import InputError

_MOST_SEEDS = 400  # lines that are traced, of which those stay that lie apart
_APART = 0.7  # of the width of an element, at least, over half of a line
_INSIDE = 1e-6  # natural coordinates of a point on a face are 1 up to this
_SMALLEST_STEP = 1 / 256  # of the width of an element: so near to the surface lines end


def harmonic_direction(mesh: HexMesh, elements: np.ndarray, origin: np.ndarray, insertion: np.ndarray) -> np.ndarray:
    """Unit vectors (k, 3) in elements (k,) from the nodes of an origin to those of an insertion.

    Raises
    ------
    InputError : no node of one of these belongs to the elements, some belong to both, or elements connect them in no way.
    """
    hexes = mesh.hexes[elements]
    nodes, local = np.unique(hexes, return_inverse=True)
    local = local.reshape(hexes.shape)
    ends = [np.isin(nodes, of) for of in (origin, insertion)]
    for of, what in zip(ends, ("origin", "insertion"), strict=True):
        if not of.any():
            raise InputError(f"no node of its {what} belongs to its elements; let the two sets meet.")
    if (ends[0] & ends[1]).any():
        raise InputError("its origin and its insertion have nodes in common; choose sets that lie apart.")
    corners = mesh.points[hexes]
    stiffness = np.zeros((len(hexes), 8, 8))
    for natural in CORNERS / np.sqrt(3.0):
        gradient, jacobian = _gradients(natural, corners)
        stiffness += jacobian[:, None, None] * np.einsum("kai,kbi->kab", gradient, gradient)
    rows, columns = np.repeat(local, 8, axis=1).ravel(), np.tile(local, (1, 8)).ravel()
    matrix = scipy.sparse.csr_array((stiffness.ravel(), (rows, columns)), shape=(len(nodes), len(nodes)))
    count, part = scipy.sparse.csgraph.connected_components(matrix, directed=False)
    reached = np.isin(np.arange(count), part[ends[0]]) & np.isin(np.arange(count), part[ends[1]])
    if not reached.all():
        raise InputError("a piece of its elements does not reach from the origin to the insertion; remove it from the set.")
    value = ends[1].astype(float)
    free = ~(ends[0] | ends[1])
    if free.any():
        value[free] = scipy.sparse.linalg.spsolve(matrix[free][:, free].tocsc(), -(matrix[free] @ value))
    along = np.einsum("kai,ka->ki", _gradients(np.zeros(3), corners)[0], value[local])
    length = np.linalg.norm(along, axis=1, keepdims=True)
    if not (length > 0.0).all():
        raise InputError("all nodes of one of its elements are in its origin or insertion; refine the mesh, or remove it.")
    return np.asarray(along / length)


def _gradients(natural: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (k, 8, 3) of the shape functions in space at a point of hexes (k, 8, 3), and the Jacobian (k,) there."""
    of_natural = shape_gradients(natural)
    jacobian = np.einsum("kai,aj->kij", corners, of_natural)
    return np.einsum("aj,kji->kai", of_natural, np.linalg.inv(jacobian)), np.linalg.det(jacobian)


def trace_fibres(
    mesh: HexMesh, elements: np.ndarray, direction: np.ndarray, middle_y_m: float, side: str | None = None
) -> tuple[tuple[Fibre, ...], MuscleTissue]:
    """Fibres through elements (k,) along their directions (k, 3), about an element's width apart, from surface to surface.

    Parameters
    ----------
    middle_y_m : fibres beyond are on the right, unless ``side`` says so of all.
    """
    body = HexMesh(mesh.points, mesh.hexes[elements])
    centre = mesh.points[body.hexes].mean(axis=1)
    width = float(np.cbrt(volumes(mesh.points, body.hexes).mean()))
    seeds = centre[np.unique(np.linspace(0, len(centre) - 1, min(len(centre), _MOST_SEEDS)).astype(int))]
    back, forth = _halves(body, seeds, -direction, width), _halves(body, seeds, direction, width)
    lines = [np.array([*reversed(before[1:]), *after]) for before, after in zip(back, forth, strict=True)]
    lengths = [float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines]
    chosen: list[np.ndarray] = []
    for number in sorted(range(len(lines)), key=lambda k: -lengths[k]):
        line = lines[number]
        apart = _APART * width
        if chosen and np.median(scipy.spatial.cKDTree(np.concatenate(chosen)).query(line)[0]) < apart:
            continue
        if lengths[number] > _APART * width or not chosen:
            chosen.append(line)
    fibres = []
    for line in chosen:
        points, _ = points_of_mesh(body, line[np.append(np.arange(0, len(line) - 1, 2), len(line) - 1)])
        points = MaterialPoints(elements[points.element], points.natural, points.position)
        own_side = side or ("right" if line[:, 1].mean() > middle_y_m else "left")
        fibres.append(Fibre.through(points, own_side, mesh))
    of_point = np.repeat(np.arange(len(chosen)), [len(line) for line in chosen])
    nearest = scipy.spatial.cKDTree(np.concatenate(chosen)).query(centre)[1]
    return tuple(fibres), MuscleTissue(elements, direction, of_point[nearest])


def _halves(body: HexMesh, seeds: np.ndarray, direction: np.ndarray, width: float) -> list[list[np.ndarray]]:
    """Points of lines from seeds (s, 3) along the directions of elements, half of a width apart, to the surface."""
    lines = [[seed] for seed in seeds]
    head, step = seeds.copy(), np.full(len(seeds), 0.5 * width)
    element = points_of_mesh(body, head, _INSIDE)[0].element
    longest = 4.0 * np.ptp(body.points[body.hexes].reshape(-1, 3), axis=0).sum()
    for _ in range(int(longest / width) + 50):
        going = np.flatnonzero(step >= _SMALLEST_STEP * width)
        if not len(going):
            break
        ahead = head[going] + step[going, None] * direction[element[going]]
        points, inside = points_of_mesh(body, ahead, _INSIDE)
        step[going[~inside]] *= 0.5
        for number, place, of in zip(going[inside], ahead[inside], points.element[inside], strict=True):
            head[number], element[number] = place, of
            lines[number].append(place)
    return lines
