"""Muscle fibres as polylines of material points, and location of positions in a mesh."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from explicitfe.fem.mesh.bent_block import ContourMap, check_cells, mirror
from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, MaterialPoints, shape_functions
from explicitfe.platform.errors import InputError, nearest

# The passes of a search: which elements each tries, counted by the distance of their centres, and from where in them. The
# first ends it for most points, the second for large elements among small ones, the third where a nearly degenerate
# element leads Newton astray from its centre.
_SEARCH_PASSES = ((0, 8, np.zeros((1, 3))), (8, 64, np.zeros((1, 3))), (0, 32, 0.7 * CORNERS))

# A point is located when it is reached up to this share of the size of the mesh or of its element, which is rounding.
_REACHED_SHARE = 1e-10

# How far natural coordinates may pass [-1, 1]: a curved surface and the flat elements that stand for it differ by about that.
OUTSIDE_TOLERANCE = 0.5

_NEWTON_STEPS = 20

# Newton's method runs for so many pairs of a point and an element at a time.
_TRIED_TOGETHER = 512


@dataclass(frozen=True)
class Fibre:
    """One line of k material points, origin first.

    Attributes
    ----------
    points : the points; those with element -1 are fixed in space (on a bone outside the tongue).
    side : 'left' or 'right'.
    segment_element : (k - 1,) int64. The element that holds the middle of each segment; -1: an end of it is fixed in
        space.
    relative_tension : (k - 1,) tension of each segment over the fibre's mean, where muscle acts as stress; uniform if None.
    """

    points: MaterialPoints
    side: str
    segment_element: np.ndarray
    relative_tension: np.ndarray | None = None

    @classmethod
    def through(cls, points: MaterialPoints, side: str, mesh: HexMesh, relative_tension: np.ndarray | None = None) -> Fibre:
        """The fibre through points of any mesh: the elements of its segments are searched for.

        Raises
        ------
        InputError
            A segment leaves the mesh.
        """
        inside = (points.element[:-1] >= 0) & (points.element[1:] >= 0)
        middle = 0.5 * (points.position[:-1] + points.position[1:])
        segment_element = np.full(len(inside), -1)
        # Along a hollow surface the middle of a long segment may well lie an element outside.
        segment_element[inside] = locate_in_mesh(mesh, middle[inside], tolerance=2.0).element
        return cls(points, side, segment_element, relative_tension)


@dataclass(frozen=True)
class MuscleTissue:
    """The elements of a muscle, where its stress is uniform.

    Attributes
    ----------
    elements : (k,).
    direction : (k, 3) unit vectors.
    fibre : (k,) place of the fibre that is nearest to each, in the muscle's list.
    """

    elements: np.ndarray
    direction: np.ndarray
    fibre: np.ndarray


@dataclass(frozen=True, eq=False)
class Muscle:
    """One muscle of both sides; never changed, and equal only to itself.

    Attributes
    ----------
    name, title : as in 'GGp' and its full name.
    max_force_N : N. Reference maximum of its force, both sides together, shared by all fibres.
    fibres : the right side first, then, in the same order, its mirror image, when read by ``read_muscles``.
    elements : (k,) int64, sorted. The elements that its fibres run through.
    action : what it does, in a line.
    origin_width_m : m. How wide the stress of a fibre is spread at its origin, where fibres converge; as elsewhere if None.
    parts : names of the muscles of the same model that it consists of; empty for one that is not a whole of others.
    tissue : the elements of a muscle that is given by them, as its body counts them; None for one that is given by fibres.
    """

    name: str
    title: str
    max_force_N: float
    fibres: tuple[Fibre, ...]
    elements: np.ndarray
    action: str = ""
    origin_width_m: float | None = None
    parts: tuple[str, ...] = ()
    tissue: MuscleTissue | None = None

    @classmethod
    def of(
        cls,
        name: str,
        title: str,
        max_force_N: float,
        fibres: tuple[Fibre, ...],
        action: str = "",
        origin_width_m: float | None = None,
    ) -> Muscle:
        """The muscle of these fibres: its elements are those of their segments."""
        elements = np.unique(np.concatenate([fibre.segment_element for fibre in fibres]))
        return cls(name, title, max_force_N, fibres, elements[elements >= 0], action, origin_width_m)

    def chosen(self, side: str = "both", numbers: Sequence[int] | None = None) -> list[Fibre]:
        """The fibres on a side, 'both', 'left' or 'right', or of them those with these numbers, counted from 1 on each side.

        Raises
        ------
        InputError
            There is none on that side, or none of that number.
        """
        sides = ("right", "left") if side == "both" else (side,)
        fibres = [[fibre for fibre in self.fibres if fibre.side == of] for of in sides]
        most = max(len(of_side) for of_side in fibres)
        if most == 0:
            raise InputError(f'muscle {self.name} has no fibre on the {side} side; use side = "both".')
        if numbers is None:
            return [fibre for fibre in self.fibres if fibre.side in sides]
        for number in numbers:
            if not 1 <= number <= most:
                raise InputError(f"muscle {self.name} has no fibre {number}: its fibres are numbered from 1 to {most} on a side.")
        return [fibre for of_side in fibres for number, fibre in enumerate(of_side, start=1) if number in numbers]


def read_muscles(path: Path | str, contour_map: ContourMap, cells: Sequence[int]) -> dict[str, Muscle]:
    """The muscles of a file in the mesh of ``contour_map`` with these cells; the format stands at the top of the file.

    Every straight piece of a fibre is cut evenly so that no segment is longer than one element along s, t or w: the
    points of the table stay, the fibre follows the mesh, and there are about as many points as elements along it.

    Returns
    -------
    dict
        name -> Muscle, in the order of the file. The left side is the exact mirror image of the right.

    Raises
    ------
    InputError
        The file cannot be read, a key is unknown or missing, a fibre has no length, lies outside the tongue or on the
        left side.
    """
    path = Path(path)
    cells = check_cells(cells)
    try:
        with path.open("rb") as file:
            tables = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}.") from error
    muscles: dict[str, Muscle] = {}
    for name, table in tables.items():
        where = f"{path}: muscle {name}"
        whole = "parts" in table
        muscles[name] = _whole(name, table, where, muscles) if whole else _muscle(name, table, where, contour_map, cells)
    return muscles


def _whole(name: str, table: Mapping[str, object], where: str, muscles: Mapping[str, Muscle]) -> Muscle:
    """The muscle that earlier muscles of a file are parts of: their fibres, and the sum of their largest forces."""
    for key in sorted({*table} ^ {"title", "action", "parts"}):
        raise InputError(
            f'{where}: a muscle with parts has the keys "title", "action" and "parts"; "{key}" is missing or unknown.'
        )
    names = table["parts"]
    if not isinstance(names, list) or not names or not all(isinstance(part, str) for part in names):
        raise InputError(f"{where}: parts must be a list of names of muscles, not {names!r}.")
    for part in names:
        if part not in muscles:
            raise InputError(f'{where}: no muscle "{part}" stands before it; {nearest(part, muscles)}')
    parts = [muscles[part] for part in names]
    fibres = [fibre for side in ("right", "left") for part in parts for fibre in part.chosen(side)]
    force_N = sum(part.max_force_N for part in parts)
    whole = Muscle.of(name, str(table["title"]), force_N, tuple(fibres), str(table["action"]), parts[0].origin_width_m)
    return replace(whole, parts=tuple(names))


def _muscle(name: str, table: Mapping[str, Any], where: str, contour_map: ContourMap, cells: tuple[int, int, int]) -> Muscle:
    required = ("title", "action", "max_force_N", "fibres")
    optional = ("anchor_mm", "origin_width_mm", "scaled_with_section")
    for key in table:
        if key not in required + optional:
            raise InputError(f'{where}: unknown key "{key}"; {nearest(key, required + optional)}')
    for key in required:
        if key not in table:
            raise InputError(f'{where}: the key "{key}" is missing.')
    force = _positive(table["max_force_N"], f"{where}: max_force_N must be a positive number of newtons")
    origin_width = None
    if "origin_width_mm" in table:
        origin_width = 1e-3 * _positive(table["origin_width_mm"], f"{where}: origin_width_mm must be a positive number of mm")
    scaled = table.get("scaled_with_section", False)
    if not isinstance(scaled, bool):
        raise InputError(f"{where}: scaled_with_section must be true or false, not {scaled!r}.")
    if not table["fibres"]:
        raise InputError(f"{where}: a muscle needs at least one fibre.")
    anchors = _anchors(table["anchor_mm"], len(table["fibres"]), where) if "anchor_mm" in table else None

    fibres, mirrored = [], []
    for number, row in enumerate(table["fibres"], start=1):
        line = _rows(row, f"{where}: fibre {number}")
        if len(line) < 2 or (np.diff(line, axis=0) == 0.0).all(axis=1).any():
            raise InputError(f"{where}: fibre {number} needs at least two points, and successive points must differ.")
        if (line[:, 2] < 0.0).any():
            raise InputError(f"{where}: fibre {number} has w < 0; define the right side only, the left side is its mirror image.")
        line = _refine(line, cells)
        try:
            points = contour_map.locate(line, cells)
        except InputError as error:
            raise InputError(f"{where}: fibre {number}: {error}") from error
        halfway = 0.5 * (line[:-1] + line[1:])
        middle = contour_map.locate(halfway, cells)
        tension = over_mean(contour_map.thickness(halfway), points) if scaled else None
        if anchors is not None:
            points, middle = (_from_anchor(anchors[number - 1], one) for one in (points, middle))
            tension = None if tension is None else np.append(1.0, tension)
        fibres.append(Fibre(points, "right", middle.element, tension))
        mirrored.append(Fibre(mirror(points, cells), "left", mirror(middle, cells).element, tension))
    return Muscle.of(name, str(table["title"]), force, (*fibres, *mirrored), str(table["action"]), origin_width)


def over_mean(values: np.ndarray, points: MaterialPoints) -> np.ndarray:
    """Values of the segments (k - 1,) of a line of points (k), over their mean along it: what a fibre's relative tension is."""
    lengths = np.linalg.norm(np.diff(points.position, axis=0), axis=1)
    return np.asarray(values * lengths.sum() / (values @ lengths))


