"""Air between tongue and palate: the constriction, and cross-sections along the palate.

The palate's midline is its underside in the midsagittal plane, from the edge of the incisors backwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.triangles import plane_segments, segments_of_planes, surface_triangles
from explicitfe.platform.host.kept import kept
from explicitfe.results.measure.document import Constriction, TractSection
from explicitfe.results.measure.sections import X, Y, Z, middle

# The bone that makes a vocal tract with the tongue.
PALATE = "palate"
# The underside of the palate is sampled at these distances along x.
MIDLINE_STEP_M = 0.5e-3
# The edge of the incisors is the lowest point of the underside within this length from its front end.
INCISORS_WITHIN_M = 15e-3
# Sections follow each other at this distance; their plane stands across the chord that reaches so far to both sides.
SECTION_STEP_M = 5e-3
HALF_CHORD_M = 2.5e-3
# Sections are integrated over columns of this width, left to right. What of the palate lies further than this across the
# midline belongs to another place along it.
COLUMN_WIDTH_M = 0.1e-3
PALATE_REACH_M = 25e-3
# The crest of the dental arch is where the underside comes first within this of its lowest place.
CREST_TOLERANCE_M = 0.05e-3
# The tongue's sides end where it lies further than this below both its midline and the crest of the arch on that side.
SIDE_DROP_M = 5e-3
# Points as near as this are one.
SAME_POINT_M = 1e-12
# The tongue touches where less than this is free: it rests on a smoothed surface, with flat faces.
TOUCHING_GAP_M = 0.3e-3


class MidlineCurve(NamedTuple):
    """The midline of the palate: ``points`` (k, 2), x and z in m, and the ``length`` (k,) along it from the incisor edge, m."""

    points: np.ndarray
    length: np.ndarray

    def at(self, length_m: np.ndarray | float) -> np.ndarray:
        """Points (..., 2) at lengths (...); before the first and behind the last it is that."""
        return np.stack([np.interp(length_m, self.length, column) for column in self.points.T], axis=-1)


class Nearest(NamedTuple):
    """The smallest distance of tongue and palate in the midsagittal plane.

    ``width`` m, 0 where they touch; ``place`` m along the palate; the points (2,), x and z in m, on both.
    """

    width: float
    place: float
    on_palate: np.ndarray
    on_tongue: np.ndarray


class SectionPlane(NamedTuple):
    """A plane across a midline: a point of it, its normal along the midline, and the direction in it to the tongue; (3,) each."""

    point: np.ndarray
    normal: np.ndarray
    down: np.ndarray


class Roof(NamedTuple):
    """The palate in a section: ``y`` (c,) m of columns, ``underside`` (c,) m below the midline; NaN where there is none."""

    y: np.ndarray
    underside: np.ndarray


class Column(NamedTuple):
    """A section in columns: ``y`` (c,) m, ``palate`` and ``tongue`` (c,) m below the midline; NaN where there is none.

    ``inside`` says which lie inside of the dental arch.
    """

    y: np.ndarray
    palate: np.ndarray
    tongue: np.ndarray
    inside: np.ndarray


def constriction(mesh: HexMesh, displacement: np.ndarray, palate_rest: np.ndarray, palate_now: np.ndarray) -> Constriction | None:
    """The constriction now and at rest; None where the midsagittal plane misses tongue or palate.

    Parameters
    ----------
    palate_rest, palate_now : (m, 3 corners, 3) m. Triangles of the palate at rest and where it is now.
    """
    plane = middle(mesh)
    rest_line, line = palate_midline(palate_rest, plane), palate_midline(palate_now, plane)
    tongue, _ = surface_triangles(mesh, mesh.points + displacement)
    if line is None or rest_line is None:
        return None
    now, at_rest = narrowest(line, tongue, plane), _narrowest_at_rest(rest_line, mesh, plane)
    if now is None or at_rest is None:
        return None
    above = roofs(line, palate_now, plane)
    cuts = _in_sections(tongue, [cut for _, cut, _ in above], plane)
    sections = [section_between(_between(over, lines), place) for (place, _, over), lines in zip(above, cuts, strict=True)]
    channels = [(each.channel_mm2, each.place_mm) for each in sections if each.channel_mm2 is not None]
    area, place = min(channels, default=(None, None))
    return Constriction(
        width_mm=1e3 * now.width,
        place_mm=1e3 * now.place,
        width_at_rest_mm=1e3 * at_rest.width,
        place_at_rest_mm=1e3 * at_rest.place,
        smallest_channel_mm2=area,
        smallest_channel_place_mm=place,
        sections=sections,
    )


@kept(8)
def palate_midline(palate: np.ndarray, plane: float) -> MidlineCurve | None:
    """The underside of a palate (m, 3 corners, 3) m in the plane y = ``plane``; None where it is not cut."""
    lines = midsagittal_lines(palate, plane)
    if not len(lines):
        return None
    first, last = lines[:, :, 0].min(), lines[:, :, 0].max()
    x = np.linspace(first, last, max(2, int(np.ceil((last - first) / MIDLINE_STEP_M)) + 1))
    z = np.fmin.reduce(crossings(lines, x), axis=1)
    x, z = x[np.isfinite(z)], z[np.isfinite(z)]
    start = int(np.argmin(np.where(x <= x[0] + INCISORS_WITHIN_M, z, np.inf)))
    points = np.column_stack([x, z])[start:]
    return MidlineCurve(points, lengths_along(points))


def midsagittal_lines(triangles: np.ndarray, plane: float) -> np.ndarray:
    """Segments (k, 2 ends, 2), x and z, where the plane y = ``plane`` cuts triangles (m, 3 corners, 3) m."""
    return plane_segments(triangles, np.array([0.0, plane, 0.0]), np.array([0.0, 1.0, 0.0]))[:, :, [X, Z]]


def lengths_along(line: np.ndarray) -> np.ndarray:
    """Length (k,) of the line through points (k, 2) up to each of them."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def narrowest(line: MidlineCurve, tongue: np.ndarray, plane: float) -> Nearest | None:
    """Smallest midsagittal distance of a tongue (m, 3 corners, 3) m from the palate; None where the plane misses the tongue.

    Where they overlap the distance is 0, and the place is that of the deepest overlap.
    """
    lines = midsagittal_lines(tongue, plane)
    if not len(lines):
        return None
    # Two lines that do not cross are nearest at a corner of one of them.
    of_palate, on_tongue = _feet(line.points, lines)
    outline, height = crossings(lines, line.points[:, 0]), line.points[:, 1]
    overlapped = (np.fmin.reduce(outline, axis=1) < height) & (height < np.fmax.reduce(outline, axis=1))
    of_palate = np.where(overlapped, -of_palate, of_palate)
    corners = lines.reshape(-1, 2)
    of_tongue, on_palate = _feet(corners, np.stack([line.points[:-1], line.points[1:]], axis=1))
    ceiling = np.interp(corners[:, 0], line.points[:, 0], line.points[:, 1], left=np.inf, right=np.inf)
    of_tongue = np.where(corners[:, 1] > ceiling, -of_tongue, of_tongue)
    if of_palate.min() <= of_tongue.min():
        k = int(of_palate.argmin())
        return Nearest(max(0.0, float(of_palate[k])), float(line.length[k]), line.points[k], on_tongue[k])
    k = int(of_tongue.argmin())
    foot = on_palate[k]
    before = int(np.clip(np.searchsorted(line.points[:, 0], foot[0], side="right") - 1, 0, len(line.points) - 1))
    place = float(line.length[before] + np.linalg.norm(foot - line.points[before]))
    return Nearest(max(0.0, float(of_tongue[k])), place, foot, corners[k])


