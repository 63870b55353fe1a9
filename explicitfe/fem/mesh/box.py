"""Meshes of boxes: a regular grid, and blocks of tissue under a tool.

A block of tissue is an extruded plane section, as a cylinder is (see ``section.py``). Its axis is that of the tool. A symmetric
block is meshed in part.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.mesh.checked_arrays import LARGEST_LENGTH_M, number_array
from explicitfe.fem.mesh.cylinder import butterfly
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.section import Section, extruded, joined, quads, rising
from explicitfe.fem.mesh.size import check_size
from explicitfe.fem.mesh.stations import stations
from explicitfe.platform.errors import InputError, shortened


def box(cells: Sequence[int], size_m: Sequence[float]) -> HexMesh:
    """A regular mesh of a box with one corner at the origin.

    Parameters
    ----------
    cells : numbers of elements along x, y and z.
    size_m : lengths along x, y and z, m, up to 10 m each.

    Returns
    -------
    The mesh. The z index of nodes and elements runs fastest, then y, then x; the natural axes of every element are x, y and z.
    The six faces are node sets ``x0``, ``x1``, ``y0``, ``y1``, ``z0``, ``z1``; ``x0`` is the face at x = 0.

    Raises
    ------
    InputError : not three whole numbers of at least 1, not three lengths above 0, or more elements than fit into memory.
    """
    counts = np.asarray(cells)
    if counts.shape != (3,) or counts.dtype.kind not in "iu" or counts.min() < 1:
        raise InputError(
            f"box: cells must be three whole numbers of at least 1, such as (8, 4, 4), not {shortened(repr(cells))}."
        )
    lengths = number_array("box: size_m", size_m, (3,), largest=LARGEST_LENGTH_M)
    if lengths.min() <= 0.0:
        raise InputError(f"box: size_m must be three lengths above 0 in m, such as (0.04, 0.02, 0.02), not {size_m!r}.")
    check_size(float(np.prod(counts, dtype=float)), "box: this mesh", "reduce cells")
    stations_m = [np.linspace(0.0, length, n + 1) for n, length in zip(counts, lengths, strict=True)]
    points = np.stack(np.meshgrid(*stations_m, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(counts + 1)
    faces = {f"{axis}{side}": number.take(-side, axis=k).ravel() for k, axis in enumerate("xyz") for side in (0, 1)}
    return HexMesh(points, grid_hexes(number), faces)


def grid_hexes(number: np.ndarray) -> np.ndarray:
    """Hexes (m, 8) of a grid of node numbers (k, l, n): their natural axes run along its axes, and the last counts fastest."""
    low, high = slice(None, -1), slice(1, None)
    ring = [(low, low), (high, low), (high, high), (low, high)]
    return np.stack([number[i, j, k].ravel() for k in (low, high) for i, j in ring], axis=1)


def ringed_block(
    half_m: tuple[float, float],
    radii_m: np.ndarray,
    heights_m: np.ndarray,
    around: int,
    symmetry: str = "quarter",
    *,
    largest_m: float,
    growth: float = 1.25,
    core_m: float = np.inf,
) -> HexMesh:
    """A block of tissue with rings around the tool: a butterfly grid up to a circle, then rays to the walls.

    Parameters
    ----------
    half_m : half the size along x and y, m.
    radii_m : (k,) rising from 0, m. The last is the circle; it has to fit into the block.
    heights_m, around, symmetry, core_m : see ``cylinder_mesh``.
    largest_m, growth : along a ray, cells grow by this ratio from the last radial step up to this size, m. All rays have as
        many cells; the sizes hold for one of mean length. A circle close to a wall makes thin cells there.

    Node sets and named point: see ``cylinder_mesh``. For a tool larger than the block, and a flat plate: ``gridded_block``.

    Raises
    ------
    ValueError
        As ``cylinder_mesh``; a circle that reaches a wall.
    """
    radii = rising(radii_m, "radii")
    core, rings = butterfly(radii, around, core_m)
    circle = rings[-1]
    if not circle[0, 0] < min(half_m):
        raise ValueError(f"the circle of radius {radii[-1]} m does not fit into a block of half sizes {tuple(half_m)} m")

    walls = _walls(half_m, around)
    length = np.linalg.norm(walls - circle, axis=1).mean()
    share = stations(length, [(0.0, 0.0, radii[-1] - radii[-2])], largest_m=largest_m, growth=growth)[1:, None, None] / length
    return extruded(joined(core, np.concatenate([rings, (1.0 - share) * circle + share * walls])), heights_m, symmetry)


def gridded_block(x_m: np.ndarray, y_m: np.ndarray, heights_m: np.ndarray, symmetry: str = "quarter") -> HexMesh:
    """A block of tissue as a structured grid, with cells of any size along each axis.

    Parameters
    ----------
    x_m, y_m : (k,), (l,) rising from 0 to half the size, m.
    heights_m, symmetry : see ``cylinder_mesh``.

    Node sets and named point: see ``cylinder_mesh``.

    Raises
    ------
    ValueError
        Positions that do not rise from 0, an unknown symmetry.
    """
    x, y = rising(x_m, "x"), rising(y_m, "y")
    number = np.arange(len(x) * len(y)).reshape(len(x), len(y))
    outline = np.union1d(number[-1], number[:, -1])
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    return extruded(Section(grid.reshape(-1, 2), quads(number), outline), heights_m, symmetry)


def _walls(half: tuple[float, float], around: int) -> np.ndarray:
    """The ends (around + 1, 2) of the rays on the walls of a quarter block, m; one is the corner.

    Evenly on each wall, and as many on each as lets the ray to the corner leave the circle most nearly straight.
    """
    a, b = half
    on_x = round(np.arctan2(b, a) * around / (np.pi / 2.0))
    on_x = min(max(on_x, 1), around - 1)
    x = a * np.arange(around - on_x + 1)[::-1] / (around - on_x)
    y = b * np.arange(on_x + 1) / on_x
    return np.concatenate([np.column_stack([np.full_like(y, a), y]), np.column_stack([x, np.full_like(x, b)])[1:]])
