"""The bones of a built-in model, from rounded tables to closed surfaces."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.platform.errors import InputError

# Triangles are no longer than this: the tables' own spacing is 5 mm.
_MESH_MM = 2.0
_ANGLE_STEP_DEG = 4.0
_EDGE_DEG = (22.5, 45.0, 67.5, 90.0)  # of the points around a rounded edge

BoneTable = Mapping[str, Any]  # a table of the file, whose keys are those that its shape has


@dataclass(frozen=True)
class BoneShape:
    """A bone of a built-in model.

    Attributes
    ----------
    name, title : what scenarios call it, and what it is.
    surface : at rest.
    hinge_m : (3,) m. A point of the axis, parallel to y, about which it turns; None for a bone that does not.
    incisor_m : (3,) m. The edge of its incisors, whose way down is the opening of the mouth; None for a bone that does not turn.
    hard : what is left of the surface where a body takes the place of its soft part: of a palate up to where the velum begins, of
        a pharynx without side walls; None for another bone.
    """

    name: str
    title: str
    surface: TriangleSurface
    hinge_m: np.ndarray | None = None
    incisor_m: np.ndarray | None = None
    hard: TriangleSurface | None = None


def read_bones(path: Path) -> dict[str, BoneShape]:
    """The bones of a file of tables, whose comments say what they mean: ``models/tongue/bones.toml``.

    Raises
    ------
    InputError : the file cannot be read, or a table is missing or has the wrong shape.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}.") from error
    bones = {}
    for name, table in tables.items():
        try:
            surface = plate(table) if "underside_mm" in table else arch(table)
            hard = plate(table, table["velum_from_mm"]) if "velum_from_mm" in table else None
            title = str(table["title"])
        except (KeyError, ValueError) as error:
            raise InputError(f"{path}: {name}: a table is missing or has the wrong shape: {error}.") from error
        hinge, incisor = _midsagittal_point(table, "hinge_mm"), _midsagittal_point(table, "incisor_mm")
        bones[name] = BoneShape(name, title, surface, hinge, incisor, hard)
    return bones


def _midsagittal_point(table: BoneTable, name: str) -> np.ndarray | None:
    """A point (x, z) of a table in mm as (3,) m; None where the table has none."""
    if name not in table:
        return None
    x, z = table[name]
    return 1e-3 * np.array([x, 0.0, z])


def plate(table: BoneTable, until_mm: float = np.inf) -> TriangleSurface:
    """A solid above an underside z(x, |y|), from its first x to its last or to ``until_mm``, out to the half width at each x.

    ``table`` holds x_mm (k,), half_width_mm (k,), y_mm (l,) from 0, underside_mm (k, l), thickness_mm.
    """
    x_mm, y_mm = _row(table, "x_mm"), _row(table, "y_mm")
    underside = _table(table, "underside_mm", (len(x_mm), len(y_mm)))
    x = _refined(np.concatenate([x_mm[x_mm < until_mm], [min(until_mm, x_mm[-1])]]), _MESH_MM)
    width = scipy.interpolate.PchipInterpolator(x_mm, _table(table, "half_width_mm", x_mm.shape))(x)
    share = np.linspace(0.0, 1.0, int(np.ceil(width.max() / _MESH_MM)) + 1)
    side = width[:, None] * share
    # Mirrored first, so that the interpolant is flat across the midsagittal plane; beyond the last |y| it stays level.
    across_mm, mirrored = np.concatenate([-y_mm[:0:-1], y_mm]), np.hstack([underside[:, :0:-1], underside])
    even = scipy.interpolate.PchipInterpolator(across_mm, mirrored, axis=1)
    along = scipy.interpolate.PchipInterpolator(x_mm, even(np.minimum(side, y_mm[-1]).ravel()), axis=0)
    columns = along(x).reshape(len(x), len(x), len(share))
    z = columns[np.arange(len(x)), np.arange(len(x))]
    lower = np.stack([np.broadcast_to(x[:, None], z.shape), side, z], axis=-1)
    upper = lower + np.array([0.0, 0.0, float(table["thickness_mm"])])
    # Around a section: out along the underside, up, back along the top, mirrored to the other side.
    half = np.concatenate([lower, upper[:, ::-1]], axis=1)
    return _tube(1e-3 * half)


