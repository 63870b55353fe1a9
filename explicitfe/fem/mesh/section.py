"""Plane sections of quadrilaterals, and specimens extruded from them and mirrored across planes of symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh

# The axes, x = 0 and y = 1, across which the quarter is mirrored.
SYMMETRIES = {"quarter": (), "half": (0,), "whole": (0, 1)}


@dataclass(frozen=True)
class Section:
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


def joined(core: np.ndarray, rings: np.ndarray) -> Section:
    """One section of a core and the rings around it."""
    inner = np.arange(core.shape[0] * core.shape[1]).reshape(core.shape[:2])
    outer = inner.size + np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
    outer = np.concatenate([[[*inner[-1], *inner[-2::-1, -1]]], outer])
    points = np.concatenate([core.reshape(-1, 2), rings.reshape(-1, 2)])
    return Section(points, np.concatenate([quads(inner), quads(outer)]), outer[-1])


def quads(number: np.ndarray) -> np.ndarray:
    """The quads (m, 4) of a grid of node numbers; counter-clockwise where the first axis turns left into the second."""
    return np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)


def mirrored(section: Section, axis: int) -> Section:
    """The section and its mirror image, joined where the coordinate is 0."""
    points, quads = section.points, section.quads
    moved = np.flatnonzero(points[:, axis] != 0.0)
    image = np.arange(len(points))
    image[moved] = len(points) + np.arange(len(moved))
    turned = points[moved]
    turned[:, axis] *= -1.0
    # A mirror image counts clockwise, so the order of its corners is reversed.
    return Section(
        np.concatenate([points, turned]),
        np.concatenate([quads, image[quads[:, [0, 3, 2, 1]]]]),
        np.union1d(section.outline, image[section.outline]),
    )


def extruded(quarter: Section, heights_m: np.ndarray, symmetry: str) -> HexMesh:
    """The mesh over the section that the quarter makes; nodes and elements count layer by layer from the base."""
    heights = rising(heights_m, "heights")
    if symmetry not in SYMMETRIES:
        raise ValueError(f'symmetry must be one of {", ".join(SYMMETRIES)}, not "{symmetry}"')
    section = quarter
    for axis in SYMMETRIES[symmetry]:
        section = mirrored(section, axis)

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
    return HexMesh(points, hexes, sets).with_named_nodes({"top-centre": int(sets["axis"][-1])})


def rising(values: np.ndarray, what: str) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.ndim != 1 or len(values) < 2 or values[0] != 0.0 or not np.isfinite(values).all() or (np.diff(values) <= 0.0).any():
        raise ValueError(f"{what} must rise from 0 in at least two finite values")
    return values