@kept(8)
def _narrowest_at_rest(line: MidlineCurve, mesh: HexMesh, plane: float) -> Nearest | None:
    return narrowest(line, surface_triangles(mesh, mesh.points)[0], plane)


def section_places(line: MidlineCurve) -> np.ndarray:
    """Where sections are taken, m from the incisor edge: every 5 mm, as far as the chord across which they stand fits in."""
    return SECTION_STEP_M * np.arange(1, int(np.ceil((line.length[-1] - HALF_CHORD_M) / SECTION_STEP_M)))


def section_plane(line: MidlineCurve, place: float) -> SectionPlane:
    """The plane across the midline of the palate at ``place``."""
    x, z = line.at(place)
    along = line.at(place + HALF_CHORD_M) - line.at(place - HALF_CHORD_M)
    back, up = along / np.linalg.norm(along)
    return SectionPlane(np.array([x, 0.0, z]), np.array([back, 0.0, up]), np.array([up, 0.0, -back]))


def columns(cut: SectionPlane, palate: np.ndarray, tongue: np.ndarray, plane: float) -> Column:
    """The section in a plane across the midline in columns, between a palate and a tongue of triangles (m, 3 corners, 3) m."""
    return _between(roof(cut, palate, plane), _in_sections(tongue, [cut], plane)[0])


