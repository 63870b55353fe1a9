"""From the fibres of a muscle to its active stress in the elements, as a field that does not depend on the mesh.

Call::

    fibre_stress(mesh, muscle, force_N, side, profile, *, fibres=None, force_length=False, width_mm=3.0) -> FibreStress
    outside_pull(muscle, force_N, side, profile, *, fibres=None) -> FibrePull | None

The force is shared equally over the fibres of the sides named, T = force / number of fibres. Every fibre is cut into pieces
of 1 mm or less, and each piece of length L and direction t adds to the structure tensor of the muscle

    A(X) = sum of T L w(X - X_piece) t x t,   w = exp(-|X|^2 / (2 h^2)) / (2 pi h^2)^(3/2),   h = 3 mm.

In an element, with A its average there, the direction a0 is the first eigenvector of A and the stress sigma its trace. The field
is then scaled so that the integral of sigma over the mesh is the sum of T L of the pieces in the tongue: a uniform contraction
does the work that it does with the fibres, so that "2 N" keeps its meaning. Fibres that cross, or that meet their mirror
images in the midline, add in A before the eigenvector is taken.

What runs outside the tongue, from a point fixed in space to the first point in the tongue, stays a line: ``outside_pull``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from explicitfe.errors import InputError
from explicitfe.mesh.hexmesh import CORNERS, HexMesh, MaterialPoints, shape_functions
from explicitfe.mesh.muscle_lines import Fibre, Muscle
from explicitfe.mesh.quality import edge_lengths
from explicitfe.model.model import FibrePull, FibreStress
from explicitfe.model.profile import Profile

# The width of the Gaussian: fibres of a muscle lie 3 to 8 mm apart, so that it joins them.
WIDTH_MM = 3.0

# The longest piece of a fibre that one Gaussian stands for: a third of its width, so that a row of them is a smooth line.
PIECE_MM = 1.0

# A Gaussian ends at so many widths: beyond lies 0.1 % of it.
_REACH_WIDTHS = 4.0

# Elements with less than this share of the largest stress are left out: the tails of the Gaussians.
_CUTOFF_SHARE = 5e-3

# A piece with less than this share of its Gaussian in the tongue lies outside: on a flat surface it is a half, in a corner
# an eighth.
_INSIDE_SHARE = 0.05

# Gauss points in an element lie no further apart than this many widths, on average.
_POINT_SPACING_WIDTHS = 1.0

# So many Gauss points are paired with pieces at a time.
_BATCH_POINTS = 100_000

Side = Literal["both", "left", "right"]


def fibre_stress(
    mesh: HexMesh,
    muscle: Muscle,
    force_N: float,
    side: Side,
    profile: Profile,
    *,
    fibres: Sequence[int] | None = None,
    force_length: bool = False,
    width_mm: float = WIDTH_MM,
) -> FibreStress:
    """The active stress of a muscle that pulls with a force.

    Parameters
    ----------
    mesh : the reference mesh.
    muscle : its fibres.
    force_N : summed over all fibres that pull, at profile value 1.
    side : which fibres pull.
    profile : its course in time.
    fibres : numbers of the fibres that pull, counted from 1 on each side; all if left out.
    force_length : whether the stress falls off in a shortened fibre.
    width_mm : width h of the Gaussian.

    Raises
    ------
    InputError : no fibre on that side or of that number, or more than half of the muscle lies outside the mesh.
    """
    chosen = chosen_fibres(muscle, side, fibres)
    middle, along, work = _pieces(chosen, force_N / len(chosen))
    width = np.full(len(work), 1e-3 * width_mm)
    tensor = np.zeros((mesh.element_count, 3, 3))
    share_inside = np.zeros(len(work))
    volume = np.zeros(mesh.element_count)
    weights = []
    for elements, weight, volumes in _weights(mesh, middle, width):
        weights.append((elements, weight))
        share_inside += np.asarray(weight.sum(axis=0)).ravel()
        volume[elements] = volumes
    inside = share_inside >= _INSIDE_SHARE
    _check_inside(muscle, work, inside)
    outer = np.where(inside, work, 0.0)[:, None] * (along[:, :, None] * along[:, None, :]).reshape(-1, 9)
    for elements, weight in weights:
        tensor[elements] = (weight @ outer).reshape(-1, 3, 3) / volume[elements, None, None]

    stress = np.trace(tensor, axis1=1, axis2=2)
    kept = np.flatnonzero(stress > _CUTOFF_SHARE * stress.max())
    direction = np.linalg.eigh(tensor[kept])[1][:, :, -1]
    scale = work[inside].sum() / (stress[kept] @ volume[kept])
    return FibreStress(muscle.name, kept, direction, scale * stress[kept], profile, force_length)


def outside_pull(
    muscle: Muscle, force_N: float, side: Side, profile: Profile, *, fibres: Sequence[int] | None = None
) -> FibrePull | None:
    """What pulls outside the tongue: the segments that have an end fixed in space, following the deformation.

    None where no fibre has such a segment. Parameters and errors are those of ``fibre_stress``.
    """
    chosen = chosen_fibres(muscle, side, fibres)
    share = force_N / len(chosen)
    lines = []
    for fibre in chosen:
        for k in np.flatnonzero(~_in_tissue(fibre)):
            points, at = fibre.points, slice(k, k + 2)
            lines.append(MaterialPoints(points.element[at], points.natural[at], points.position[at]))
    if not lines:
        return None
    return FibrePull(muscle.name, tuple(lines), tuple(np.full(1, share) for _ in lines), profile)


def chosen_fibres(muscle: Muscle, side: Side, numbers: Sequence[int] | None = None) -> list[Fibre]:
    """The fibres of the sides named and, counted from 1 on each side, of these numbers.

    Raises
    ------
    InputError : there is none on that side, or none of that number.
    """
    sides = ("right", "left") if side == "both" else (side,)
    of_side = {name: [fibre for fibre in muscle.fibres if fibre.side == name] for name in sides}
    most = max(len(fibres) for fibres in of_side.values())
    if most == 0:
        raise InputError(f'muscle {muscle.name} has no fibre on the {side} side; use side = "both".')
    if numbers is None:
        return [fibre for fibre in muscle.fibres if fibre.side in sides]
    for number in numbers:
        if not 1 <= number <= most:
            raise InputError(f"muscle {muscle.name} has no fibre {number}: its fibres run from 1 to {most} on a side.")
    return [fibre for fibres in of_side.values() for k, fibre in enumerate(fibres, start=1) if k in numbers]


def _in_tissue(fibre: Fibre) -> np.ndarray:
    """Which segments have both ends in the tongue."""
    inside = fibre.points.element >= 0
    return inside[:-1] & inside[1:]


def _pieces(fibres: list[Fibre], tension_N: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pieces in the tongue: their middles (k, 3) m, directions (k, 3), and tension times length (k,) N m."""
    middles, alongs, works = [], [], []
    for fibre in fibres:
        tissue = _in_tissue(fibre)
        start = fibre.points.position[:-1][tissue]
        step = np.diff(fibre.points.position, axis=0)[tissue]
        length = np.linalg.norm(step, axis=1)
        counts = np.ceil(1e3 * length / PIECE_MM).astype(int)
        segment = np.repeat(np.arange(len(start)), counts)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        middles.append(start[segment] + step[segment] * ((number + 0.5) / counts[segment])[:, None])
        alongs.append((step / length[:, None])[segment])
        works.append((tension_N * length / counts)[segment])
    return np.concatenate(middles), np.concatenate(alongs), np.concatenate(works)


