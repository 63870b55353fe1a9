"""The tongue from contour tables: a bent block of s x t x w, meshed at any resolution.

``ContourMap`` maps material coordinates (s, t, w) to the reference shape; the formula stands at the top of
``models/tongue/geometry.toml``. A structured mesh of the block has no inverted element at the resolutions of its file and is
exactly its own mirror image, which a mesh of a real tongue is not; and what is said in (s, t, w), such as a muscle fibre, holds
for every resolution. Where a file gives the half width of an inner surface too, the block is two halves that are each other's
mirror images, such as the side walls of the pharynx.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from explicitfe.fem.mesh.box import grid_hexes
from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, MaterialPoints, joined_points, shape_functions
from explicitfe.fem.mesh.surface_points import points_on_pieces
from explicitfe.platform.errors import InputError, nearest

# The fewest elements along s, t and w with which the shape is still a tongue.
_FEWEST_ELEMENTS = (4, 3, 4)

_AXIS_NAMES = ("s", "t", "w")

# A bound of a patch that is so near to a plane between elements, in elements, lies in it.
_SAME_PLANE_SHARE = 1e-9


@dataclass(frozen=True)
class Patch:
    """A piece of the surface that a bone holds: a box in (s, t, |w|), flat along one axis.

    Attributes
    ----------
    lower, upper : (s, t, |w|) of its bounds, each in [0, 1].
    row : the axis, 0 to 2, in whose middle it is held by a single row of nodes, where nodes are held; None: by all of its nodes.
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    row: int | None = None


