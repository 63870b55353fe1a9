"""Shapes of lips, hyoid bone, epiglottis and larynx, from the tables of ``models/tongue/context.toml``: rings of points.

Lengths are in mm; x points backwards, y to the speaker's right, z up.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.interpolate import CubicSpline, PchipInterpolator

RINGS_OF_A_PART, POINTS_OF_A_RING = 31, 20


class ContextTable(BaseModel):
    """A table of the file, whose comments say what its figures mean."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Mouth(ContextTable):
    """What both lips have in common."""

    middle_mm: float
    incisor_mm: float
    length_mm: float
    half_opening_mm: float
    limits_mm: tuple[float, float]
    corner_mm: float
    radius_mm: float
    corner_shares: tuple[float, float]
    depth_centre_mm: float


class PartTable(ContextTable):
    """One part, with one of ``profile_mm`` (a lip), ``axis_mm`` and ``sections_mm``."""

    moves_with: str
    profile_mm: list[tuple[float, float]] = []
    axis_mm: list[list[float]] = []
    sections_mm: list[list[float]] = []
    wall_mm: float = 0.0
    bent_back_mm: float = 0.0
    follows_root_mm: tuple[float, float] | None = None


class Opening(NamedTuple):
    """The opening of the lips: ``area`` mm2, ``length`` mm, and how far the jaw has lowered the lower lip, ``sunk`` mm."""

    area: float
    length: float
    sunk: float


@cache
def read_context(path: Path) -> tuple[Mouth, dict[str, PartTable]]:
    """The tables of a file: that of the mouth, and those of the parts by name."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return Mouth(**tables.pop("mouth")), {name: PartTable(**table) for name, table in tables.items()}


@cache
def still_part(path: Path, name: str) -> np.ndarray:
    """Rings (k, p, 3) of a part that keeps its shape; with a wall, the last ring is joined to the first."""
    table = read_context(path)[1][name]
    if table.axis_mm:
        return _rod(np.array(table.axis_mm))
    rows = np.array(table.sections_mm)
    rows = PchipInterpolator(np.arange(len(rows)), rows)(np.linspace(0, len(rows) - 1, RINGS_OF_A_PART))
    inside = _ellipses(rows, 0.0, table.bent_back_mm)
    return np.concatenate([_ellipses(rows, table.wall_mm), inside[::-1]]) if table.wall_mm else inside


def _ellipses(rows: np.ndarray, wall_mm: float, bent_back_mm: float = 0.0) -> np.ndarray:
    """Sections (k, p, 3) through a front and a rear in the midsagittal plane, larger by a wall, with sides that are bent back."""
    turn = np.linspace(0.0, 2.0 * np.pi, POINTS_OF_A_RING, endpoint=False)
    front, rear = rows[:, None, :2], rows[:, None, 2:4]
    half = 0.5 * (front - rear)
    half *= 1.0 + wall_mm / np.linalg.norm(half, axis=-1, keepdims=True)
    x, z = np.moveaxis(0.5 * (front + rear) + half * np.cos(turn)[:, None], -1, 0)
    return np.stack([x + bent_back_mm * np.sin(turn) ** 2, (rows[:, 4:] + wall_mm) * np.sin(turn), z], axis=-1)


def _rod(half: np.ndarray) -> np.ndarray:
    """Ellipses (k, p, 3) across an axis whose right half has rows of y, x, z, height and thickness."""
    whole = np.concatenate([half[:0:-1] * [-1.0, 1.0, 1.0, 1.0, 1.0], half])[:, [1, 0, 2, 3, 4]]
    along = _length_along(whole[:, :3])
    line, at = PchipInterpolator(along, whole), np.linspace(0.0, along[-1], RINGS_OF_A_PART)
    rows, tangent = line(at), line.derivative()(at)[:, :3]
    across = np.cross(tangent, [0.0, 0.0, 1.0])
    up = np.cross(across, tangent)
    across, up = (each[:, None] / np.linalg.norm(each, axis=1)[:, None, None] for each in (across, up))
    turn = np.linspace(0.0, 2.0 * np.pi, POINTS_OF_A_RING, endpoint=False)[:, None]
    return rows[:, None, :3] + 0.5 * (rows[:, None, 3:4] * np.sin(turn) * up + rows[:, None, 4:] * np.cos(turn) * across)


def _length_along(points: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def lip(mouth: Mouth, profile_mm: list[tuple[float, float]], opening: Opening) -> np.ndarray:
    """Rings (k, p, 3) of a lip from corner to corner, before the bone that carries it has moved."""
    longer = opening.length / mouth.length_mm
    half_width = float(np.clip(mouth.half_opening_mm / longer**2, *mouth.limits_mm))
    profile = np.array([*profile_mm, profile_mm[0]]) - [mouth.incisor_mm, mouth.middle_mm]
    base = profile[0, 1]
    edge = np.sign(base) * (np.sign(base) * profile[:, 1]).min()
    along = _length_along(profile)
    x, z = CubicSpline(along, profile, bc_type="periodic")(np.linspace(0.0, along[-1], POINTS_OF_A_RING, endpoint=False)).T
    from_edge = (z - edge) / (base - edge)
    # Protrusion moves the edge; the base stays on the face.
    x *= 1.0 + (longer - 1.0) * np.clip(1.0 - from_edge, 0.0, 1.0)
    across = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, RINGS_OF_A_PART))[:, None]
    y, smaller = across * (mouth.corner_mm + 0.5 * half_width), np.sqrt(1.0 - across**2)
    height, depth = (share + (1.0 - share) * smaller for share in mouth.corner_shares)
    half_height = opening.area / (np.pi * half_width) * np.sqrt(np.maximum(1.0 - (y / half_width) ** 2, 0.0))
    # The jaw carries the lower lip. The middle of the opening sinks half as far: the remainder is a change of shape.
    edges = np.sign(base) * (half_height - 0.5 * opening.sunk)
    x = mouth.incisor_mm - mouth.depth_centre_mm + (x + mouth.depth_centre_mm) * depth + 0.5 * y**2 / mouth.radius_mm
    return np.stack([x, np.broadcast_to(y, x.shape), mouth.middle_mm + edges + (base * height - edges) * from_edge], axis=-1)


@cache
def triangles_between_rings(rings: int, around: int, is_ring: bool) -> np.ndarray:
    """Faces (m, 3) of a surface over rings of points: the last ring is joined to the first, or fans close both ends."""
    number = np.arange(rings * around).reshape(rings, around)
    a, b = (number, np.roll(number, -1, axis=0)) if is_ring else (number[:-1], number[1:])
    quads = np.stack([a, np.roll(a, -1, axis=1), np.roll(b, -1, axis=1), b], axis=-1).reshape(-1, 4)
    fan = np.column_stack([np.zeros(around - 2, dtype=int), np.arange(1, around - 1), np.arange(2, around)])
    ends = [] if is_ring else [number[0][fan[:, ::-1]], number[-1][fan]]
    return np.concatenate([quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), *ends])
