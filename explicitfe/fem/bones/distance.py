"""Signed distance to a bone, interpolated on a grid."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from explicitfe.fem.bones.surface import TriangleSurface, check_surface, in_mm, shifted
from explicitfe.fem.mesh.triangles import triangle_distance, triangle_samples
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.kept import kept
from explicitfe.platform.host.stored import store_answers

# Samples of the surface stand this many grid spacings apart: the triangles of the nearest ones are tried for a node.
_SAMPLE_SPACINGS = 1.0
_NEAREST_SAMPLES_TRIED = 6
# Nodes nearer than this many spacings get their own distance, the others one between those of their neighbours.
_NEAR_SPACINGS = 5.0
# Pieces of the surface that are farther than this from the grid do not count.
_FARTHEST_SPACINGS = 40
# At rest a surface may reach this far into the body: figures read off two different heads do not fit better.
_DEEPEST_START_M = 5e-3
# The grid ends so many spacings beside the bone: whoever comes near enough to touch is in it.
_BESIDE_SPACINGS = 8
# How far beyond its place at rest a body is expected to go.
_REACH_MARGIN_M = 0.02
# The grid of a bone that is shifted is wider by a multiple of this, so that nearly equal shifts share it.
_SHIFT_STEP_M = 5e-3
# So many fields are kept for the next run of this process: two bones at a few places, for two meshes of the body.
_KEPT_BONE_FIELDS = 16
# Where the code of the fields stands.
_SOURCES = ("fem/bones", "fem/mesh/triangles.py")
# Columns of the grid are moved by this share of a spacing against the triangles, so that none runs along an edge.
_COLUMN_SHIFT_SHARES = (1.7320508e-6, 2.2360680e-6)


@dataclass(frozen=True)
class DistanceField:
    """Signed distance of a rigid surface at the nodes of a grid, positive outside of the bone.

    Attributes
    ----------
    origin_m : (3,) m. The first node of the grid.
    spacing_m : m. Edge of its cells.
    values : (nx, ny, nz) m.
    """

    origin_m: np.ndarray
    spacing_m: float
    values: np.ndarray

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (k,) m and its gradient (k, 3) at points (k, 3) m.

        Trilinear between the nodes of the grid, with the exact gradient of that. Beyond the grid there is no contact: the
        distance is that of the nearest point of the border, at least 0, and the gradient is 0.
        """
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        cells = np.array(self.values.shape) - 1
        place = (points - self.origin_m) / self.spacing_m
        beyond = ((place < 0.0) | (place > cells)).any(axis=1)
        place = np.clip(place, 0.0, cells)
        cell = np.minimum(place.astype(np.int64), cells - 1)
        u = place - cell
        corner = np.stack([[[self._corner(cell, i, j, k) for k in (0, 1)] for j in (0, 1)] for i in (0, 1)])
        along_x = corner[0] + u[:, 0] * (corner[1] - corner[0])
        along_xy = along_x[0] + u[:, 1] * (along_x[1] - along_x[0])
        value = along_xy[0] + u[:, 2] * (along_xy[1] - along_xy[0])
        slope_x = _bilinear(corner[1] - corner[0], u[:, 1], u[:, 2])
        slope_y = _bilinear(corner[:, 1] - corner[:, 0], u[:, 0], u[:, 2])
        slope_z = _bilinear(corner[:, :, 1] - corner[:, :, 0], u[:, 0], u[:, 1])
        gradient = np.column_stack([slope_x, slope_y, slope_z]) / self.spacing_m
        return np.where(beyond, np.maximum(value, 0.0), value), np.where(beyond[:, None], 0.0, gradient)

    def _corner(self, cell: np.ndarray, i: int, j: int, k: int) -> np.ndarray:
        return self.values[cell[:, 0] + i, cell[:, 1] + j, cell[:, 2] + k]


