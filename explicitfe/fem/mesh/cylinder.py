"""Hexahedral meshes of cylindrical specimens: a sector, a quarter, a half or the whole.

The base lies at z = 0, the tool comes down the z axis. A plane section is made of quads and extruded. Round sections
are butterfly grids: a rounded square of quads around the axis, a few layers that lead over to a circle, then rings.

A polygon through nodes on a circle has less area than the circle. The nodes of a ring of nominal radius r therefore stand
at r sqrt(phi / sin(phi)), phi the angle between neighbours: the polygon then has the area of the circle of radius r, the
mesh the volume of the cylinder, and the nodes under a tool of that radius its area.
"""

from __future__ import annotations

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.section import extruded, joined, rising

# The core's outline is this much circle, the rest square: three quads then meet at its corner with angles near 120 degrees.
_CIRCLE_SHARE_OF_CORE = 0.5

# One layer between core and circle for every so many elements around a quarter: the outline bulges by a fifth of its radius
# at the corner, less than a layer can lose.
_ELEMENTS_AROUND_PER_LAYER = 8


def sector_mesh(radii_m: np.ndarray, heights_m: np.ndarray, angle_rad: float) -> HexMesh:
    """A wedge of a cylinder, one element wide, for axisymmetric motion.

    Parameters
    ----------
    radii_m : (k,) rising from 0, m. Nodes stand at these radii on the planes theta = 0 (y = 0) and theta = angle.
    heights_m : (l,) rising from 0, m.
    angle_rad : between the planes, below pi.

    The nodes of the plane theta = 0 come first. Both planes share the nodes of the axis: elements there have their inner
    edges collapsed, corners 0 and 3 and corners 4 and 7 are one node each.

    Node sets: ``base``, ``top``, ``side``, ``axis``; ``plane``, the nodes at theta = 0 with the axis; ``turned``, those at
    theta = angle without it, and ``turned_from``, their partners in the plane in the same order.
    Named point: ``top-centre``.

    Raises
    ------
    ValueError
        Radii or heights that do not rise from 0, an angle out of range.
    """
    radii, heights = rising(radii_m, "radii"), rising(heights_m, "heights")
    if not 0.0 < angle_rad < np.pi:
        raise ValueError(f"the angle must lie between 0 and pi, not {angle_rad}")
    r, z = (grid.ravel() for grid in np.meshgrid(radii, heights))
    plane = np.arange(len(r)).reshape(len(heights), len(radii))
    turned_from = plane[:, 1:].ravel()
    turned = len(r) + np.arange(len(turned_from))
    image = np.column_stack([plane[:, 0], turned.reshape(len(heights), -1)])

    away = r[turned_from]
    points = np.concatenate(
        [
            np.column_stack([r, np.zeros_like(r), z]),
            np.column_stack([away * np.cos(angle_rad), away * np.sin(angle_rad), z[turned_from]]),
        ]
    )
    low, high = slice(None, -1), slice(1, None)
    ring = [(plane, low), (plane, high), (image, high), (image, low)]
    hexes = np.stack([number[k, i].ravel() for k in (low, high) for number, i in ring], axis=1)
    sets = {
        "base": np.union1d(plane[0], image[0]),
        "top": np.union1d(plane[-1], image[-1]),
        "side": np.union1d(plane[:, -1], image[:, -1]),
        "axis": plane[:, 0].copy(),
        "plane": plane.ravel(),
        "turned": turned,
        "turned_from": turned_from,
    }
    return HexMesh(points, hexes, sets).with_named_nodes({"top-centre": int(plane[-1, 0])})