def arch(table: BoneTable) -> TriangleSurface:
    """A solid bent around a vertical axis, between two radii over angle and height.

    ``table`` holds centre_mm, angle_deg (k,) from 0, bottom_mm (k,), top_mm (k,), level_mm (l,), lingual_mm (k, l),
    labial_mm (k, l), and top_radius_mm of the edges along the top.
    """
    angle_deg, level = _row(table, "angle_deg"), _row(table, "level_mm")
    angle = _refined(angle_deg, _ANGLE_STEP_DEG)

    def over_angle(name: str, *shape: int) -> np.ndarray:
        values = _table(table, name, (len(angle_deg), *shape))
        mirrored = np.concatenate([values[:0:-1], values])
        return scipy.interpolate.PchipInterpolator(np.concatenate([-angle_deg[:0:-1], angle_deg]), mirrored)(angle)

    bottom, top = over_angle("bottom_mm"), over_angle("top_mm")
    radius, turn = float(table["top_radius_mm"]), np.radians(_EDGE_DEG)
    share = np.linspace(0.0, 1.0, int(np.ceil((top - bottom).max() / _MESH_MM)) + 1)
    z = bottom[:, None] + (top - radius - bottom)[:, None] * share
    z = np.hstack([z, (top - radius)[:, None] + radius * np.sin(turn)])
    inset = radius * (1.0 - np.cos(np.concatenate([np.zeros(len(share)), turn])))
    radii = []
    for name in ("lingual_mm", "labial_mm"):
        rows = over_angle(name, len(level))
        lines = (scipy.interpolate.PchipInterpolator(level, row) for row in rows)
        radii.append(np.array([line(np.clip(at, level[0], level[-1])) for line, at in zip(lines, z, strict=True)]))
    lingual, labial = radii[0] + inset, radii[1] - inset
    section = np.stack([np.hstack([lingual, labial[:, ::-1]]), np.hstack([z, z[:, ::-1]])], axis=-1)
    around = np.radians(angle)[:, None]
    x = float(table["centre_mm"]) - section[:, :, 0] * np.cos(around)
    y = section[:, :, 0] * np.sin(around)
    return _ring(1e-3 * np.stack([x, y, section[:, :, 1]], axis=-1))


def channel(table: BoneTable, sides: bool = True) -> TriangleSurface:
    """A solid around a channel that is open in front: a back wall x(z, |y|), and side walls that run forwards from its edges.

    ``table`` holds height_mm (k,), half_width_mm (k,), y_mm (l,) from 0, back_mm (k, l), side_front_mm, thickness_mm, and
    front_radius_mm of the inner front edges. Without ``sides`` it is the back wall alone.
    """
    height_mm, y_mm = _row(table, "height_mm"), _row(table, "y_mm")
    back = _table(table, "back_mm", (len(height_mm), len(y_mm)))
    z = _refined(height_mm, _MESH_MM)
    width = scipy.interpolate.PchipInterpolator(height_mm, _table(table, "half_width_mm", height_mm.shape))(z)
    across_mm, mirrored = np.concatenate([-y_mm[:0:-1], y_mm]), np.hstack([back[:, :0:-1], back])
    even = scipy.interpolate.PchipInterpolator(across_mm, mirrored, axis=1)
    front, thickness = float(table["side_front_mm"]), float(table["thickness_mm"])
    share = np.linspace(0.0, 1.0, int(np.ceil(width.max() / _MESH_MM)) + 1)
    y = width[:, None] * share
    wall = scipy.interpolate.PchipInterpolator(height_mm, even(np.minimum(y, y_mm[-1]).ravel()), axis=0)(z)
    x = wall.reshape(len(z), *y.shape)[np.arange(len(z)), np.arange(len(z))]
    radius = float(table["front_radius_mm"])
    side = np.linspace(x[:, -1], front + radius, int(np.ceil((x[:, -1].max() - front) / _MESH_MM)) + 1, axis=1)[:, 1:]
    behind = np.repeat(x.max(axis=1, keepdims=True) + thickness, len(share), axis=1)
    # The outside runs back along the side and behind the wall, to the midsagittal plane.
    around_x, around_y = [x, behind], [y, y[:, ::-1]]
    if sides:
        turn = np.concatenate([np.zeros(side.shape[1]), np.radians(_EDGE_DEG)])
        near = width[:, None] + radius * (1.0 - np.cos(turn))
        side = np.hstack([side, np.repeat([front + radius * (1.0 - np.sin(np.radians(_EDGE_DEG)))], len(z), axis=0)])
        around_x[1:1] = [side, side[:, ::-1], behind[:, :1]]
        around_y[1:1] = [near, near + thickness, near[:, :1] + thickness]
    half_x, half_y = np.hstack(around_x), np.hstack(around_y)
    return _tube(1e-3 * np.stack([half_x, half_y, np.repeat(z[:, None], half_x.shape[1], axis=1)], axis=-1))