@dataclass(frozen=True)
class ContourMap:
    """The shape of the tongue in material coordinates (s, t, w), and its meshes.

    Attributes
    ----------
    s, t : (k,), (l,) abscissae of the tables, from 0 to 1.
    lower, upper : (k, 2) m. Midsagittal contour, (x, z), where t = 0 and t = 1.
    bow : (k,) m. How far the middle of a line s = const is bowed towards smaller s.
    w : (m,) abscissae of the next three, from 0 to 1.
    drop, rise : (k, m) m. How far the upper surface lies below its midsagittal contour, and the lower one above.
    sweep : (k, m) m. How far a line s = const lies towards larger s.
    half_width : (k, l) m.
    resolutions : name -> elements along s, t, w.
    named_points : name -> (s, t, w); in a mesh they lie there, between its nodes.
    attachments : name -> patches of the surface held by a bone.
    fixed : names of the attachments that are held unless a scenario says otherwise.
    based_on : the built-in model that has the files that this one lacks, such as its muscles; "" if it has all.
    inner_half_width : (k, l) m. Where the inner surfaces of two halves that are apart stand; None for one body.
    """

    s: np.ndarray
    t: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    bow: np.ndarray
    w: np.ndarray
    drop: np.ndarray
    rise: np.ndarray
    sweep: np.ndarray
    half_width: np.ndarray
    resolutions: dict[str, tuple[int, int, int]]
    named_points: dict[str, tuple[float, float, float]]
    attachments: dict[str, tuple[Patch, ...]]
    fixed: tuple[str, ...]
    based_on: str = ""
    inner_half_width: np.ndarray | None = None

    @classmethod
    def from_toml(cls, path: Path | str) -> ContourMap:
        """Read a geometry file.

        Raises
        ------
        InputError
            The file cannot be read, a table is missing, unknown, of the wrong length or holds other things than numbers.
        """
        path = Path(path)
        try:
            with path.open("rb") as file:
                tables = tomllib.load(file)
        except (OSError, tomllib.TOMLDecodeError) as error:
            raise InputError(f"{path}: cannot be read: {error}.") from error
        return cls.from_tables(tables, str(path))

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any], where: str) -> ContourMap:
        """The map from the parsed tables of a geometry file; ``where`` names the file in messages."""
        required = ("fixed", "axes", "contour", "half_width", "resolutions", "named_points", "attachments")
        _known(tables, required, where, ("based_on", "inner_half_width"))
        axes, contour = tables["axes"], tables["contour"]
        _known(axes, _AXIS_NAMES, f"{where}: axes")
        _known(contour, ("lower_mm", "upper_mm"), f"{where}: contour", ("bow_mm", "drop_mm", "rise_mm", "sweep_mm"))
        s = _axis(axes["s"], f"{where}: axes.s")
        t, w = (_axis(axes[name], f"{where}: axes.{name}") for name in "tw")
        for name in tables["fixed"]:
            if name not in tables["attachments"]:
                raise InputError(f'{where}: fixed names no attachment "{name}"; {nearest(str(name), tables["attachments"])}')

        def column(name: str, *shape: int) -> np.ndarray:
            return _numbers(contour.get(name, np.zeros((len(s), *shape))), (len(s), *shape), f"{where}: contour.{name}")

        def widths(name: str) -> np.ndarray:
            _known(tables[name], ("mm",), f"{where}: {name}")
            return 1e-3 * _numbers(tables[name]["mm"], (len(s), len(t)), f"{where}: {name}.mm")

        return cls(
            s=s,
            t=t,
            lower=1e-3 * column("lower_mm", 2),
            upper=1e-3 * column("upper_mm", 2),
            bow=1e-3 * column("bow_mm"),
            w=w,
            drop=1e-3 * column("drop_mm", len(w)),
            rise=1e-3 * column("rise_mm", len(w)),
            sweep=1e-3 * column("sweep_mm", len(w)),
            half_width=widths("half_width"),
            inner_half_width=widths("inner_half_width") if "inner_half_width" in tables else None,
            resolutions={
                name: check_cells(cells, f"{where}: resolutions.{name}") for name, cells in tables["resolutions"].items()
            },
            named_points={
                name: tuple(_numbers(point, (3,), f"{where}: named_points.{name}").tolist())
                for name, point in tables["named_points"].items()
            },
            attachments={
                name: tuple(_patch(patch, f"{where}: attachments.{name}") for patch in patches)
                for name, patches in tables["attachments"].items()
            },
            fixed=tuple(tables["fixed"]),
            based_on=str(tables.get("based_on", "")),
        )

    @cached_property
    def _contour_spline(self) -> scipy.interpolate.CubicSpline:
        """s -> lower x, z, upper x, z, bow."""
        return scipy.interpolate.CubicSpline(self.s, np.column_stack([self.lower, self.upper, self.bow]))

    @cached_property
    def _width_splines(self) -> tuple[scipy.interpolate.RectBivariateSpline, ...]:
        """(s, t) -> half width, and that of the inner surface of two halves."""
        tables = [self.half_width] if self.inner_half_width is None else [self.half_width, self.inner_half_width]
        return tuple(scipy.interpolate.RectBivariateSpline(self.s, self.t, table, kx=3, ky=3, s=0) for table in tables)

    @cached_property
    def _side_splines(self) -> tuple[scipy.interpolate.RectBivariateSpline, ...]:
        """(s, w) -> drop, rise, sweep; mirrored, so that they are flat across the midsagittal plane."""
        w = np.concatenate([-self.w[:0:-1], self.w])
        return tuple(
            scipy.interpolate.RectBivariateSpline(self.s, w, np.hstack([table[:, :0:-1], table]), kx=3, ky=3, s=0)
            for table in (self.drop, self.rise, self.sweep)
        )

    def _place(self, s: np.ndarray, t: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Positions (..., 3), m, for arrays that broadcast. x and z depend on |w| only, bit for bit, and y is odd.

        Of two halves that are apart, w = 0.0 is the inner surface of the right one, and -0.0 that of the left one.
        """
        table = np.moveaxis(self._contour_spline(s), -1, 0)
        lower, upper, bow = table[0:2], table[2:4], table[4]
        width, *inner = (spline.ev(*np.broadcast_arrays(s, t)) for spline in self._width_splines)
        drop, rise, sweep = (spline.ev(*np.broadcast_arrays(s, np.abs(w))) for spline in self._side_splines)
        chord = upper - lower
        length = np.sqrt(chord[0] * chord[0] + chord[1] * chord[1])
        along = (t * (length - drop) + (1.0 - t) * rise) / length
        across = (4.0 * t * (1.0 - t) * bow - sweep) / length
        x = lower[0] + along * chord[0] - across * chord[1]
        z = lower[1] + along * chord[1] + across * chord[0]
        y = w * width + sum(np.copysign((1.0 - np.abs(w)) * half, w) for half in inner)
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)

    def position(self, stw: np.ndarray) -> np.ndarray:
        """Reference positions (..., 3), m, of the points (s, t, w) (..., 3) of the smooth shape."""
        stw = np.asarray(stw, dtype=float)
        return self._place(stw[..., 0], stw[..., 1], stw[..., 2])

    def thickness(self, stw: np.ndarray) -> np.ndarray:
        """(k,) m, from the lower to the upper surface through points (s, t, w), (k, 3), along t."""
        upper, lower = (self.position(stw * [1.0, 0.0, 1.0] + [0.0, t, 0.0]) for t in (1.0, 0.0))
        return np.linalg.norm(upper - lower, axis=1)

    def mesh(self, cells: Sequence[int]) -> HexMesh:
        """The structured mesh with (ns, nt, nw) elements along s, t and w.

        Nodes and elements count with t fastest, then w, then s; the natural axes (xi, eta, zeta) of every element run
        along (s, w, t). The mesh is its own mirror image to the last bit: partners share x and z, and y changes sign.

        Raises
        ------
        InputError
            See ``check_cells``.
        """
        ns, nt, nw = check_cells(cells)
        s, t, w = (np.arange(n + 1) / n for n in (ns, nt, nw // 2))
        right = self._place(s[:, None, None], t[None, None, :], w[None, :, None])
        apart = right if self.inner_half_width is not None else right[:, 1:]  # one body has its middle nodes once
        points = np.concatenate([apart[:, ::-1] * np.array([1.0, -1.0, 1.0]), right], axis=1)

        number = np.arange(points[..., 0].size).reshape(points.shape[:3])
        halves = number[:, : len(w)], number[:, -len(w) :]
        hexes = [grid_hexes(half).reshape(ns, -1, nt, 8) for half in halves]
        sides = halves[0][:, ::-1], halves[1]
        return HexMesh(
            points=points.reshape(-1, 3),
            hexes=np.concatenate(hexes, axis=1).reshape(-1, 8),
            node_sets={name: _patch_nodes(patches, sides) for name, patches in self.attachments.items()},
            named_points={name: self.locate([point], cells) for name, point in self.named_points.items()},
        )

    def locate(self, stw: npt.ArrayLike, cells: Sequence[int]) -> MaterialPoints:
        """The points (s, t, w), (k, 3), in the mesh with these cells: straight from the grid, without a search.

        Their position is that in the mesh, not on the smooth shape: the two differ by what the mesh flattens.
        A point on a face between elements goes to the one with the larger s, t or w; of two halves that are apart, w = -0.0 is
        in the left one.

        Raises
        ------
        InputError
            A point outside the block, or cells that ``check_cells`` refuses.
        """
        ns, nt, nw = check_cells(cells)
        stw = np.asarray(stw, dtype=float).reshape(-1, 3)
        outside = np.flatnonzero(~((stw >= [0.0, 0.0, -1.0]) & (stw <= 1.0)).all(axis=1))
        if len(outside):
            raise InputError(
                f"point {outside[0]} at (s, t, w) = {stw[outside[0]].tolist()} lies outside the tongue: "
                "s and t run from 0 to 1, w from -1 to 1."
            )
        count = np.array([ns, nw, nt])
        grid = np.column_stack([stw[:, 0], 0.5 * (stw[:, 2] + 1.0), stw[:, 1]]) * count
        cell = np.clip(np.floor(grid).astype(np.int64), 0, count - 1)
        if self.inner_half_width is not None:
            cell[:, 1] -= (stw[:, 2] == 0.0) & np.signbit(stw[:, 2])
        natural = 2.0 * (grid - cell) - 1.0
        corner = (cell[:, None, :] + (CORNERS > 0.0)) / count
        side = np.where(cell[:, 1:2] < nw // 2, -1.0, 1.0)
        corners = self._place(corner[..., 0], corner[..., 2], np.copysign(2.0 * corner[..., 1] - 1.0, side))
        return MaterialPoints(
            element=(cell[:, 0] * nw + cell[:, 1]) * nt + cell[:, 2],
            natural=natural,
            position=np.einsum("ka,kai->ki", shape_functions(natural), corners),
        )

    def attachment_points(self, cells: Sequence[int], name: str) -> tuple[MaterialPoints, np.ndarray]:
        """Points on an attachment in the mesh with these cells, with the area (k,), m^2, that each stands for.

        Every patch is cut at its own bounds and at the planes between elements, with two by two Gauss points on each
        piece. So the held area is the same for every mesh but for what the mesh flattens. The right side comes first,
        then, in the same order, its mirror image.

        Raises
        ------
        InputError
            An unknown attachment, or cells that ``check_cells`` refuses.
        """
        ns, nt, nw = check_cells(cells)
        if name not in self.attachments:
            raise InputError(f'unknown attachment "{name}"; {nearest(name, self.attachments)}')
        # The grid of elements as the mesh counts it, along s, w and t, with w from the midplane to the right.
        count, middle = np.array([ns, nw // 2, nt]), nw // 2
        right, areas_m2 = [], []
        for patch in self.attachments[name]:
            spans = [_cuts(patch.lower[axis], patch.upper[axis], n) for axis, n in zip((0, 2, 1), count.tolist(), strict=True)]
            index = np.indices([len(span) for span in spans]).reshape(3, -1)
            bounds = np.stack([span[i] for span, i in zip(spans, index, strict=True)])
            cell = np.minimum(np.floor(bounds.mean(axis=2)).astype(np.int64), count[:, None] - 1)
            corner = (cell.T[:, None, :] + (CORNERS > 0.0)) / count
            corners = self._place(corner[..., 0], corner[..., 2], corner[..., 1])
            element = (cell[0] * nw + middle + cell[1]) * nt + cell[2]
            lower, upper = (2.0 * (bounds[..., side] - cell).T - 1.0 for side in (0, 1))
            points, areas = points_on_pieces(element, corners, lower, upper)
            right.append(points)
            areas_m2.append(areas)
        side = joined_points(right)
        return joined_points([side, mirror(side, cells)]), np.concatenate(2 * areas_m2)


def mirror(points: MaterialPoints, cells: Sequence[int]) -> MaterialPoints:
    """The mirror images, y -> -y, of points in the mesh of a ``ContourMap`` with these cells: exact to the last bit.

    Points fixed in space are mirrored too.
    """
    _, nt, nw = check_cells(cells)
    row, t = np.divmod(points.element, nt)
    s, w = np.divmod(row, nw)
    image = (s * nw + (nw - 1 - w)) * nt + t
    return MaterialPoints(
        element=np.where(points.element < 0, -1, image),
        natural=points.natural * np.array([1.0, -1.0, 1.0]),
        position=points.position * np.array([1.0, -1.0, 1.0]),
    )


def check_cells(cells: Sequence[int], where: str = "cells") -> tuple[int, int, int]:
    """Three integers (ns, nt, nw) with which a mesh is possible.

    Raises
    ------
    InputError
        Not three integers, ns below 4, nt below 3, nw below 4 or odd.
    """
    valid = isinstance(cells, Sequence | np.ndarray) and not isinstance(cells, str) and len(cells) == 3
    if not valid or not all(isinstance(n, int | np.integer) and not isinstance(n, bool) for n in cells):
        raise InputError(f"{where}: give three integers [ns, nt, nw], the elements along s, t and w, not {cells!r}.")
    for name, n, fewest in zip(_AXIS_NAMES, cells, _FEWEST_ELEMENTS, strict=True):
        if n < fewest:
            raise InputError(f"{where}: n{name} = {n} elements along {name} are too few; use at least {fewest}.")
    ns, nt, nw = (int(n) for n in cells)
    if nw % 2:
        raise InputError(f"{where}: nw = {nw} is odd; nodes must lie in the midplane, so use an even number, such as {nw + 1}.")
    return ns, nt, nw


def _plane(fraction: float, n: int) -> int:
    """The plane of nodes nearest to a fraction of n elements; in the middle between two, the upper one."""
    return int(np.floor(fraction * n + 0.5))


def _cuts(low: float, high: float, n: int) -> np.ndarray:
    """A range of fractions of n elements, cut at the planes between them: bounds (k, 2) of its pieces, counted in elements."""
    first, last = n * low, n * high
    planes = np.arange(np.floor(first) + 1.0, np.ceil(last))
    # A plane that differs from a bound by rounding only is that bound.
    planes = planes[(planes - first > _SAME_PLANE_SHARE) & (last - planes > _SAME_PLANE_SHARE)]
    ends = np.concatenate([[first], planes, [last]])
    return np.column_stack([ends[:-1], ends[1:]])


def _patch_nodes(patches: Sequence[Patch], sides: Sequence[np.ndarray]) -> np.ndarray:
    """Sorted nodes of the patches in the grids of node numbers (ns + 1, nw / 2 + 1, nt + 1) of both sides, from the middle on."""
    ns, middle, nt = (n - 1 for n in sides[0].shape)
    nodes = []
    for patch in patches:
        ranges = []
        for axis, (low, high, n) in enumerate(zip(patch.lower, patch.upper, (ns, nt, middle), strict=True)):
            if axis == patch.row:
                low = high = 0.5 * (low + high)
            first, last = _plane(low, n), _plane(high, n)
            if low < high and first == last:
                # Narrower than an element: one element wide, never a bare line of nodes.
                first, last = (first, last + 1) if last < n else (first - 1, last)
            ranges.append(np.arange(first, last + 1))
        s, t, side = ranges
        nodes += [number[np.ix_(s, side, t)].ravel() for number in sides]
    return np.unique(np.concatenate(nodes))


def _known(table: Mapping[str, Any], names: Sequence[str], where: str, optional: Sequence[str] = ()) -> None:
    for key in table:
        if key not in (*names, *optional):
            raise InputError(f'{where}: unknown key "{key}"; {nearest(key, (*names, *optional))}')
    for name in names:
        if name not in table:
            raise InputError(f'{where}: the key "{name}" is missing.')


def _numbers(values: object, shape: tuple[int, ...], where: str) -> np.ndarray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: must be numbers in rows of equal length.") from error
    if array.shape != shape:
        raise InputError(f"{where}: must have the shape {shape}, not {array.shape}.")
    if not np.isfinite(array).all():
        raise InputError(f"{where}: must be finite numbers.")
    return array


def _axis(values: object, where: str) -> np.ndarray:
    axis = _numbers(values, (len(values),) if isinstance(values, list) else (), where)
    if axis.ndim != 1 or len(axis) < 4 or axis[0] != 0.0 or axis[-1] != 1.0 or (np.diff(axis) <= 0.0).any():
        raise InputError(f"{where}: must rise from 0 to 1 in at least 4 values.")
    return axis


def _patch(table: Mapping[str, Any], where: str) -> Patch:
    _known(table, _AXIS_NAMES, where, optional=("row",))
    bounds = np.array(
        [
            _numbers(table[name], (2,), f"{where}: {name}") if isinstance(table[name], list) else [table[name]] * 2
            for name in _AXIS_NAMES
        ],
        dtype=float,
    )
    if not ((bounds >= 0.0) & (bounds <= 1.0)).all() or (bounds[:, 0] > bounds[:, 1]).any():
        raise InputError(f"{where}: ranges of s, t and |w| run upwards between 0 and 1.")
    surface = [bounds[0, 0] in (0.0, 1.0), bounds[1, 0] in (0.0, 1.0), bounds[2, 0] == 1.0]
    flat = bounds[:, 0] == bounds[:, 1]
    if flat.sum() != 1 or not (flat & surface).any():
        raise InputError(
            f"{where}: a patch needs one of s, t and w as a single value on the surface and the other two as ranges; "
            "a line has no area, so give it a width."
        )
    row = table.get("row")
    if row is not None and (row not in _AXIS_NAMES or flat[_AXIS_NAMES.index(row)]):
        raise InputError(f"{where}: row names the axis that the patch is narrow along, one of its two ranges, not {row!r}.")
    return Patch(
        lower=tuple(bounds[:, 0].tolist()),
        upper=tuple(bounds[:, 1].tolist()),
        row=None if row is None else _AXIS_NAMES.index(row),
    )
