"""The airway from the glottis to the lips: its midline, and the areas across it.

Between tongue or jaw on one side and palate, velum and the wall of the pharynx on the other, areas are cut out of the surfaces.
The larynx, the space behind the epiglottis and the lips are assumed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from explicitfe.fem.mesh.triangles import corners_of, surface_triangles
from explicitfe.platform.errors import InputError
from explicitfe.results.files import Recorded
from explicitfe.results.files.airway_table import AirwayTable, WallTable
from explicitfe.results.measure.bodies import roof_of, tongue_of, value_of_palate
from explicitfe.results.measure.document import AirwayRegion
from explicitfe.results.measure.sections import X, Z, middle
from explicitfe.results.measure.tract import (
    COLUMN_WIDTH_M,
    PALATE,
    SAME_POINT_M,
    TOUCHING_GAP_M,
    SectionPlane,
    columns,
    crossings,
    lengths_along,
    midsagittal_lines,
    palate_midline,
)

JAW_BONE = "jaw"
# The midline is drawn through points this far apart, smoothed over this length, in so many rounds.
POINT_SPACING_M = 1e-3
MIDLINE_SMOOTHING_M = 5e-3
MIDLINE_ROUNDS = 4
# Areas are cut no further apart than this.
AREA_SPACING_M = 3e-3
# Across the midline surfaces are looked for no further than this, and an overlap is no deeper than that.
ACROSS_REACH_M = 30e-3
OVERLAP_REACH_M = 4e-3
# Triangles of the wall: so many columns from the middle to a side, and rows no further apart than this.
WALL_COLUMNS = 12
WALL_ROW_M = 2.5e-3


class Surroundings(NamedTuple):
    """Surfaces that bound the air.

    Attributes
    ----------
    outer, inner : (m, 3 corners, 3) m. Triangles of palate and wall, and of tongue and jaw.
    line : (k, 2) x and z, m. The outer side in the midsagittal plane, from the lower end of the wall to the edge of the incisors.
    incisors : (2, 2) x and z, m. The edge of the upper incisors, and below it that of the lower ones, or the tongue where it lies
        between them; None without a jaw.
    middle : y of the midsagittal plane, m.
    lowest : z of the lowest section, m.
    """

    outer: np.ndarray
    inner: np.ndarray
    line: np.ndarray
    incisors: np.ndarray | None
    middle: float
    lowest: float


class CutSection(NamedTuple):
    """A section: where its plane is, and its area in m2, None where one side of the airway is not met in its middle.

    ``span`` is where both sides are in the midsagittal plane, m from the midline towards the tongue; not finite where not met.
    """

    plane: SectionPlane
    span: tuple[float, float]
    area: float | None
    region: AirwayRegion


def airway_table(result: Recorded) -> AirwayTable:
    """The table of the airway that a run has stored.

    Raises
    ------
    InputError : the run has stored none.
    """
    stored = result.model.get("airway")
    if stored is None:
        raise InputError(f"{result.path} has no airway: it requires the built-in tongue in this version; run the scenario again.")
    return AirwayTable.model_validate(stored)


def surroundings(result: Recorded, step: int, table: AirwayTable) -> Surroundings:
    """Surfaces that bound the air at a stored sample.

    Raises
    ------
    InputError : the run had no bone called "palate".
    """
    if PALATE not in result.bones:
        raise InputError(f'{result.path} has no airway: it requires a [[bone]] named "{PALATE}"; add it to the scenario.')
    (mesh, displacement), bones = tongue_of(result, step), result.placed_bones(step)
    tongue, _ = surface_triangles(mesh, mesh.points + displacement)
    jaw = corners_of(*bones[JAW_BONE]) if JAW_BONE in bones else tongue[:0]
    roof = roof_of(result, step, bones[PALATE])
    shift = 1e-3 * np.array(value_of_palate(result, "shift_mm") or np.zeros(3))  # the wall goes with the palate
    around = bounds_of_air(tongue, roof, jaw, table, middle(mesh), shift)
    if around is None:
        raise InputError(f'{result.path} has no airway, because its "{PALATE}" does not cross the midsagittal plane.')
    return around


def bounds_of_air(
    tongue: np.ndarray, palate: np.ndarray, jaw: np.ndarray, table: AirwayTable, plane: float, shift: np.ndarray
) -> Surroundings | None:
    """Surfaces (m, 3 corners, 3) m as they bound the air; None if the palate does not cross the midsagittal plane y = ``plane``.

    Parameters
    ----------
    jaw : without a triangle if there is none.
    shift : (3,) m, of the walls of the pharynx from their place in ``table``.
    """
    wall, wall_line = wall_surface(table.wall)
    front = palate_midline(palate, plane)
    if front is None:
        return None
    velum = front.points[::-1]
    wall_line = wall_line + shift[[X, Z]]
    inner = np.concatenate([tongue, jaw])
    edges = midsagittal_lines(jaw, plane).reshape(-1, 2)
    return Surroundings(
        outer=np.concatenate([palate, wall + shift + np.array([0.0, plane, 0.0])]),
        inner=inner,
        line=np.concatenate([wall_line[wall_line[:, 1] < velum[0, 1]], velum]),
        incisors=_gap(velum[-1], edges[edges[:, 1].argmax()], midsagittal_lines(inner, plane)) if len(edges) else None,
        middle=plane,
        lowest=1e-3 * table.larynx.lowest_section_mm + float(shift[Z]),
    )


def wall_surface(table: WallTable) -> tuple[np.ndarray, np.ndarray]:
    """The wall of the pharynx as triangles (m, 3 corners, 3) m around y = 0, and its midsagittal line (k, 2) from below, m.

    Between the figures: monotone cubic interpolation (PCHIP), along |y| and then along z.
    """
    height, y = np.array(table.height_mm), np.array(table.y_mm)
    rows = np.linspace(height[0], height[-1], int(np.ceil(np.ptp(height) / (1e3 * WALL_ROW_M))) + 1)
    half_width = scipy.interpolate.PchipInterpolator(height, table.half_width_mm)(rows)
    share = np.linspace(-1.0, 1.0, 2 * WALL_COLUMNS + 1)
    back = scipy.interpolate.PchipInterpolator(height, np.array(table.back_mm), axis=0)(rows)
    side = half_width[:, None] * share
    even = scipy.interpolate.PchipInterpolator(np.concatenate([-y[:0:-1], y]), np.hstack([back[:, :0:-1], back]), axis=1)
    x = np.stack([even(at)[number] for number, at in enumerate(np.clip(side, -y[-1], y[-1]))])
    points = 1e-3 * np.stack([x, side, np.broadcast_to(rows[:, None], x.shape)], axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    triangles = np.concatenate([np.stack(corners, axis=-2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])
    return triangles, points[:, WALL_COLUMNS, [X, Z]]


def airway_midline(around: Surroundings) -> np.ndarray:
    """The midline (k, 2) of the air that is cut, x and z in m, from the lowest section to the incisors, in equal steps.

    It begins as the outer side. In each round its points move half way between what is met across it on both sides, and it is
    smoothed. It ends half way between the incisors; without a jaw where nothing is met on the inner side.
    """
    outer, inner = (midsagittal_lines(triangles, around.middle) for triangles in (around.outer, around.inner))
    line = _resampled(around.line)
    for _ in range(MIDLINE_ROUNDS):
        along = _directions(_smoothed(line))
        low, high = _across(line, along, outer, inner)
        is_met = np.isfinite(low) & np.isfinite(high)
        moved = line[is_met] + 0.5 * (low[is_met] + high[is_met])[:, None] * _inwards(along[is_met])
        if around.incisors is not None:
            moved = _up_to(moved, *around.incisors)
        line = _resampled(_smoothed(moved))
    first = int(np.argmax(line[:, 1] >= around.lowest))
    if first == 0:
        return line
    share = (around.lowest - line[first - 1, 1]) / (line[first, 1] - line[first - 1, 1])
    start = line[first - 1] + share * (line[first] - line[first - 1])
    return _resampled(np.concatenate([start[None], line[first:]]))


def cut_sections(line: np.ndarray, around: Surroundings) -> list[CutSection]:
    """The sections across the midline (k, 2) m, in the middle of equal parts of it."""
    length = lengths_along(line)
    parts = int(np.ceil(length[-1] / AREA_SPACING_M))
    places = length[-1] * (np.arange(parts) + 0.5) / parts
    along = _directions(_smoothed(line))
    outer, inner = (midsagittal_lines(triangles, around.middle) for triangles in (around.outer, around.inner))
    cuts = []
    for place in places:
        x, z = (np.interp(place, length, column) for column in line.T)
        tangent = np.array([np.interp(place, length, column) for column in along.T])
        tangent = tangent / np.linalg.norm(tangent)
        inwards = _inwards(tangent)
        plane = SectionPlane(
            np.array([x, 0.0, z]), np.array([tangent[0], 0.0, tangent[1]]), np.array([inwards[0], 0.0, inwards[1]])
        )
        area = open_area(plane, around)
        # The wall of the pharynx goes up, the palate forward.
        region: AirwayRegion = "pharynx" if abs(tangent[1]) > abs(tangent[0]) and x > around.line[:, 0].mean() else "mouth"
        low, high = _across(np.array([[x, z]]), tangent[None], outer, inner)
        cuts.append(CutSection(plane, (float(low[0]), float(high[0])), area, region))
    return cuts


def open_area(plane: SectionPlane, around: Surroundings) -> float | None:
    """The air in a plane across the midline, m2: what is open by more than surfaces that touch leave between them.

    None where the plane does not meet both sides of the airway in the middle. To both sides it reaches as far as on the wider
    one: where half of a tongue was taken out, the air in its place counts, down to the floor of the mouth.
    """
    section = columns(plane, around.outer, around.inner, around.middle)
    inside = section.inside | section.inside[::-1]
    if not len(inside) or not inside[np.abs(section.y) < COLUMN_WIDTH_M].all():
        return None
    gap = np.where(inside, section.tongue - section.palate, 0.0)
    return COLUMN_WIDTH_M * float(gap[gap >= TOUCHING_GAP_M].sum())


def _across(points: np.ndarray, along: np.ndarray, outer: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far across the midline, to the inner side, the outer and the inner lines (k, 2 ends, 2) are met, (p,) m each.

    ``points`` and ``along`` (p, 2) are of the midline. Not finite where nothing is met.
    """
    across = _inwards(along)
    met = []
    for lines in (outer, inner):
        from_points = lines - points[:, None, None]
        a, b = np.moveaxis(np.einsum("pkei,pi->pke", from_points, along), 2, 0)
        low, high = np.moveaxis(np.einsum("pkei,pi->pke", from_points, across), 2, 0)
        # Neighbouring lines end in the same point but for rounding: none passes between them.
        passes = (np.minimum(a, b) <= SAME_POINT_M) & (np.maximum(a, b) >= -SAME_POINT_M)
        with np.errstate(divide="ignore", invalid="ignore"):
            met.append(np.where(passes, low + np.clip(-a / (b - a), 0.0, 1.0) * (high - low), np.nan))
    above, below = met
    above = np.where((above >= -ACROSS_REACH_M) & (above <= OVERLAP_REACH_M), above, -np.inf)
    below = np.where((below >= -OVERLAP_REACH_M) & (below <= ACROSS_REACH_M), below, np.inf)
    return above.max(axis=1, initial=-np.inf), below.min(axis=1, initial=np.inf)