def _tube(half: np.ndarray) -> TriangleSurface:
    """A closed surface from sections (k, m, 3) of its right half, whose first and last point lie in the midsagittal plane."""
    whole = np.concatenate([half, half[:, -2:0:-1] * np.array([1.0, -1.0, 1.0])], axis=1)
    right = _strip(half.shape[1])
    return _closed(whole, np.concatenate([right, -right[:, ::-1] % whole.shape[1]]))


def _ring(right: np.ndarray) -> TriangleSurface:
    """A closed surface from the sections (k, m, 3) of its right half, the first of which lies in the midsagittal plane."""
    whole = np.concatenate([right[:0:-1] * np.array([1.0, -1.0, 1.0]), right])
    return _closed(whole, _strip(right.shape[1]))


def _strip(count: int) -> np.ndarray:
    """Triangles (count - 2, 3) between the first half of the points of a section and the second; it may be a channel."""
    first = np.arange((count - 1) // 2)
    last = count - 1 - first
    triangles = np.concatenate([np.column_stack([first, first + 1, last - 1]), np.column_stack([first, last - 1, last])])
    return triangles[(triangles[:, 0] < triangles[:, 1]) & (triangles[:, 1] < triangles[:, 2])]


def _closed(sections: np.ndarray, cap: np.ndarray) -> TriangleSurface:
    """Sections (k, m, 3) joined by a skin, and closed by triangles of the points of both end sections; normals outwards."""
    k, m, _ = sections.shape
    number = np.arange(k * m).reshape(k, m)
    after = np.roll(number, -1, axis=1)
    a, b, c, d = number[:-1], after[:-1], after[1:], number[1:]
    # Both diagonals of every quad meet in its middle: so mirror images of quads have mirror images of triangles.
    points = sections.reshape(-1, 3)
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    middles = 0.25 * ((points[quads[:, 0]] + points[quads[:, 1]]) + (points[quads[:, 2]] + points[quads[:, 3]]))
    centre = len(points) + np.arange(len(quads))
    skin = [np.column_stack([quads[:, i], quads[:, (i + 1) % 4], centre]) for i in range(4)]
    caps = [number[0][cap[:, ::-1]], number[-1][cap]]
    points = np.concatenate([points, middles])
    surface = TriangleSurface(points, np.concatenate([*skin, *caps]).astype(np.int64))
    return surface if surface.volume_m3 > 0.0 else TriangleSurface(points, surface.triangles[:, ::-1].copy())


def _refined(values: np.ndarray, step: float) -> np.ndarray:
    """The values with equal parts between them, none longer than the step."""
    parts = [np.linspace(a, b, int(np.ceil((b - a) / step)), endpoint=False) for a, b in pairwise(values)]
    return np.concatenate([*parts, values[-1:]])


def _row(table: BoneTable, name: str) -> np.ndarray:
    row = np.array(table[name], dtype=float)
    if row.ndim != 1 or len(row) < 2 or (np.diff(row) <= 0.0).any():
        raise ValueError(f"{name} must be a row of rising numbers")
    return row


def _table(table: BoneTable, name: str, shape: tuple[int, ...]) -> np.ndarray:
    values = np.array(table[name], dtype=float)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} must have the shape {shape}")
    return values