def cylinder_mesh(
    radii_m: np.ndarray, heights_m: np.ndarray, around: int, symmetry: str = "quarter", *, core_m: float = np.inf
) -> HexMesh:
    """A cylinder as a butterfly grid.

    Parameters
    ----------
    radii_m : (k,) rising from 0, m. Nominal radii of the rings; the core replaces the first ones.
    heights_m : (l,) rising from 0, m.
    around : elements around a quarter, even, at least 4.
    symmetry : "quarter" (x, y >= 0), "half" (y >= 0) or "whole".
    core_m : the core ends within this radius, m, where there is a station: rings needed by a tool stay. Without, it ends
        where its cells are as large as the radial steps that follow.

    Node sets, as far as they have nodes: ``base``, ``top``, ``side``, ``axis``, and the planes of symmetry ``x0`` and ``y0``,
    where x or y is exactly 0. Named point: ``top-centre``. The volume is that of the cylinder (see the module).

    Raises
    ------
    ValueError
        Radii or heights that do not rise from 0, a bad ``around``, an unknown symmetry.
    """
    core, rings = butterfly(rising(radii_m, "radii"), around, core_m)
    return extruded(joined(core, rings), heights_m, symmetry)


# --- plane sections --------------------------------------------------------------------------------------------------


def butterfly(radii: np.ndarray, around: int, core_m: float) -> tuple[np.ndarray, np.ndarray]:
    """The quarter of a disk: core (n + 1, n + 1, 2), n = around / 2, and rings (k, around + 1, 2) around it, m.

    The core's cells along x and y are the first two axes. Its outline, counter-clockwise, is where the rings join on.
    """
    if around < 4 or around % 2:
        raise ValueError(f"the elements around a quarter must be an even number of at least 4, not {around}")
    cells, layers = around // 2, -(-around // _ELEMENTS_AROUND_PER_LAYER)
    first = _first_ring(radii, cells + layers, core_m)

    phi = np.pi / 2.0 / around
    circle = _both_sides(np.column_stack([np.cos(np.arange(cells + 1) * phi), np.sin(np.arange(cells + 1) * phi)]))
    square = circle / circle.max(axis=1, keepdims=True)
    outline = _CIRCLE_SHARE_OF_CORE * circle + (1.0 - _CIRCLE_SHARE_OF_CORE) * square
    area = 0.5 * (outline[:-1, 0] * outline[1:, 1] - outline[:-1, 1] * outline[1:, 0]).sum()
    # The core has the area of the circle that leaves the layers as thick as its cells are wide.
    outline *= radii[first] * cells / (cells + layers) * np.sqrt(np.pi / 4.0 / area)

    rings = radii[first:, None, None] * np.sqrt(phi / np.sin(phi)) * circle
    share = np.arange(1, layers)[:, None, None] / layers
    return _coons(outline), np.concatenate([(1.0 - share) * outline + share * rings[0], rings])


def _first_ring(radii: np.ndarray, cells: int, core_m: float) -> int:
    """The station that ends the core: ``cells`` equal cells up to it are nearest to the radial step that follows.

    Only up to where they get larger than the step: further out they may fit again, beyond the fine cells at the tool's edge.
    """
    steps = np.diff(radii)
    size = radii[1:] / cells / np.append(steps[1:], steps[-1])
    larger = np.flatnonzero(size >= 1.0)
    last = larger[0] + 1 if len(larger) else len(size)
    last = max(1, min(last, np.count_nonzero(radii[1:] <= core_m)))
    return 1 + int(np.argmin(np.abs(np.log(size[:last]))))


def _both_sides(eighth: np.ndarray) -> np.ndarray:
    """Points (n + 1, 2) from the x axis to the diagonal, and on to the y axis as the mirror image: (2 n + 1, 2)."""
    return np.concatenate([eighth, eighth[-2::-1, ::-1]])


def _coons(outline: np.ndarray) -> np.ndarray:
    """Nodes (n + 1, n + 1, 2) between the two axes and an outline (2 n + 1, 2) by transfinite interpolation (Coons 1967)."""
    n = len(outline) // 2
    u = np.arange(n + 1)[:, None, None] / n
    v = u.transpose(1, 0, 2)
    right, top = outline[None, : n + 1], outline[n:][::-1][:, None]
    ends = u * (1.0 - v) * outline[0] + (1.0 - u) * v * outline[-1] + u * v * outline[n]
    return (1.0 - v) * u * outline[0] + v * top + (1.0 - u) * v * outline[-1] + u * right - ends
