"""A grid of points on the roof of the mouth, and their distance from the surface of the tongue."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
import scipy

from explicitfe.fem.mesh.triangles import plane_segments, triangle_distance, triangle_samples
from explicitfe.platform.host.kept import kept
from explicitfe.results.measure.electrodes import FIRST_ROW_M, HARD_PALATE_M, arch_lines, underside_to_side
from explicitfe.results.measure.sections import Y, Z
from explicitfe.results.measure.tract import palate_midline

# Rows lie so far apart along the midline, and points of a row so far along the underside: in the mean of all rows.
GRID_SPACING_M = 1e-3
# The uvula begins where the roof is narrower than this share of its largest width.
UVULA_SHARE = 1.0 / 3.0
# Surfaces are sampled so densely at rest.
SURFACE_SPACING_M = 2e-3
# Triangles of the roof of so many samples near a point of the grid are tried.
ROOF_SAMPLES_TRIED = 16
LEAF_SIZE = 32  # of the tree of samples, the fastest
# Triangles that are as near to a point, but for rounding, have an edge or a corner in common.
SAME_DISTANCE_M = 1e-9


class OnTriangles(NamedTuple):
    """Points that move with triangles: the ``triangle`` (k,) and the ``weights`` (k, 3) of its corners for each."""

    triangle: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, triangle: np.ndarray, corners: np.ndarray) -> Self:
        """Attach points (k, 3) m to one triangle each of (m, 3 corners, 3) m, on which they lie."""
        a, b, c = np.moveaxis(corners[triangle], 1, 0)
        along = np.linalg.pinv(np.stack([b - a, c - a], axis=-1))
        of_b, of_c = np.einsum("kij,kj->ik", along, points - a)
        return cls(triangle, np.stack([1.0 - of_b - of_c, of_b, of_c], axis=-1))

    def at(self, corners: np.ndarray) -> np.ndarray:
        """Where the points (k, 3) m are now."""
        return np.einsum("kc,kci->ki", self.weights, corners[self.triangle])


class RoofGrid(NamedTuple):
    """A grid on the roof of the mouth, rows from front to back and columns from the speaker's left to the right.

    Attributes
    ----------
    points : on the triangles of the roof; r rows of c columns, one after another.
    place : (r,) m. Of the rows, along the midline from the edge of the incisors.
    side : (r, c) m. From the midsagittal plane, at rest.
    to_border : (r, c) m. From the nearer end of the row along the underside, at rest.
    over_plate, beside_molars : (r, c) inside of the edge of the gum, and outside of it or in front of the electrodes; the edge
        belongs to both.
    hard_rows : number of rows of the hard palate: behind it nothing is beside the molars.
    """

    points: OnTriangles
    place: np.ndarray
    side: np.ndarray
    to_border: np.ndarray
    over_plate: np.ndarray
    beside_molars: np.ndarray
    hard_rows: int


@kept(4)
def roof_grid(roof: np.ndarray, plane: float, hard_palate_m: float = HARD_PALATE_M) -> RoofGrid | None:
    """The grid on a roof (m, 3 corners, 3) m at rest, on both sides of the plane y = ``plane``.

    Rows lie where x is that of points of the midline in equal distances. In each row both sides have the same number of points,
    equally far apart along the underside, from the midline to the crest of the dental arch, or to the edge where there is no
    arch. Behind the hard palate, of which ``hard_palate_m`` is the length along the midline, they end at the height of the gum:
    there the pillars of the fauces join the velum to the sides of the tongue. The uvula, around which air passes, has no rows.
    None where a row has no underside on one side, and for a roof that is too short.
    """
    line = palate_midline(roof, plane)
    if line is None or line.length[-1] < 2.0 * GRID_SPACING_M:
        return None
    rows = int(np.ceil(line.length[-1] / GRID_SPACING_M))
    places = line.length[-1] * (np.arange(rows) + 0.5) / rows
    halves = []
    for x, z in line.at(places):
        cut = plane_segments(roof, np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
        lines = np.stack([cut[:, :, Y] - plane, z - cut[:, :, Z]], axis=-1)
        halves += [(x, z, side, *underside_to_side(lines, side)) for side in (-1.0, 1.0)]
    if any(len(depth) < 2 for *_, depth in halves):
        return None
    soft = np.repeat(places > hard_palate_m, 2)
    curves = [_Curve.of(outwards, depth, end) for (*_, outwards, depth), end in zip(halves, soft, strict=True)]
    half_width = np.array([curve.length[-1] for curve in curves]).reshape(rows, 2)
    rows = _rows_before_uvula(half_width.min(axis=1))
    places, halves, curves, half_width = places[:rows], halves[: 2 * rows], curves[: 2 * rows], half_width[:rows]
    columns = max(2, int(np.ceil(half_width.mean() / GRID_SPACING_M)))
    share = np.arange(columns + 1) / columns
    points = np.empty((rows, 2, columns + 1, 3))
    to_border = half_width[:, :, None] * (1.0 - share)
    gum = np.empty((rows, 2), dtype=np.int64)
    for number, ((x, z, side, _, _), curve) in enumerate(zip(halves, curves, strict=True)):
        outwards, depth = (np.interp(share * curve.length[-1], curve.length, of) for of in (curve.outwards, curve.depth))
        points[divmod(number, 2)] = np.column_stack([np.full(len(share), x), plane + side * outwards, z - depth])
        gum[divmod(number, 2)] = round(columns * curve.gum / curve.length[-1])
    beyond = np.arange(columns + 1) - gum[:, :, None]
    grid, beyond, to_border = (np.concatenate([of[:, 0, :0:-1], of[:, 1]], axis=1) for of in (points, beyond, to_border))
    flat = grid.reshape(-1, 3)
    _, triangle = clearance(flat, roof, surface_samples(roof), ROOF_SAMPLES_TRIED)
    beside = (beyond >= 0) | (places < FIRST_ROW_M)[:, None]
    return RoofGrid(
        OnTriangles.of(flat, triangle, roof),
        places,
        grid[:, :, Y] - plane,
        to_border,
        beyond <= 0,
        beside,
        int((places <= hard_palate_m).sum()),
    )


def _rows_before_uvula(half_width: np.ndarray) -> int:
    """Number of rows, of half widths (r,) m, before the first one behind the widest that has too small a share of its width."""
    widest = int(half_width.argmax())
    narrow = half_width[widest:] < UVULA_SHARE * half_width[widest]
    return widest + int(narrow.argmax()) if narrow.any() else len(half_width)


class _Curve(NamedTuple):
    """Half of a row: distances ``outwards`` from the midline and ``depth`` below it at a ``length`` along it, (k,) m each; the
    edge of the gum is at the length ``gum``; the end is that, or the crest of the arch.
    """

    outwards: np.ndarray
    depth: np.ndarray
    length: np.ndarray
    gum: float

    @classmethod
    def of(cls, outwards: np.ndarray, depth: np.ndarray, to_gum: bool) -> Self:
        gum, crest = arch_lines(depth)
        crest = gum if to_gum else crest
        length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(outwards), np.diff(depth)))])
        return cls(outwards[:crest], depth[:crest], length[:crest], float(length[gum - 1]))


def clearance(points: np.ndarray, corners: np.ndarray, samples: OnTriangles, tried: int) -> tuple[np.ndarray, np.ndarray]:
    """Distance (k,) m of points (k, 3) m from a closed surface, negative inside of it, and the nearest triangle (k,).

    Parameters
    ----------
    corners : (m, 3 corners, 3) m. Triangles of the surface; normals point outwards.
    samples : points on them. Distances are those from the triangles of the nearest ``tried`` of these.
    """
    tree = scipy.spatial.cKDTree(samples.at(corners), leafsize=LEAF_SIZE, balanced_tree=False, compact_nodes=False)
    tried = min(tried, len(samples.triangle))
    triangle = samples.triangle[tree.query(points, k=np.arange(1, tried + 1))[1]]
    near = corners[triangle.ravel()]
    repeated = np.repeat(points, tried, axis=0)
    distance = triangle_distance(repeated, near).reshape(triangle.shape)
    normal = np.cross(near[:, 1] - near[:, 0], near[:, 2] - near[:, 0])
    height = np.einsum("ki,ki->k", repeated - near[:, 0], normal) / np.linalg.norm(normal, axis=1)
    # At a common edge or corner the triangle that faces the point most says on which side it lies.
    nearest = distance.min(axis=1)
    height = np.where(distance <= nearest[:, None] + SAME_DISTANCE_M, height.reshape(triangle.shape), 0.0)
    row, column = np.arange(len(points)), np.abs(height).argmax(axis=1)
    return np.where(height[row, column] < 0.0, -nearest, nearest), triangle[row, distance.argmin(axis=1)]


@kept(4)
def surface_samples(corners: np.ndarray) -> OnTriangles:
    """Points on triangles (m, 3 corners, 3) m, ``SURFACE_SPACING_M`` apart or less."""
    everywhere = np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])
    points, triangle = triangle_samples(corners, SURFACE_SPACING_M, everywhere)
    return OnTriangles.of(points, triangle, corners)