def _gap(upper: np.ndarray, lower: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """The point ``upper`` and the first on the way to ``lower`` where lines (k, 2 ends, 2) are met, (2, 2)."""
    height = float(np.linalg.norm(lower - upper))
    down = (lower - upper) / height
    met = crossings((lines - upper) @ np.array([[down[1], down[0]], [-down[0], down[1]]]), np.zeros(1))[0]
    return np.stack([upper, upper + down * met[(met >= 0.0) & (met <= height)].min(initial=height)])


def _up_to(line: np.ndarray, upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """The line (k, 2) up to the gap between two edges (2,), and the middle of that gap as its end."""
    end, across = 0.5 * (upper + lower), lower - upper
    ahead = (line - end) @ np.array([across[1], -across[0]]) / np.linalg.norm(across)
    return np.concatenate([line[ahead < -POINT_SPACING_M], end[None]])


def _inwards(tangent: np.ndarray) -> np.ndarray:
    """The direction across the midline to the tongue, (..., 2)."""
    return np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)


def _resampled(line: np.ndarray) -> np.ndarray:
    """The line through points (k, 2) in equal steps."""
    length = lengths_along(line)
    places = np.linspace(0.0, length[-1], int(np.ceil(length[-1] / POINT_SPACING_M)) + 1)
    return np.column_stack([np.interp(places, length, column) for column in line.T])


def _smoothed(line: np.ndarray) -> np.ndarray:
    """The line smoothed by a Gaussian; its ends stay, for it is continued by its own image turned about them."""
    width = MIDLINE_SMOOTHING_M / POINT_SPACING_M
    beyond = min(len(line) - 1, int(np.ceil(4.0 * width)))
    before, after = 2.0 * line[0] - line[beyond:0:-1], 2.0 * line[-1] - line[-2 : -2 - beyond : -1]
    return scipy.ndimage.gaussian_filter1d(np.concatenate([before, line, after]), width, axis=0)[beyond : beyond + len(line)]


def _directions(line: np.ndarray) -> np.ndarray:
    along = np.gradient(line, axis=0)
    return along / np.linalg.norm(along, axis=1)[:, None]