def roof(cut: SectionPlane, palate: np.ndarray, plane: float) -> Roof:
    """The underside of a palate (m, 3 corners, 3) m in a plane across the midline."""
    lines = _in_sections(palate, [cut], plane)[0]
    half = int(np.ceil(np.abs(lines[:, :, 0]).max(initial=0.0) / COLUMN_WIDTH_M))
    y = COLUMN_WIDTH_M * (np.arange(-half, half) + 0.5)
    return Roof(y, outermost(lines, y, np.maximum, PALATE_REACH_M))


@kept(8)
def roofs(line: MidlineCurve, palate: np.ndarray, plane: float) -> tuple[tuple[float, SectionPlane, Roof], ...]:
    """Of each section along a midline its place, its plane, and the palate in it."""
    cuts = [(float(place), section_plane(line, place)) for place in section_places(line)]
    return tuple((place, cut, roof(cut, palate, plane)) for place, cut in cuts)


def _in_sections(triangles: np.ndarray, cuts: Sequence[SectionPlane], plane: float) -> list[np.ndarray]:
    """Lines (k, 2 ends, 2) where each section cuts triangles: y m from the midsagittal plane, and m below the midline."""
    if not cuts:
        return []
    of_planes = segments_of_planes(triangles, np.array([cut.point for cut in cuts]), np.array([cut.normal for cut in cuts]))
    return [
        np.stack([lines[:, :, Y] - plane, (lines - cut.point) @ cut.down], axis=-1)
        for lines, cut in zip(of_planes, cuts, strict=True)
    ]


def _between(above: Roof, tongue: np.ndarray) -> Column:
    """A section in columns, between a palate and the lines (k, 2 ends, 2) of a tongue there."""
    y, underside = above
    top = outermost(tongue, y, np.minimum)
    inside = np.zeros(len(y), dtype=bool)
    midline = float(np.mean(top[np.abs(y) < COLUMN_WIDTH_M])) if len(y) else np.nan
    for side in (y < 0.0, y > 0.0):
        if not np.isfinite(underside[side]).any() or not np.isfinite(midline):
            continue
        crest = np.nanmax(underside[side])
        inside |= side & (top <= max(crest, midline) + SIDE_DROP_M)
        if crest > CREST_TOLERANCE_M:  # else the side hangs no lower than the midline: there is no arch
            inside &= ~side | (np.abs(y) <= np.abs(y[side & (underside >= crest - CREST_TOLERANCE_M)]).min())
    return Column(y, underside, top, inside & np.isfinite(underside))


