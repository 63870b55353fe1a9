"""Fibres of a muscle that is given by elements: along a direction, or from one set of nodes to another.

From one set to another fibres follow the gradient of the harmonic function that is 0 on the first and 1 on the second, so that
they neither cross nor end in between, and follow a bent muscle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from explicitfe.fem.mesh.hexmesh import CORNERS, FACES, HexMesh, MaterialPoints, face_groups, shape_gradients
from explicitfe.fem.mesh.muscle_lines import Fibre, MuscleTissue, natural_coordinates
from explicitfe.fem.mesh.quality import volumes
from explicitfe.platform.errors import InputError

_MOST_SEEDS = 400  # lines that are traced, of which those stay that lie apart
_SHORTEST = 1e-7  # m; shorter pieces of a line are left out: a fibre's points must differ
_APART = 0.7  # of the width of an element, at least, over half of a line


def harmonic_direction(mesh: HexMesh, elements: np.ndarray, origin: np.ndarray, insertion: np.ndarray) -> np.ndarray:
    """Unit vectors (k, 3) in elements (k,) from the nodes of an origin to those of an insertion.

    Raises
    ------
    InputError : no node of one of these belongs to the elements, some belong to both, or elements connect them in no length.
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
    hexes = mesh.hexes[elements]
    centre = mesh.points[hexes].mean(axis=1)
    apart = _APART * float(np.cbrt(volumes(mesh.points, hexes).mean()))
    seeds = np.unique(np.linspace(0, len(hexes) - 1, min(len(hexes), _MOST_SEEDS)).astype(int))
    back, forth = (_Walk.from_centres(mesh.points, hexes, seeds, along) for along in (-direction, direction))
    lines = [
        np.array([*reversed(before), centre[k], *after]) for k, before, after in zip(seeds, back.lines, forth.lines, strict=True)
    ]
    crossed = [[*reversed(before), *after] for before, after in zip(back.crossed, forth.crossed, strict=True)]
    lengths = [float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines]
    chosen: list[int] = []
    for number in sorted(range(len(lines)), key=lambda k: -lengths[k]):
        taken = [lines[k] for k in chosen]
        near = np.median(scipy.spatial.cKDTree(np.concatenate(taken)).query(lines[number])[0]) if taken else np.inf
        if near >= apart and (lengths[number] > apart or not taken):
            chosen.append(number)
    fibres = []
    for number in chosen:
        line, segment = lines[number], np.array(crossed[number])
        of_point = np.append(segment, segment[-1])
        natural, _ = natural_coordinates(mesh.points[hexes[of_point]], line, np.zeros_like(line))
        points = MaterialPoints(elements[of_point], np.clip(natural, -1.0, 1.0), line)
        own_side = side or ("right" if line[:, 1].mean() > middle_y_m else "left")
        fibres.append(Fibre(points, own_side, elements[segment]))
    of_point = np.repeat(np.arange(len(chosen)), [len(lines[k]) for k in chosen])
    nearest = scipy.spatial.cKDTree(np.concatenate([lines[k] for k in chosen])).query(centre)[1]
    return tuple(fibres), MuscleTissue(elements, direction, of_point[nearest])


@dataclass
class _Walk:
    """Lines from the centres of elements, straight in each element, to the face where its direction leaves it.

    Attributes
    ----------
    lines : of each its points on faces, without the centre.
    crossed : of each the elements before these points.
    """

    lines: list[list[np.ndarray]]
    crossed: list[list[int]]

    @classmethod
    def from_centres(cls, points: np.ndarray, hexes: np.ndarray, seeds: np.ndarray, direction: np.ndarray) -> _Walk:
        """Walk from elements ``seeds`` (s,) along the directions (m, 3) of elements until these end, or a line comes back."""
        corners = points[hexes[:, FACES]]  # (m, 6 faces, 4, 3)
        middle = corners.mean(axis=2)
        normal = np.cross(corners[:, :, 2] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 1])
        centre = points[hexes].mean(axis=1)
        normal *= np.sign(np.einsum("mfi,mfi->mf", normal, middle - centre[:, None]))[:, :, None]
        neighbour = _neighbours(hexes)
        speed = np.einsum("mfi,mi->mf", normal, direction)
        walk = cls([[] for _ in seeds], [[] for _ in seeds])
        for line, crossed, seed in zip(walk.lines, walk.crossed, seeds, strict=True):
            element, entry, place, visited = int(seed), -1, centre[seed], set[int]()
            while element >= 0 and element not in visited:
                ahead = np.einsum("fi,fi->f", normal[element], middle[element] - place)
                with np.errstate(divide="ignore", invalid="ignore"):
                    length = np.where(speed[element] > 0.0, ahead / speed[element], np.inf)
                length[neighbour[element] == entry if entry >= 0 else []] = np.inf
                face = int(length.argmin())
                if not np.isfinite(length[face]):
                    break
                if length[face] > _SHORTEST:
                    place = place + length[face] * direction[element]
                    line.append(place)
                    crossed.append(element)
                visited.add(element)
                element, entry = int(neighbour[element, face]), element
        return walk


def _neighbours(hexes: np.ndarray) -> np.ndarray:
    """The element beyond each face, (m, 6); -1 where there is none."""
    order, begins = face_groups(hexes)
    two = begins[np.diff(begins, append=len(order)) == 2]
    first, second = order[two], order[two + 1]
    neighbour = np.full(6 * len(hexes), -1)
    neighbour[first], neighbour[second] = second // 6, first // 6
    return neighbour.reshape(-1, 6)