def _bilinear(corner: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    first = corner[0, 0] + u * (corner[1, 0] - corner[0, 0])
    second = corner[0, 1] + u * (corner[1, 1] - corner[0, 1])
    return first + v * (second - first)


def distance_field(
    surface: TriangleSurface, *, spacing_m: float = 1e-3, smoothing_m: float = 5e-4, region: np.ndarray
) -> DistanceField:
    """The signed distance of a closed surface on a grid, smoothed by a Gaussian.

    The sign is that of the winding number along columns of the grid, so pieces may overlap. Nodes lie at multiples of the
    spacing in x and z, and half way between them in y: a surface that is its own mirror image, y -> -y, in a region that is so
    too has a field that is, to the last bit; and its gradient, which jumps from cell to cell, has no side at y = 0.

    Parameters
    ----------
    surface : as ``check_surface`` accepts it.
    spacing_m : m. Edge of the cells.
    smoothing_m : m. Standard deviation of the Gaussian; 0 for none.
    region : (2, 3) m. Lowest and highest corner of what the grid covers at least.
    """
    half_way = np.array([0.0, 0.5 * spacing_m, 0.0])
    region = np.asarray(region, dtype=float) - half_way
    first = np.floor(region[0] / spacing_m).astype(np.int64)
    last = np.ceil(region[1] / spacing_m).astype(np.int64)
    mirrored = first[1] == -last[1] - 1 and _is_its_own_mirror_image(surface)
    start = np.where([False, mirrored, False], 0, first)
    beside = shifted(surface, -half_way)
    values = _unsigned(beside, start, last, spacing_m)
    values = np.where(_winding_number(beside, start, last, spacing_m) > 0, -values, values)
    if mirrored:
        values = np.concatenate([values[:, ::-1], values], axis=1)
    if smoothing_m > 0.0:
        values = scipy.ndimage.gaussian_filter(values, smoothing_m / spacing_m, mode="nearest")
    if mirrored:
        # The filter adds up in one direction.
        values = 0.5 * (values + values[:, ::-1])
    return DistanceField(origin_m=spacing_m * first + half_way, spacing_m=spacing_m, values=values)


def bone_field(
    surface: TriangleSurface,
    what: str,
    body_points: np.ndarray,
    shift_m: np.ndarray | None = None,
    *,
    spacing_m: float = 1e-3,
    smoothing_m: float = 5e-4,
    margin_m: float = _REACH_MARGIN_M,
) -> DistanceField:
    """The distance field of a bone where a body can reach it, after checks of both; kept for the next body that is as large.

    The grid moves along with a bone that is shifted: what the bone does is then smooth in its place.

    Parameters
    ----------
    what : names the bone in messages: 'bone "palate" (palate.stl)'.
    body_points : (n, 3) m. Points of the body's surface at rest.
    shift_m : (3,) m. Where the bone is, from the place of its surface; there if left out.
    spacing_m, smoothing_m : as in ``distance_field``.
    margin_m : m. How far beyond its place at rest the grid follows the body.

    Raises
    ------
    InputError
        See ``check_surface``; or the body starts deeper than 5 mm inside the bone.
    """
    _check(surface, what, np.ptp(body_points, axis=0))
    shift = np.zeros(3) if shift_m is None else np.asarray(shift_m, dtype=float)
    low, high = reach(body_points, margin_m + _SHIFT_STEP_M * np.ceil(np.abs(shift).max() / _SHIFT_STEP_M))
    beside = _BESIDE_SPACINGS * spacing_m
    low = np.maximum(low, surface.box_m[0] - beside)
    high = np.maximum(np.minimum(high, surface.box_m[1] + beside), low + 2.0 * spacing_m)  # a bone out of reach has a small grid
    field = _field(surface, np.stack([low, high]), spacing_m, smoothing_m)
    field = replace(field, origin_m=field.origin_m + shift)
    distance, _ = field.at(body_points)
    deepest = int(distance.argmin())
    if distance[deepest] < -_DEEPEST_START_M:
        raise InputError(
            f"{what}: the body starts {-1e3 * distance[deepest]:.1f} mm inside it, deepest at {in_mm(body_points[deepest])}; "
            f"move one of them (up to {1e3 * _DEEPEST_START_M:g} mm are accepted), or remove the bone."
        )
    return field


@kept(_KEPT_BONE_FIELDS)
@store_answers(sources=_SOURCES)
def _check(surface: TriangleSurface, what: str, extent_m: np.ndarray) -> None:
    """``check_surface`` of a surface beside a body of an extent along each axis."""
    check_surface(surface, what, np.stack([np.zeros(3), extent_m]))


@kept(_KEPT_BONE_FIELDS)
@store_answers(DistanceField, sources=_SOURCES)
def _field(surface: TriangleSurface, region: np.ndarray, spacing_m: float, smoothing_m: float) -> DistanceField:
    return distance_field(surface, spacing_m=spacing_m, smoothing_m=smoothing_m, region=region)


def reach(body_points: np.ndarray, margin_m: float) -> np.ndarray:
    """The box (2, 3) m around a body's points that is ``margin_m`` wider, and as wide to the left as to the right."""
    low, high = body_points.min(axis=0) - margin_m, body_points.max(axis=0) + margin_m
    low[1], high[1] = min(low[1], -high[1]), max(high[1], -low[1])
    return np.stack([low, high])


def _is_its_own_mirror_image(surface: TriangleSurface) -> bool:
    """Whether points and triangles are the same, to the last bit, when y changes its sign."""
    mirrored = surface.points * np.array([1.0, -1.0, 1.0])
    (points, number), (images, image) = (
        np.unique(side + 0.0, axis=0, return_inverse=True) for side in (surface.points, mirrored)
    )
    if not np.array_equal(points, images):
        return False
    ours, theirs = (np.unique(np.sort(of.ravel()[surface.triangles], axis=1), axis=0) for of in (number, image))
    return bool(np.array_equal(ours, theirs))


def _unsigned(surface: TriangleSurface, first: np.ndarray, last: np.ndarray, spacing: float) -> np.ndarray:
    """Distance from the surface at the nodes from ``first`` to ``last``, in multiples of the spacing.

    Exact near the surface; elsewhere interpolated between every second node, off by spacing^2 / d at most at a distance d,
    and by less than a spacing where two pieces of the surface are equally near.
    """
    box = spacing * np.stack([first - _FARTHEST_SPACINGS, last + _FARTHEST_SPACINGS])
    samples, triangle = triangle_samples(surface.corners, _SAMPLE_SPACINGS * spacing, box)
    if not len(samples):
        return np.full(last - first + 1, _FARTHEST_SPACINGS * spacing)
    # Built like this, it answers a grid of far points three times as fast.
    tree, corners = scipy.spatial.cKDTree(samples, balanced_tree=False, compact_nodes=False), surface.corners[triangle]

    def distance_of(nodes: np.ndarray, tried: int) -> np.ndarray:
        tried = min(tried, len(samples))
        _, nearest = tree.query(nodes, k=tried, workers=-1)
        columns = nearest.reshape(len(nodes), tried).T
        return np.min([triangle_distance(nodes, corners[column]) for column in columns], axis=0)

    axes = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
    coarse = [np.arange(a, b + 2, 2) for a, b in zip(first, last, strict=True)]
    nodes = spacing * np.stack(np.meshgrid(*coarse, indexing="ij"), axis=-1)
    length = distance_of(nodes.reshape(-1, 3), 1).reshape(nodes.shape[:3])
    for axis, (fine, nodes_of) in enumerate(zip(axes, coarse, strict=True)):
        length = scipy.interpolate.interp1d(nodes_of, length, axis=axis, assume_sorted=True)(fine)
    near = np.nonzero(length < _NEAR_SPACINGS * spacing)
    length[near] = distance_of(spacing * (np.column_stack(near) + first), _NEAREST_SAMPLES_TRIED)
    return length


def _winding_number(surface: TriangleSurface, first: np.ndarray, last: np.ndarray, spacing: float) -> np.ndarray:
    """How often the surface winds around each node: crossings of the column above it, those upwards less those downwards."""
    corners = surface.corners / spacing - first - np.array([*_COLUMN_SHIFT_SHARES, 0.0])
    count = last - first + 1
    low = np.maximum(np.ceil(corners[:, :, :2].min(axis=1)).astype(np.int64), 0)
    high = np.minimum(np.floor(corners[:, :, :2].max(axis=1)).astype(np.int64), count[:2] - 1)
    span = np.maximum(high - low + 1, 0)
    columns = span[:, 0] * span[:, 1]
    triangle = np.repeat(np.arange(len(corners)), columns)
    within = np.arange(len(triangle)) - np.repeat(np.cumsum(columns) - columns, columns)
    i = low[triangle, 0] + within // span[triangle, 1]
    j = low[triangle, 1] + within % span[triangle, 1]

    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    weights = [_cross(b, c, i, j), _cross(c, a, i, j), _cross(a, b, i, j)]
    whole = weights[0] + weights[1] + weights[2]
    hit = (whole != 0.0) & np.all([weight * whole > 0.0 for weight in weights], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (weights[0] * a[:, 2] + weights[1] * b[:, 2] + weights[2] * c[:, 2]) / whole
    # A crossing at height z counts for the nodes below it: upwards facing +1, downwards facing -1.
    below = np.clip(np.ceil(z[hit]), 0, count[2]).astype(np.int64)
    crossings = np.zeros((count[0], count[1], count[2] + 1), dtype=np.int64)
    np.add.at(crossings, (i[hit], j[hit], below), np.sign(whole[hit]).astype(np.int64))
    return crossings[:, :, ::-1].cumsum(axis=2)[:, :, ::-1][:, :, 1:]


def _cross(a: np.ndarray, b: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Twice the area of the triangle of a, b and (i, j), seen from above."""
    return (a[:, 0] - i) * (b[:, 1] - j) - (a[:, 1] - j) * (b[:, 0] - i)