def section_between(section: Column, place: float) -> TractSection:
    gap = np.where(section.inside, section.tongue - section.palate, 0.0)
    centre = np.abs(section.y) < COLUMN_WIDTH_M
    if not section.inside[centre].all() or not len(gap):
        return TractSection(place_mm=1e3 * place, height_mm=None, area_mm2=None, channel_mm2=None)
    free = channel(section)
    return TractSection(
        place_mm=1e3 * place,
        height_mm=1e3 * max(0.0, float(gap[centre].mean())),
        area_mm2=1e6 * COLUMN_WIDTH_M * float(np.maximum(gap, 0.0).sum()),
        channel_mm2=1e6 * COLUMN_WIDTH_M * float(np.maximum(gap[free], 0.0).sum()),
    )


def channel(section: Column) -> np.ndarray:
    """The columns (c,) of the channel over the midline: from there to both sides, as far as nothing touches inside the arch."""
    closed = ~section.inside | ~(section.tongue - section.palate >= TOUCHING_GAP_M)
    half = len(section.y) // 2
    right = ~np.logical_or.accumulate(closed[half:])
    left = ~np.logical_or.accumulate(closed[:half][::-1])[::-1]
    if not (right[0] and left[-1]):
        return np.zeros(len(closed), dtype=bool)
    return np.concatenate([left, right])


def crossings(lines: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Second coordinates (c, k) where lines (k, 2 ends, 2) pass the first coordinates ``at`` (c,); NaN where they do not."""
    (a, p), (b, q) = np.moveaxis(lines[:, 0], 1, 0), np.moveaxis(lines[:, 1], 1, 0)
    at = at[:, None]
    # Neighbouring lines end in the same point but for rounding: none passes between them.
    low, high = np.minimum(a, b) - SAME_POINT_M, np.maximum(a, b) + SAME_POINT_M
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((at - a) / (b - a), 0.0, 1.0)
        return np.where((low <= at) & (at <= high), p + share * (q - p), np.nan)


def outermost(lines: np.ndarray, at: np.ndarray, extreme: np.ufunc, within: float = np.inf) -> np.ndarray:
    """The largest or smallest second coordinate of ``crossings``, (c,); NaN where no line passes.

    Parameters
    ----------
    at : (c,) rising.
    extreme : np.maximum or np.minimum.
    within : crossings with a larger second coordinate, up or down, are passed over.
    """
    low, high = lines[:, :, 0].min(axis=1), lines[:, :, 0].max(axis=1)
    first = np.searchsorted(at, low - SAME_POINT_M, side="left")
    count = np.maximum(np.searchsorted(at, high + SAME_POINT_M, side="right") - first, 0)
    line = np.repeat(np.arange(len(lines)), count)
    column = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count) + first[line]
    (a, p), (b, q) = np.moveaxis(lines[line, 0], 1, 0), np.moveaxis(lines[line, 1], 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = p + np.clip((at[column] - a) / (b - a), 0.0, 1.0) * (q - p)
    chosen = np.abs(height) < within
    worst = -np.inf if extreme is np.maximum else np.inf
    answer = np.full(len(at), worst)
    extreme.at(answer, column[chosen], height[chosen])
    return np.where(np.isfinite(answer), answer, np.nan)


def _feet(points: np.ndarray, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (k,) of points (k, 2) from the nearest of lines (l, 2 ends, 2), and the nearest points (k, 2) on it."""
    start, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    offset = points[:, None] - start
    squared = np.maximum(np.einsum("li,li->l", along, along), np.finfo(float).tiny)
    share = np.clip(np.einsum("kli,li->kl", offset, along) / squared, 0.0, 1.0)
    feet = start + share[:, :, None] * along
    distance = np.linalg.norm(points[:, None] - feet, axis=2)
    nearest = distance.argmin(axis=1)
    row = np.arange(len(points))
    return distance[row, nearest], feet[row, nearest]
