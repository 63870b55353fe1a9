"""Write ``models/tongue/teeth.npz``: crowns of teeth on the bones of the built-in tongue, for display.

The bones end in a smooth band where the teeth stand, and each crown covers a piece of it; see ``models/tongue/SOURCES.md``. Run
it again after a change of ``models/tongue/bones.toml``.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from explicitfe.app.view.mouth import TEETH_FILE, anchor_of
from explicitfe.fem.bones.tables import read_bones
from explicitfe.platform.host.shipped import folder_of
from explicitfe.results.measure.sections import X, Z, cut_surface

# Length of the crown, mesiodistal and labiolingual diameter, mm, from the central incisor to the second molar.
CROWNS_MM = {
    "palate": (
        (10.5, 8.5, 7.0),
        (9.0, 6.5, 6.0),
        (10.0, 7.5, 8.0),
        (8.5, 7.0, 9.0),
        (8.5, 7.0, 9.0),
        (7.5, 10.0, 11.0),
        (7.0, 9.0, 11.0),
    ),
    "jaw": (
        (9.0, 5.0, 6.0),
        (9.5, 5.5, 6.5),
        (11.0, 7.0, 7.5),
        (8.5, 7.0, 7.5),
        (8.0, 7.0, 8.0),
        (7.5, 11.0, 10.5),
        (7.0, 10.5, 10.0),
    ),
}
# Which way the edge of the teeth looks: down, up.
EDGE_SIGN = {"palate": -1.0, "jaw": 1.0}
# Sections of a bone stand on the vertical axis so far behind its front, at angles from the front to each side.
AXIS_BEHIND_FRONT_MM, LARGEST_ANGLE_DEG, SECTIONS_OF_ARCH = 45.0, 96.0, 49
# Depths below the edge at which a section is read, mm.
DEEPEST_READ_MM, DEPTHS_READ = 13.0, 27
ARCH_DEGREE = 8  # of the polynomials in the angle that give the direction of the arch
BESIDE_NODES_SHARE = 1e-3
# Above this depth the sides of a crown go straight up. Both sides are averaged over so many sections along the arch.
BAND_MM, AVERAGED_SECTIONS = 1.5, 5
# A crown stands out from the bone by this much on the side of the tongue and on that of the lip. There it bulges by so much more
# in the middle of its length. Below its neck, at this share of its length, it goes into the bone.
INNER_OUT_MM, OUTER_OUT_MM, BULGE_MM = 0.1, 0.4, 0.3
NECK_SHARE, SINK_MM = 0.9, 8.0
# Rings of a crown from the middle of its edge to below the gum: share of its length from the edge, and share of the size.
RING_LENGTHS = (-0.04, -0.04, -0.035, -0.02, 0.02, 0.1, 0.3, 0.55, 0.8, 1.0, 1.1)
RING_SIZES = (0.0, 0.55, 0.8, 0.93, 0.985, 1.0, 1.0, 0.98, 0.94, 0.88, 0.8)
POINTS_AROUND, RING_EXPONENT = 28, 5.0


def teeth() -> dict[str, np.ndarray]:
    """The arrays of the file: of each bone the rings (t, r, p, 3) mm of the crowns of the right half, sizes, and its anchor."""
    bones, arrays = read_bones(folder_of("models") / "tongue" / "bones.toml"), {}
    for name, sizes in CROWNS_MM.items():
        surface = bones[name].surface
        arrays |= {f"{name}_mm": _arch(surface.points, surface.triangles, name), f"{name}_size_mm": np.array(sizes)}
        arrays[f"{name}_anchor"] = anchor_of(surface.points)
    return arrays


class _Band(NamedTuple):
    """The band of a bone that holds the teeth, in vertical sections across it, mm.

    Attributes
    ----------
    along : (a,) how far each section stands along the band from the middle.
    place, outwards : (a, 2) a point of each section, x and y, and the unit vector out of the mouth in it.
    edge : (a,) z of the edge.
    depth : (d,) below the edge.
    inner, outer : (a, d) how far both sides of the band are out from ``place``.
    """

    along: np.ndarray
    place: np.ndarray
    outwards: np.ndarray
    edge: np.ndarray
    depth: np.ndarray
    inner: np.ndarray
    outer: np.ndarray


def _arch(points: np.ndarray, triangles: np.ndarray, name: str) -> np.ndarray:
    """The crowns of the right half of one arch, from the middle backwards."""
    band = _band(points, triangles, EDGE_SIGN[name])
    crowns, before = [], 0.0
    for length, width, thickness in CROWNS_MM[name]:
        crowns.append(_crown(band, before + 0.5 * width, (length, width, thickness), EDGE_SIGN[name]))
        before += width
    return np.reshape(crowns, (len(crowns), len(RING_SIZES), POINTS_AROUND, 3))


def _crown(band: _Band, middle: float, size: tuple[float, float, float], sign: float) -> np.ndarray:
    """Rings (r * p, 3) mm of the crown whose middle stands so far along the band."""
    length, width, thickness = size
    turn = np.linspace(0.0, 2.0 * np.pi, POINTS_AROUND, endpoint=False)
    across, out = (np.sign(part) * np.abs(part) ** (2.0 / RING_EXPONENT) for part in (np.cos(turn), np.sin(turn)))
    rings = []
    for share, size_share in zip(RING_LENGTHS, RING_SIZES, strict=True):
        along = middle + 0.5 * width * size_share * across
        at_depth = [[np.interp(max(share * length, 0.0), band.depth, row) for row in side] for side in (band.inner, band.outer)]
        inner, outer = (np.interp(along, band.along, side) for side in at_depth)
        inner = np.maximum(inner, outer - thickness)
        sunk = SINK_MM * max(share - NECK_SHARE, 0.0)
        inner = inner - INNER_OUT_MM + sunk
        outer = outer + OUTER_OUT_MM + BULGE_MM * np.sin(np.pi * np.clip(share, 0.0, 1.0)) - sunk
        from_place = 0.5 * (inner + outer) + 0.5 * (outer - inner) * size_share * out
        columns = [*band.place.T, *band.outwards.T, band.edge]
        x, y, out_x, out_y, edge = (np.interp(along, band.along, column) for column in columns)
        rings.append(np.column_stack([x + from_place * out_x, y + from_place * out_y, edge - sign * share * length]))
    return np.concatenate(rings)


def _band(points_m: np.ndarray, triangles: np.ndarray, sign: float) -> _Band:
    """Read the band of a bone, which is symmetric: first where it is, then in sections across it."""
    points = 1e3 * points_m
    axis = np.array([points[:, X].min() + AXIS_BEHIND_FRONT_MM, 0.0])
    angles = np.radians(np.linspace(0.0, LARGEST_ANGLE_DEG, SECTIONS_OF_ARCH))
    away = np.column_stack([-np.cos(angles), np.sin(angles)])
    places = []
    for direction in away:
        _, sides = _sides(triangles, points, axis, direction, np.zeros(1), sign)
        places.append(axis + sides[1, 0] * direction)
    place = np.array(places)
    # A smooth line through the places and their mirror images gives the directions across the band.
    turn = np.concatenate([-angles[:0:-1], angles])
    both = np.concatenate([place[:0:-1] * [1.0, -1.0], place])
    lines = [np.polynomial.Polynomial.fit(turn, column, ARCH_DEGREE) for column in both.T]
    place = np.column_stack([line(angles) for line in lines])
    tangent = np.column_stack([line.deriv()(angles) for line in lines])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    outwards = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    depth = np.linspace(0.0, DEEPEST_READ_MM, DEPTHS_READ)
    edge, both_sides = zip(
        *(_sides(triangles, points, *section, depth, sign) for section in zip(place, outwards, strict=True)), strict=True
    )
    sides = scipy.ndimage.uniform_filter1d(np.array(both_sides), AVERAGED_SECTIONS, axis=0, mode="nearest")
    inner, outer = sides.transpose(1, 0, 2)
    return _Band(along, place, outwards, np.array(edge), depth, inner, outer)


def _sides(
    triangles: np.ndarray, points: np.ndarray, place: np.ndarray, outwards: np.ndarray, depths: np.ndarray, sign: float
) -> tuple[float, np.ndarray]:
    """A vertical section of a bone: z of its edge, and how far its inner and outer side are out from a place, (2, d) mm."""
    from_place = points - [*place, 0.0]
    # A section in the midsagittal plane goes through nodes of the bone; one next to it does not.
    normal = np.array([outwards[1], -outwards[0]]) + [0.0, BESIDE_NODES_SHARE]
    cut = cut_surface(triangles, from_place[:, :2] @ normal)
    at = cut.at(from_place)
    out, height = at[:, :2] @ outwards, sign * at[:, Z]
    ends = np.array([pair for loop in cut.loops for pair in zip(loop, np.roll(loop, -1), strict=True)])
    # Not the other half of the arch.
    ends = ends[(at[ends] @ [0.0, 1.0, 0.0] > -place[1] - 1.0).all(axis=1) & (out[ends] > -AXIS_BEHIND_FRONT_MM).all(axis=1)]
    edge = float(height[ends].max())
    sides = np.array([_extent(out[ends], height[ends], edge - max(depth, BAND_MM)) for depth in depths]).T
    return sign * edge, sides


def _extent(out: np.ndarray, height: np.ndarray, level: float) -> tuple[float, float]:
    """The smallest and the largest of the places at which segments (s, 2) cross a height."""
    crossing = (height[:, 0] >= level) != (height[:, 1] >= level)
    out, height = out[crossing], height[crossing]
    at = out[:, 0] + (level - height[:, 0]) / (height[:, 1] - height[:, 0]) * (out[:, 1] - out[:, 0])
    return float(at.min()), float(at.max())


if __name__ == "__main__":
    file: Path = folder_of("models") / "tongue" / TEETH_FILE
    np.savez_compressed(file, **teeth())
    print(f"{file}: {file.stat().st_size / 1e3:.0f} kB")