def _positive(value: object, message: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < np.inf:
        raise InputError(f"{message}, not {value!r}.")
    return float(value)


def _anchors(values: object, fibres: int, where: str) -> np.ndarray:
    """(fibres, 3) m: one anchor for all fibres, or one for each."""
    if not isinstance(values, list) or not values or not isinstance(values[0], list):
        values = [values] * fibres
    rows = _rows(values, f"{where}: anchor_mm")
    if len(rows) != fibres:
        raise InputError(f"{where}: anchor_mm has {len(rows)} points for {fibres} fibres; give one for all, or one for each.")
    return 1e-3 * rows


def _rows(values: object, where: str) -> np.ndarray:
    """(k, 3) finite numbers."""
    try:
        rows = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: must be points of three numbers.") from error
    if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
        raise InputError(f"{where}: must be points of three finite numbers.")
    return rows


def _refine(line: np.ndarray, cells: tuple[int, int, int]) -> np.ndarray:
    """The line (k, 3) in (s, t, w) with every piece cut evenly into segments of at most one element."""
    # w runs over two units.
    per_unit = np.array(cells) * [1.0, 1.0, 0.5]
    # Rounding must not cut a piece of exactly one element in two.
    counts = np.ceil(np.abs(np.diff(line, axis=0) * per_unit).max(axis=1) - 1e-9).astype(int).clip(min=1)
    pieces = [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(line[:-1], line[1:], counts, strict=True)]
    return np.concatenate([*pieces, line[-1:]])


def _from_anchor(anchor: np.ndarray, points: MaterialPoints) -> MaterialPoints:
    return MaterialPoints(
        element=np.concatenate([[-1], points.element]),
        natural=np.concatenate([np.zeros((1, 3)), points.natural]),
        position=np.concatenate([anchor[None], points.position]),
    )


def locate_in_mesh(mesh: HexMesh, positions: np.ndarray, tolerance: float = OUTSIDE_TOLERANCE) -> MaterialPoints:
    """The elements that hold positions, (k, 3), m, in any hex mesh: the inverse of the trilinear map, by Newton.

    A position outside the mesh moves to the element that it is nearest to, as long as its natural coordinates there do
    not pass [-1, 1] by more than ``tolerance``. The returned position is then the one in the mesh.

    Raises
    ------
    InputError
        A position is further outside, or not finite.
    """
    positions = np.asarray(positions, dtype=float).reshape(-1, 3)
    not_finite = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(not_finite):
        raise InputError(f"the position of point {not_finite[0]} is not finite.")
    points, inside = points_of_mesh(mesh, positions, tolerance, thorough=True)
    far = np.flatnonzero(~inside)
    if len(far):
        point = far[0]
        x, y, z = 1e3 * positions[point]
        distance_m = np.linalg.norm(points.position[point] - positions[point])
        raise InputError(
            f"point {point} at ({x:.2f}, {y:.2f}, {z:.2f}) mm lies {1e3 * distance_m:.2f} mm outside the mesh"
            + (f", and {len(far) - 1} more points lie outside." if len(far) > 1 else ".")
        )
    return points


def points_of_mesh(
    mesh: HexMesh, positions: np.ndarray, tolerance: float = OUTSIDE_TOLERANCE, thorough: bool = False
) -> tuple[MaterialPoints, np.ndarray]:
    """The points of a mesh that are nearest to positions, (k, 3), m, and which of these the mesh holds, (k,) bool.

    ``tolerance`` is that of :func:`locate_in_mesh`; ``thorough``: of a position that lies outside all elements, but within the
    tolerance of one, all others around it are tried too, which takes many times as long.
    """
    corners = mesh.points[mesh.hexes]
    tree = scipy.spatial.cKDTree(corners.mean(axis=1))

    element = np.full(len(positions), -1)
    natural = np.zeros((len(positions), 3))
    distance = np.full(len(positions), np.inf)
    excess = np.full(len(positions), np.inf)
    reached = _REACHED_SHARE * np.ptp(mesh.points, axis=0).max()
    open_ = np.arange(len(positions))
    for first, last, starts in _SEARCH_PASSES:
        last = min(last, mesh.element_count)
        if not thorough:
            open_ = open_[~(excess[open_] <= tolerance)]
        if not len(open_) or first >= last:
            continue
        candidates = tree.query(positions[open_], k=np.arange(first + 1, last + 1))[1]
        trials = [(trial, start) for trial in range(last - first) for start in starts]
        while trials and len(open_):
            together = max(1, _TRIED_TOGETHER // len(open_))
            batch, trials = trials[:together], trials[together:]
            tried = np.concatenate([candidates[:, trial] for trial, _ in batch])
            begun = np.repeat([start for _, start in batch], len(open_), axis=0)
            wanted = np.tile(positions[open_], (len(batch), 1))
            here, converged = natural_coordinates(corners[tried], wanted, begun)
            clipped = np.clip(here, -1.0, 1.0)
            gap = np.linalg.norm(_at(corners[tried], clipped) - wanted, axis=1).reshape(len(batch), -1)
            hit = gap <= reached
            row = np.where(hit.any(axis=0), hit.argmax(axis=0), gap.argmin(axis=0))  # the first that holds it, or the nearest
            each = np.arange(len(open_))
            best = row * len(open_) + each
            better = gap[row, each] < distance[open_]
            chosen, best = open_[better], best[better]
            element[chosen], natural[chosen], distance[chosen] = tried[best], clipped[best], gap.ravel()[best]
            excess[chosen] = np.where(converged, np.abs(here).max(axis=1) - 1.0, np.inf)[best]
            still = distance[open_] > reached
            open_, candidates = open_[still], candidates[still]

    points = MaterialPoints(element=element, natural=natural, position=_at(corners[element], natural))
    return points, excess <= tolerance


def _at(corners: np.ndarray, natural: np.ndarray) -> np.ndarray:
    """Positions (k, 3) at natural coordinates (k, 3) in hexes with these corners (k, 8, 3)."""
    return np.einsum("ka,kai->ki", shape_functions(natural), corners)


def natural_coordinates(corners: np.ndarray, positions: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Natural coordinates (k, 3) of positions (k, 3) in hexes with corners (k, 8, 3), and whether Newton's method converged."""
    natural = np.array(np.broadcast_to(start, positions.shape))
    reached = _REACHED_SHARE * np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    for _ in range(_NEWTON_STEPS):
        residual = positions - _at(corners, natural)
        if (np.linalg.norm(residual, axis=1) <= 1e-3 * reached).all():
            break
        factors = 1.0 + natural[:, None, :] * CORNERS
        gradient = np.stack(
            [CORNERS[:, i] * factors[..., (i + 1) % 3] * factors[..., (i + 2) % 3] / 8.0 for i in range(3)], axis=-1
        )
        jacobian = np.einsum("kai,kaj->kij", corners, gradient)
        # The search stays in a neighbourhood of the element: further away a distorted hex may fold, and Newton's method would
        # wander off. As the Jacobian may vanish in it, its pseudo-inverse is taken.
        step = np.einsum("kij,kj->ki", np.linalg.pinv(jacobian), residual)
        natural = np.clip(natural + np.clip(step, -1.0, 1.0), -4.0, 4.0)
    return natural, np.linalg.norm(positions - _at(corners, natural), axis=1) <= reached
