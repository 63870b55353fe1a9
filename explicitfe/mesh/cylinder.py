"""Hex meshes of the specimens that a tool presses: cylinders and blocks.

The base lies at z = 0, the tool comes down the z axis. A plane section is made of quads and extruded. Round sections
are butterfly grids: a rounded square of quads around the axis, a few layers that lead over to a circle, then rings.

A polygon through nodes on a circle has less area than the circle. The nodes of a ring of nominal radius r therefore stand
at r sqrt(phi / sin(phi)), phi the angle between neighbours: the polygon then has the area of the circle of radius r, the
mesh the volume of the cylinder, and the nodes under a tool of that radius its area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.mesh.hexmesh import HexMesh

# The axes, x = 0 and y = 1, across which the quarter is mirrored.
SYMMETRIES = {"quarter": (), "half": (0,), "whole": (0, 1)}

# Marks of ``stations`` nearer than this share of the length are one: far below any element, far above rounding.
_SAME = 1e-9

# How far the ratio of neighbouring cells may exceed ``growth`` where two intervals meet.
_FIT = 1.05

# The core's outline is this much circle, the rest square: three quads then meet at its corner with angles near 120 degrees.
_ROUNDNESS = 0.5

# One layer between core and circle for every so many elements around a quarter: the outline bulges by a fifth of its radius
# at the corner, less than a layer can lose.
_AROUND_PER_LAYER = 8


# --- stations --------------------------------------------------------------------------------------------------------


def stations(
    length_m: float,
    zones: Sequence[tuple[float, float, float]],
    *,
    largest_m: float,
    growth: float = 1.25,
    breaks_m: Sequence[float] = (),
) -> np.ndarray:
    """Where to cut a length: small cells in the zones, growing away from them; (k,) m, from 0 to ``length_m``.

    Parameters
    ----------
    length_m : the length, m.
    zones : (start, stop, size) each, m. No cell between start and stop is larger than size. They may reach beyond the length.
    largest_m : no cell is larger, m.
    growth : neighbouring cells differ by no more than this ratio, by 5 % more where a mark forces them to.
    breaks_m : positions to hit, m; those outside the length do not count.

    Breaks and bounds of zones are hit to the last bit. Of marks nearer to each other than 1e-9 of the length only one is:
    the ends come first, then breaks, then bounds.

    Raises
    ------
    ValueError
        A length or size that is not positive, a growth not above 1, a zone that stops before it starts, a break not finite.
    """
    zones = np.array(zones, dtype=float).reshape(-1, 3)
    positive = np.array([length_m, largest_m, *zones[:, 2]])
    if not (np.isfinite(positive).all() and (positive > 0.0).all()):
        raise ValueError("length, largest size and sizes of zones must be positive")
    if not growth > 1.0:
        raise ValueError(f"growth must be above 1, not {growth}")
    if not (zones[:, 0] <= zones[:, 1]).all() or not np.isfinite(breaks_m).all():
        raise ValueError("a zone must not stop before it starts, breaks must be finite")

    marks = [0.0, float(length_m)]
    for mark in [*breaks_m, *zones[:, :2].ravel()]:
        if 0.0 < mark < length_m and np.abs(np.array(marks) - mark).min() > _SAME * length_m:
            marks.append(float(mark))
    marks = np.sort(marks)

    while True:
        positions = _divided(marks, zones, largest_m, np.log(growth))
        cells = np.diff(positions)
        # A small cell between two marks is a zone of its own: the cells around have to grow from it.
        lower, upper = cells[:-1], cells[1:]
        small = np.union1d(
            np.flatnonzero(upper > _FIT * growth * lower),
            np.flatnonzero(lower > _FIT * growth * upper) + 1,
        )
        if len(small) == 0:
            return positions
        zones = np.concatenate([zones, np.column_stack([positions[small], positions[small + 1], cells[small]])])


def _divided(marks: np.ndarray, zones: np.ndarray, largest: float, slope: float) -> np.ndarray:
    """The marks and, between them, whole cells that follow the size h(x): the smallest that a zone asks for at x.

    A cell is a step of 1 in the integral of 1 / h. Where h = size + slope * distance, cells grow by exp(slope). Between two
    marks all cells shrink alike, to a whole number of them.
    """
    start, stop, size = zones.T
    rise = (size[:, None] - size) / slope
    kinks = [
        marks,
        start - (largest - size) / slope,
        stop + (largest - size) / slope,
        ((stop + start[:, None] + rise) / 2.0).ravel(),
        (stop + rise).ravel(),
        (start - rise).ravel(),
    ]
    x = np.unique(np.concatenate(kinks))
    x = x[(x >= marks[0]) & (x <= marks[-1])]
    distance = np.maximum(np.maximum(start - x[:, None], x[:, None] - stop), 0.0)
    h = np.minimum(largest, (size + slope * distance).min(axis=1, initial=np.inf))

    # h is linear between kinks, so the integral is a logarithm and its inverse an exponential.
    width = np.diff(x)
    change = h[1:] / h[:-1] - 1.0
    count = width / h[:-1] * _ratio(np.log1p(change), change)
    total = np.concatenate([[0.0], np.cumsum(count)])
    rate = np.diff(h) / width

    pieces = []
    ends = total[np.searchsorted(x, marks)]
    for mark, first, last in zip(marks[:-1], ends[:-1], ends[1:], strict=True):
        whole = max(1, int(np.ceil(last - first - _SAME)))
        goal = first + (last - first) * np.arange(1, whole) / whole
        k = np.searchsorted(total, goal, side="right") - 1
        part = goal - total[k]
        exponent = rate[k] * part
        pieces += [[mark], x[k] + h[k] * part * _ratio(np.expm1(exponent), exponent)]
    return np.concatenate([*pieces, marks[-1:]])


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """The ratio of two that vanish together, with the limit 1."""
    return np.divide(numerator, denominator, out=np.ones_like(denominator), where=denominator != 0.0)


# --- meshes ----------------------------------------------------------------------------------------------------------


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
    radii, heights = _rising(radii_m, "radii"), _rising(heights_m, "heights")
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
    return HexMesh(points, hexes, sets, {"top-centre": int(plane[-1, 0])})


def round_mesh(
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
    core, rings = _butterfly(_rising(radii_m, "radii"), around, core_m)
    return _extruded(_joined(core, rings), heights_m, symmetry)


def block_mesh(
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
    """A block with rings around the tool: a butterfly grid up to a circle, then rays to the walls.

    Parameters
    ----------
    half_m : half the size along x and y, m.
    radii_m : (k,) rising from 0, m. The last is the circle; it has to fit into the block.
    heights_m, around, symmetry, core_m : see ``round_mesh``.
    largest_m, growth : along a ray, cells grow by this ratio from the last radial step up to this size, m. All rays have as
        many cells; the sizes hold for one of mean length. A circle close to a wall makes thin cells there.

    Node sets and named point: see ``round_mesh``. For a tool larger than the block, and a flat plate: ``grid_mesh``.

    Raises
    ------
    ValueError
        As ``round_mesh``; a circle that reaches a wall.
    """
    radii = _rising(radii_m, "radii")
    core, rings = _butterfly(radii, around, core_m)
    circle = rings[-1]
    if not circle[0, 0] < min(half_m):
        raise ValueError(f"the circle of radius {radii[-1]} m does not fit into a block of half sizes {tuple(half_m)} m")

    walls = _walls(half_m, around)
    length = np.linalg.norm(walls - circle, axis=1).mean()
    share = stations(length, [(0.0, 0.0, radii[-1] - radii[-2])], largest_m=largest_m, growth=growth)[1:, None, None] / length
    return _extruded(_joined(core, np.concatenate([rings, (1.0 - share) * circle + share * walls])), heights_m, symmetry)


def grid_mesh(x_m: np.ndarray, y_m: np.ndarray, heights_m: np.ndarray, symmetry: str = "quarter") -> HexMesh:
    """A block as a structured grid.

    Parameters
    ----------
    x_m, y_m : (k,), (l,) rising from 0 to half the size, m.
    heights_m, symmetry : see ``round_mesh``.

    Node sets and named point: see ``round_mesh``.

    Raises
    ------
    ValueError
        Positions that do not rise from 0, an unknown symmetry.
    """
    x, y = _rising(x_m, "x"), _rising(y_m, "y")
    number = np.arange(len(x) * len(y)).reshape(len(x), len(y))
    outline = np.union1d(number[-1], number[:, -1])
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    return _extruded(_Section(grid.reshape(-1, 2), _quads(number), outline), heights_m, symmetry)


# --- plane sections --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Section:
    """A plane mesh of quads.

    Attributes
    ----------
    points : (n, 2) m. On the planes of symmetry x or y is exactly 0.
    quads : (m, 4) Node numbers, counter-clockwise.
    outline : (k,) The nodes on the free boundary.
    """

    points: np.ndarray
    quads: np.ndarray
    outline: np.ndarray


def _butterfly(radii: np.ndarray, around: int, core_m: float) -> tuple[np.ndarray, np.ndarray]:
    """The quarter of a disk: core (n + 1, n + 1, 2), n = around / 2, and rings (k, around + 1, 2) around it, m.

    The core's cells along x and y are the first two axes. Its outline, counter-clockwise, is where the rings join on.
    """
    if around < 4 or around % 2:
        raise ValueError(f"the elements around a quarter must be an even number of at least 4, not {around}")
    cells, layers = around // 2, -(-around // _AROUND_PER_LAYER)
    first = _first_ring(radii, cells + layers, core_m)

    phi = np.pi / 2.0 / around
    circle = _both_sides(np.column_stack([np.cos(np.arange(cells + 1) * phi), np.sin(np.arange(cells + 1) * phi)]))
    square = circle / circle.max(axis=1, keepdims=True)
    outline = _ROUNDNESS * circle + (1.0 - _ROUNDNESS) * square
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


def _joined(core: np.ndarray, rings: np.ndarray) -> _Section:
    """One section of a core and the rings around it."""
    inner = np.arange(core.shape[0] * core.shape[1]).reshape(core.shape[:2])
    outer = inner.size + np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
    outer = np.concatenate([[[*inner[-1], *inner[-2::-1, -1]]], outer])
    points = np.concatenate([core.reshape(-1, 2), rings.reshape(-1, 2)])
    return _Section(points, np.concatenate([_quads(inner), _quads(outer)]), outer[-1])


def _quads(number: np.ndarray) -> np.ndarray:
    """The quads (m, 4) of a grid of node numbers; counter-clockwise where the first axis turns left into the second."""
    return np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)


def _mirrored(section: _Section, axis: int) -> _Section:
    """The section and its mirror image, joined where the coordinate is 0."""
    points, quads = section.points, section.quads
    moved = np.flatnonzero(points[:, axis] != 0.0)
    image = np.arange(len(points))
    image[moved] = len(points) + np.arange(len(moved))
    turned = points[moved]
    turned[:, axis] *= -1.0
    # A mirror image turns clockwise: the other way around again.
    return _Section(
        np.concatenate([points, turned]),
        np.concatenate([quads, image[quads[:, [0, 3, 2, 1]]]]),
        np.union1d(section.outline, image[section.outline]),
    )


def _extruded(quarter: _Section, heights_m: np.ndarray, symmetry: str) -> HexMesh:
    """The mesh over the section that the quarter makes; nodes and elements count layer by layer from the base."""
    heights = _rising(heights_m, "heights")
    if symmetry not in SYMMETRIES:
        raise ValueError(f'symmetry must be one of {", ".join(SYMMETRIES)}, not "{symmetry}"')
    section = quarter
    for axis in SYMMETRIES[symmetry]:
        section = _mirrored(section, axis)

    count, layers = len(section.points), len(heights)
    first = count * np.arange(layers)[:, None]
    points = np.column_stack([np.tile(section.points, (layers, 1)), np.repeat(heights, count)])
    lower = first[:-1, :, None] + section.quads
    hexes = np.concatenate([lower, lower + count], axis=-1).reshape(-1, 8)

    zero = section.points == 0.0
    sections = {"side": np.sort(section.outline), "axis": np.flatnonzero(zero.all(axis=1))}
    sections |= {name: np.flatnonzero(zero[:, k]) for k, name in enumerate(("x0", "y0")) if k not in SYMMETRIES[symmetry]}
    sets = {"base": np.arange(count), "top": first[-1] + np.arange(count)}
    sets |= {name: (first + nodes).ravel() for name, nodes in sections.items()}
    return HexMesh(points, hexes, sets, {"top-centre": int(sets["axis"][-1])})


def _rising(values: np.ndarray, what: str) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.ndim != 1 or len(values) < 2 or values[0] != 0.0 or not np.isfinite(values).all() or (np.diff(values) <= 0.0).any():
        raise ValueError(f"{what} must rise from 0 in at least two finite values")
    return values