def _weights(mesh: HexMesh, middle: np.ndarray, width: np.ndarray) -> Iterator[tuple[np.ndarray, coo_matrix, np.ndarray]]:
    """Elements, the integral of every piece's Gaussian over each (elements, pieces), and their volumes m^3; part after part."""
    pieces = cKDTree(middle)
    reach = _REACH_WIDTHS * width.max()
    corners = mesh.points[mesh.hexes]
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    near = pieces.query(centre, distance_upper_bound=reach + radius.max())[0] <= reach + radius
    longest = edge_lengths(mesh.points, mesh.hexes).max(axis=1)
    order = np.ceil(longest / (_POINT_SPACING_WIDTHS * width.min())).astype(int).clip(2, 8)
    for count in np.unique(order[near]):
        natural, rule = _gauss(count)
        of_order = np.flatnonzero(near & (order == count))
        for elements in np.array_split(of_order, 1 + len(of_order) * len(rule) // _BATCH_POINTS):
            places = np.einsum("qa,mai->mqi", shape_functions(natural), corners[elements])
            volume = rule * _jacobians(natural, corners[elements])
            pairs = cKDTree(places.reshape(-1, 3)).sparse_distance_matrix(pieces, reach, output_type="ndarray")
            h = width[pairs["j"]]
            value = np.exp(-0.5 * (pairs["v"] / h) ** 2) / ((2.0 * np.pi) ** 1.5 * h**3)
            value[pairs["v"] > _REACH_WIDTHS * h] = 0.0
            place = pairs["i"]
            weight = coo_matrix(
                (value * volume.ravel()[place], (place // len(rule), pairs["j"])), shape=(len(elements), len(middle))
            )
            yield elements, weight.tocsr(), volume.sum(axis=1)


def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Natural coordinates (count^3, 3) and weights of the Gauss rule with that many points along each axis."""
    at, weight = np.polynomial.legendre.leggauss(count)
    grid = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid, np.einsum("i,j,k->ijk", weight, weight, weight).ravel()


def _jacobians(natural: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(m, q) m^3, volume of hexes (m, 8, 3) per natural one at points (q, 3)."""
    factors = 1.0 + natural[:, None, :] * CORNERS
    gradient = np.stack([CORNERS[:, i] * factors[..., (i + 1) % 3] * factors[..., (i + 2) % 3] / 8.0 for i in range(3)])
    a, b, c = np.einsum("jqa,mai->jmqi", gradient, corners)
    return np.einsum("mqi,mqi->mq", a, np.cross(b, c))


def _check_inside(muscle: Muscle, work: np.ndarray, inside: np.ndarray) -> None:
    outside = 1.0 - work[inside].sum() / work.sum()
    if outside > 0.5:
        raise InputError(
            f"{100 * outside:.0f} % of muscle {muscle.name} lies outside the mesh: check the units and the place of its fibres."
        )
