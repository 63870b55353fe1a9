"""The 62 electrodes of an electropalatograph on a palate: eight rows from behind the incisors to the end of the hard palate.

The pattern is that of the Reading palate, as emuR (J. Harrington, ``epgplot``) stores and draws it: eight rows of eight
electrodes, but none at both ends of the first. Where the rows and columns lie on a palate is this project's choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from explicitfe.fem.mesh.triangles import plane_segments, triangle_samples
from explicitfe.platform.host.kept import kept
from explicitfe.results.measure.sections import Y, Z
from explicitfe.results.measure.tract import (
    COLUMN_WIDTH_M,
    CREST_TOLERANCE_M,
    HALF_CHORD_M,
    PALATE_REACH_M,
    MidlineCurve,
    crossings,
    section_plane,
)

ELECTRODE_ROWS, ELECTRODE_COLUMNS = 8, 8
FIRST_ROW_COLUMNS = slice(1, 7)
# The first row lies this far behind the edge of the incisors, along the midline: on the gum behind the crown, where the underside
# of the built-in palate becomes flat.
FIRST_ROW_M = 8e-3
# The last row lies at the end of the hard palate, which is so far from the edge of the incisors along the midline. It is that of
# the built-in palate: there, at x = 103 mm, the velum of models/velum begins.
HARD_PALATE_M = 60e-3
# Intervals between the rows, in equal parts: the front four rows stand half as far apart as those behind them.
ROW_INTERVALS = (1, 1, 1, 2, 2, 2, 2)
# The outermost electrodes lie at the edge of the gum, where the plate ends: this share of the height from the crest of the dental
# arch up to the midline. Beside the molars of the built-in palate that is 5 mm, the height of their crowns.
GUM_SHARE_OF_HEIGHT = 1.0 / 3.0
# The surface is sampled this densely, as far as this around the electrodes.
SAMPLE_SPACING_M = 1e-3
# A triangle faces down whose normal has at least this share of its length downwards.
FACING_SHARE = 1e-6
AROUND_ELECTRODES_M = 15e-3


class Underside:
    """The underside of a palate near its electrodes: sample points on its triangles, with their normals."""

    def __init__(self, palate: np.ndarray, box: np.ndarray) -> None:
        a, b, c = np.moveaxis(palate, 1, 0)
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal, axis=1)
        faces_down = normal[:, Z] < -FACING_SHARE * area
        self.points, triangle = triangle_samples(palate[faces_down], SAMPLE_SPACING_M, box)
        self.normal = (normal[faces_down] / area[faces_down, None])[triangle]
        self._tree = scipy.spatial.cKDTree(self.points)

    def clearance(self, points: np.ndarray) -> np.ndarray:
        """Distance (k,) m of points (k, 3) from the palate, along the normal at the nearest sample; negative inside."""
        _, nearest = self._tree.query(points)
        return np.einsum("ki,ki->k", points - self.points[nearest], self.normal[nearest])

    def normals(self, points: np.ndarray) -> np.ndarray:
        """Unit normals (k, 3) out of the palate at the samples nearest to points (k, 3)."""
        return self.normal[self._tree.query(points)[1]]


class Electrodes(NamedTuple):
    """Electrodes on a palate at rest.

    Attributes
    ----------
    position : (62, 3) m. Points of the underside, row after row, each from the speaker's left to the right.
    normal : (62, 3) Unit vectors from the palate into the mouth.
    row, column : (62,) from 0.
    row_places : (8,) m. Where the rows cross the midline, along it from the edge of the incisors.
    underside : the surface around them.
    """

    position: np.ndarray
    normal: np.ndarray
    row: np.ndarray
    column: np.ndarray
    row_places: np.ndarray
    underside: Underside


@kept(8)
def electrodes(line: MidlineCurve, palate: np.ndarray, plane: float, hard_palate_m: float | None) -> Electrodes | None:
    """Electrodes on the underside of a palate at rest; None where there is no room for eight rows.

    Parameters
    ----------
    line : the midline of the palate, in the plane y = ``plane``.
    palate : (m, 3 corners, 3) m. Its triangles.
    hard_palate_m : m. Length of the hard palate along the midline, from the edge of the incisors; None: that of the built-in
        palate. Of a surface that ends before, the last row lies 2.5 mm before its end, where a section across it fits in.
    """
    last = min(HARD_PALATE_M if hard_palate_m is None else hard_palate_m, float(line.length[-1]) - HALF_CHORD_M)
    if last <= FIRST_ROW_M:
        return None
    parts = np.concatenate([[0.0], np.cumsum(ROW_INTERVALS)])
    places = FIRST_ROW_M + (last - FIRST_ROW_M) * parts / parts[-1]
    rows = [_row(line, palate, plane, place) for place in places]
    if any(points is None for points in rows):
        return None
    grid = np.stack([points for points in rows if points is not None])
    exists = np.ones((ELECTRODE_ROWS, ELECTRODE_COLUMNS), dtype=bool)
    exists[0] = False
    exists[0, FIRST_ROW_COLUMNS] = True
    row, column = np.nonzero(exists)
    position = grid[exists]
    box = np.stack([position.min(axis=0) - AROUND_ELECTRODES_M, position.max(axis=0) + AROUND_ELECTRODES_M])
    underside = Underside(palate, box)
    return Electrodes(position, underside.normals(position), row, column, places, underside)


def _row(line: MidlineCurve, palate: np.ndarray, plane: float, place: float) -> np.ndarray | None:
    """Eight points (8, 3) m across the midline at ``place``, equally far apart along the underside; the outermost on the gum.

    The two sides are spaced each on its own; None where the palate has no underside there.
    """
    point, normal, down = section_plane(line, place)
    point = point + np.array([0.0, plane, 0.0])
    cut = plane_segments(palate, point, normal)
    lines = np.stack([cut[:, :, Y] - plane, (cut - point) @ down], axis=-1)
    half = ELECTRODE_COLUMNS // 2
    across = []
    for side in (-1.0, 1.0):
        outwards, depth = underside_to_side(lines, side)
        if len(depth) < 2:
            return None
        gum, _ = arch_lines(depth)
        outwards, depth = outwards[:gum], depth[:gum]
        length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(outwards), np.diff(depth)))])
        at = length[-1] * (np.arange(half) + 0.5) / (half - 0.5)
        y, below = np.interp(at, length, outwards), np.interp(at, length, depth)
        across.append(point + np.outer(side * y, [0.0, 1.0, 0.0]) + np.outer(below, down))
    left, right = across
    return np.concatenate([left[::-1], right])


def arch_lines(depth: np.ndarray) -> tuple[int, int]:
    """Numbers of points of an underside (k,) m up to the edge of the gum, and up to the crest of the dental arch.

    Both are all of them where there is no arch.
    """
    crest = float(depth.max())
    if crest <= CREST_TOLERANCE_M:
        return len(depth), len(depth)
    levels = ((1.0 - GUM_SHARE_OF_HEIGHT) * crest, crest - CREST_TOLERANCE_M)
    gum, edge = (max(2, int(np.argmax(depth >= level)) + 1) for level in levels)
    return gum, edge


def underside_to_side(lines: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """The underside from the midline outwards: distances (k,) m from the midline, and how far it lies below the midline, (k,) m.

    ``lines`` (s, 2 ends, 2) m are those of a section: across the midline, and down; ``side`` is -1.0 for the speaker's left, 1.0
    for the right. What lies further than ``PALATE_REACH_M`` below belongs to another place along the midline. It ends with the
    section.
    """
    lines = lines * np.array([side, 1.0])
    reach = float(lines[:, :, 0].max(initial=0.0))
    outwards = np.linspace(0.0, reach, max(2, int(np.ceil(reach / COLUMN_WIDTH_M)) + 1))
    depth = crossings(lines, outwards)
    depth = np.fmax.reduce(np.where(np.abs(depth) < PALATE_REACH_M, depth, np.nan), axis=1, initial=np.nan)
    ends = ~np.isfinite(depth)
    count = int(np.argmax(ends)) if ends.any() else len(depth)
    return outwards[:count], depth[:count]
