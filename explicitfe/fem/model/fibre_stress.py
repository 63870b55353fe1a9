"""From the fibres of a muscle to its active stress in the elements: a field that does not depend on the mesh.

Call::

    fibre_stress(mesh, muscle, force_N, side, profile, *, fibres=None, force_length=False, width_mm=3.0) -> FibreStress
    outside_pull(mesh, muscle, force_N, side, profile, *, fibres=None) -> FibrePull | None

The force is shared equally over the fibres of the sides named, T = force / number of fibres. Every fibre is cut into pieces
of 1 mm or less, and each piece of length L and direction t adds to the structure tensor of the muscle

    A(X) = sum of T L w(X - X_piece) t x t,   w = exp(-|X|^2 / (2 h^2)) / (2 pi h^2)^(3/2),   h = 3 mm.

In an element, with A its average there, the direction a0 is the first eigenvector of A and the stress sigma its trace. The field
is then scaled so that the integral of sigma over the mesh is the sum of T L of the pieces in the tongue: a uniform contraction
does the work that it does with the fibres, so that "2 N" keeps its meaning. Fibres that cross, or that meet their mirror
images in the midline, add in A before the eigenvector is taken.

Where fibres converge on their origin, h is the muscle's ``origin_width_m`` and falls to 3 mm within the first 20 mm of the fibre:
drawn as lines they meet in a point, while the muscle holds a patch of the bone. T is the same along a fibre unless the
fibre says otherwise (``relative_tension``).

What runs outside the tongue, from a point fixed in space, stays a line: ``outside_pull``. It ends along the first 4 mm of the
fibre in the tongue, along which T rises, and around it as far as the Gaussian: a force at a point has no limit under refinement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, MaterialPoints, shape_functions
from explicitfe.fem.mesh.muscle_lines import Fibre, Muscle, points_of_mesh
from explicitfe.fem.mesh.quality import edge_lengths, volumes
from explicitfe.fem.model.model import FibrePull, FibreStress
from explicitfe.fem.model.profile import Profile
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.kept import kept
from explicitfe.platform.host.stored import store_answers

# The width of the Gaussian: fibres of a muscle lie 3 to 8 mm apart, so that it joins them.
WIDTH_MM = 3.0

# The longest piece of a fibre that one Gaussian stands for: a third of its width, so that a row of them is a smooth line.
PIECE_MM = 1.0

# How far along a fibre from its origin a wider Gaussian falls to the usual width: there the fibres of the genioglossus
# stand 5 mm apart.
ORIGIN_REACH_MM = 20.0

# How far along a fibre in the tongue a line from outside ends, at so many points.
ENTRY_MM = 4.0
_ENTRY_POINTS = 4

# A Gaussian ends at so many widths: beyond lies 0.1 % of it.
_REACH_WIDTHS = 4.0

# Elements with less than this share of the largest stress are left out: the tails of the Gaussians.
_CUTOFF_SHARE = 5e-3

# A piece with less than this share of its Gaussian in the tongue lies outside: on a flat surface it is a half, in a corner
# an eighth.
_INSIDE_SHARE = 0.05

# More than this share of a muscle outside is taken for a mistake.
_MOST_OUTSIDE_SHARE = 0.5

# Gauss points in an element lie no further apart than this many widths, on average.
_POINT_SPACING_WIDTHS = 1.0

# Gauss points along each axis of an element.
_FEWEST_AND_MOST_POINTS = (2, 8)

# So many Gauss points are paired with pieces at a time.
_BATCH_POINTS = 1000

# So many fields are kept for the next run of this process: those of all muscles of the tongue on two meshes.
_KEPT_MUSCLE_FIELDS = 24
# Where the code of the fields stands.
_CODE_OF_FIELDS = ("fem/mesh", "fem/model/fibre_stress.py")

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
    spread = _tissue_field(mesh, muscle, side, None if fibres is None else tuple(fibres), width_mm)
    stress = spread.density * (force_N * spread.work / spread.integral)
    return FibreStress(muscle.name, spread.elements, spread.direction, stress, profile, force_length)


@dataclass(frozen=True)
class _TissueField:
    """How fibres spread into the tissue, for a force of 1 N.

    Attributes
    ----------
    elements : (k,) that they reach.
    direction : (k, 3) of the stress in each, unit vectors.
    density : (k,) 1/m^2. Trace of A there.
    work : m. Sum of T L of the pieces in the tongue.
    integral : m. Of the density over these elements.
    """

    elements: np.ndarray
    direction: np.ndarray
    density: np.ndarray
    work: float
    integral: float


@kept(_KEPT_MUSCLE_FIELDS)
@store_answers(_TissueField, sources=_CODE_OF_FIELDS)
def _tissue_field(mesh: HexMesh, muscle: Muscle, side: Side, fibres: tuple[int, ...] | None, width_mm: float) -> _TissueField:
    """The field of ``fibre_stress``; in a muscle that is given by elements a uniform stress of its force over its section."""
    if muscle.tissue is not None:
        chosen = muscle.chosen(side, fibres)
        numbers = [number for number, fibre in enumerate(muscle.fibres) if any(fibre is one for one in chosen)]
        own = np.isin(muscle.tissue.fibre, numbers)
        elements = muscle.tissue.elements[own]
        lengths = [np.linalg.norm(np.diff(fibre.points.position, axis=0), axis=1).sum() for fibre in chosen]
        size = float(volumes(mesh.points, mesh.hexes[elements]).sum())
        return _TissueField(elements, muscle.tissue.direction[own], np.ones(len(elements)), float(np.mean(lengths)), size)
    integral = np.zeros((mesh.element_count, 9))  # of A over each element, for a force of 1 N
    in_all, in_mesh = 0.0, 0.0
    for pieces in _pieces(muscle, muscle.chosen(side, fibres), 1e-3 * width_mm):
        spread, share_inside = _spread(mesh, pieces)
        inside = share_inside >= _INSIDE_SHARE
        if not inside.all():
            spread, _ = _spread(mesh, pieces[inside])
        integral += spread
        in_all, in_mesh = in_all + pieces.work.sum(), in_mesh + pieces.work[inside].sum()
    outside = 1.0 - in_mesh / in_all
    if outside > _MOST_OUTSIDE_SHARE:
        raise InputError(
            f"{100 * outside:.0f} % of muscle {muscle.name} lies outside the mesh; check unit and positions of its fibres."
        )

    volume = volumes(mesh.points, mesh.hexes)
    tensor = integral.reshape(-1, 3, 3) / volume[:, None, None]
    density = np.trace(tensor, axis1=1, axis2=2)
    elements = np.flatnonzero(density > _CUTOFF_SHARE * density.max())
    direction = np.linalg.eigh(tensor[elements])[1][:, :, -1]
    return _TissueField(elements, direction, density[elements], in_mesh, density[elements] @ volume[elements])


def outside_pull(
    mesh: HexMesh, muscle: Muscle, force_N: float, side: Side, profile: Profile, *, fibres: Sequence[int] | None = None
) -> FibrePull | None:
    """What pulls outside the tongue: lines from an end fixed in space to points of the fibre, following the deformation.

    None where no fibre has such an end. Parameters and errors are those of ``fibre_stress``.
    """
    chosen = muscle.chosen(side, fibres)
    lines = _lines_outside(mesh, tuple(chosen))
    if not lines:
        return None
    ends = sum(int(np.sum(fibre.points.element[[0, -1]] < 0)) for fibre in chosen)
    tension = np.array([force_N / len(chosen) * ends / len(lines)])
    return FibrePull(muscle.name, lines, (tension,) * len(lines), profile)


@kept(_KEPT_MUSCLE_FIELDS)
@store_answers(MaterialPoints, sources=_CODE_OF_FIELDS)
def _lines_outside(mesh: HexMesh, fibres: tuple[Fibre, ...]) -> tuple[MaterialPoints, ...]:
    return tuple(line for fibre in fibres for line in _outside_lines(mesh, fibre))


def _outside_lines(mesh: HexMesh, fibre: Fibre) -> list[MaterialPoints]:
    """Lines from the ends of a fibre that are fixed in space to points around its first ``ENTRY_MM`` in the tongue.

    A point that would lie outside the tongue moves to the surface.
    """
    position, inside = fibre.points.position, fibre.points.element >= 0
    order = np.arange(len(position))
    lines = []
    for end, along in ((0, order), (len(order) - 1, order[::-1])):
        if inside[end]:
            continue
        entry, start = along[inside[along]], position[along[np.argmax(inside[along]) - 1]]
        place = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position[entry], axis=0), axis=1))])
        at = np.minimum(1e-3 * ENTRY_MM, place[-1]) * (np.arange(_ENTRY_POINTS) + 0.5) / _ENTRY_POINTS
        middle = np.column_stack([np.interp(at, place, position[entry, i]) for i in range(3)])
        points, _ = points_of_mesh(
            mesh, _around(middle, middle[-1] - middle[0], 1e-3 * WIDTH_MM), tolerance=np.inf, thorough=True
        )
        for k in range(len(points)):
            lines.append(
                MaterialPoints(
                    np.array([-1, points.element[k]]),
                    np.stack([np.zeros(3), points.natural[k]]),
                    np.stack([start, points.position[k]]),
                )
            )
    return lines


def _around(middle: np.ndarray, along: np.ndarray, width: float) -> np.ndarray:
    """Four points (4 k, 3) around each of (k, 3), across a direction (3,): Gauss points of a Gaussian (Stroud 1971, E2 3-1).

    Those of a mirrored direction, y -> -y, are their images.
    """
    unit = along / np.linalg.norm(along)
    first = np.cross(unit, [0.0, 1.0, 0.0] if abs(unit[1]) < 0.9 else [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(unit, first)])
    return (middle[:, None] + np.sqrt(2.0) * width * np.concatenate([across, -across])).reshape(-1, 3)


def _risen(fibre: Fibre, place: np.ndarray) -> np.ndarray:
    """Share of the tension at places (k,) m along the fibre in the tongue, which ends in space rise to along the entry."""
    length = float(np.linalg.norm(np.diff(fibre.points.position, axis=0)[_in_tissue(fibre)], axis=1).sum())
    entry = min(1e-3 * ENTRY_MM, length)
    share = np.ones(len(place))
    for end, from_end in ((0, place), (-1, length - place)):
        if fibre.points.element[end] < 0:
            share = np.minimum(share, from_end / entry)
    return share


@dataclass(frozen=True)
class _Pieces:
    """Short pieces of fibres in the tongue.

    Attributes
    ----------
    middle : (k, 3) m.
    along : (k, 3) unit vectors.
    work : (k,) m. Length times the share of the muscle's force that it carries.
    width : (k,) m. h of the Gaussian of each.
    """

    middle: np.ndarray
    along: np.ndarray
    work: np.ndarray
    width: np.ndarray

    def __getitem__(self, chosen: np.ndarray) -> _Pieces:
        return _Pieces(self.middle[chosen], self.along[chosen], self.work[chosen], self.width[chosen])


def _in_tissue(fibre: Fibre) -> np.ndarray:
    """Which segments have both ends in the tongue."""
    inside = fibre.points.element >= 0
    return inside[:-1] & inside[1:]


def _pieces(muscle: Muscle, fibres: list[Fibre], width: float) -> list[_Pieces]:
    """The fibres, equal in force, cut into pieces: those of the usual width, and the wider ones apart, which reach further."""
    middles, alongs, works, widths = [], [], [], []
    wider = max(0.0, (muscle.origin_width_m or width) - width)
    for fibre in fibres:
        tissue = _in_tissue(fibre)
        start = fibre.points.position[:-1][tissue]
        step = np.diff(fibre.points.position, axis=0)[tissue]
        length = np.linalg.norm(step, axis=1)
        tension = np.ones(len(length)) if fibre.relative_tension is None else fibre.relative_tension[tissue]
        counts = np.ceil(1e3 * length / PIECE_MM).astype(int)
        segment = np.repeat(np.arange(len(start)), counts)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (number + 0.5) / counts[segment]
        from_origin = (np.cumsum(length) - length)[segment] + share * length[segment]
        middles.append(start[segment] + step[segment] * share[:, None])
        alongs.append((step / length[:, None])[segment])
        works.append((tension * length / counts)[segment] * _risen(fibre, from_origin) / len(fibres))
        widths.append(width + wider * np.clip(1.0 - from_origin / (1e-3 * ORIGIN_REACH_MM), 0.0, None))
    if not sum(map(len, works)):
        raise InputError(f"muscle {muscle.name} has no segment with both ends in the mesh; check unit and positions.")
    pieces = _Pieces(*map(np.concatenate, (middles, alongs, works, widths)))
    return [pieces[of] for of in (pieces.width == width, pieces.width > width) if of.any()]


def _spread(mesh: HexMesh, pieces: _Pieces) -> tuple[np.ndarray, np.ndarray]:
    """The integral of A over each element, (m, 9) m, for a force of 1 N; and the share of each piece's Gaussian in the mesh."""
    integral, share_inside = np.zeros((mesh.element_count, 9)), np.zeros(len(pieces.work))
    if not len(pieces.work):
        return integral, share_inside
    outer = pieces.work[:, None] * (pieces.along[:, :, None] * pieces.along[:, None, :]).reshape(-1, 9)
    reach = _REACH_WIDTHS * pieces.width
    corners = mesh.points[mesh.hexes]
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    distance, nearest = scipy.spatial.cKDTree(pieces.middle).query(centre, distance_upper_bound=reach.max() + radius.max())
    longest = edge_lengths(mesh.points, mesh.hexes).max(axis=1)
    order = np.ceil(longest / (_POINT_SPACING_WIDTHS * pieces.width.min())).astype(int).clip(*_FEWEST_AND_MOST_POINTS)
    near = np.flatnonzero(distance <= reach.max() + radius)
    for count in np.unique(order[near]):
        natural, rule = _gauss(count)
        # Elements near to the same pieces stand together, so that a batch of them has to do with few.
        of_order = near[order[near] == count]
        of_order = of_order[np.argsort(nearest[of_order], kind="stable")]
        for elements in np.array_split(of_order, 1 + len(of_order) * len(rule) // _BATCH_POINTS):
            places = np.einsum("qa,mai->mqi", shape_functions(natural), corners[elements]).reshape(-1, 3)
            low, high = places.min(axis=0), places.max(axis=0)
            gap = np.linalg.norm(pieces.middle - pieces.middle.clip(low, high), axis=1)
            of = np.flatnonzero(gap <= reach)
            h = pieces.width[of]
            squared = scipy.spatial.distance.cdist(places, pieces.middle[of], "sqeuclidean")
            value = np.exp(squared * (-0.5 / h**2))
            value[squared > reach[of] ** 2] = 0.0
            volume = (rule * _jacobians(natural, corners[elements])).ravel()
            value *= volume[:, None]
            weight = value.reshape(len(elements), len(rule), len(of)).sum(axis=1) / ((2.0 * np.pi) ** 1.5 * h**3)
            share_inside[of] += weight.sum(axis=0)
            integral[elements] += weight @ outer[of]
    return integral, share_inside


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
