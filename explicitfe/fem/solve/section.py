"""The section of a specimen of revolution: its elements, unknowns and surface, see :mod:`explicitfe.fem.solve.revolution`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.mesh.stations import stations
from explicitfe.fem.solve import quad9

# Size of the smallest elements at the tool's edge over its rounding, over the radius of a ball and of a bonded disc, and at the
# side under a platen over the largest; size of the largest over the smaller of radius and height; ratio of neighbours. Larger
# elements at the edge leave steps in the depth where they pass it: 2.1 micrometres (root mean square, flat tool of 14 mm to
# 0.8 N) with 0.33 of the rounding and 0.6 with 0.18, and Newton's method needs fewer steps. Elements smaller than the last of
# these shares of the radius are stretched so much at a nearly sharp edge that it needs many times the steps, or fails.
SECTION_CELL_SHARE_OF_ROUNDING, SECTION_CELL_SHARE_OF_BALL, SECTION_CELL_SHARE_OF_DISC, SIDE_CELL_SHARE = 0.18, 0.08, 0.0075, 0.2
EDGE_CELL_SHARE_OF_RADIUS = 0.012
LARGEST_SECTION_CELL_SHARE, CELL_RATIO = 0.2, 1.6
# The fine zone of a flat tool begins at this share of its radius. Tissue slides outwards under a frictionless tool and is
# stretched where it passes the edge: at 5.6 mm under a radius of 14 mm the tissue at the edge came from 0.85 of the radius, and
# elements that were not refined there left steps of 20 to 80 micrometres in the depth. They are below 10 with this share.
FINE_SECTION_START_SHARE = 0.6
# Tissue that lies further from the axis than so many radii does not come under the tool.
SECTION_REACH_RADII = 1.3
CONTACT_POINTS_PER_QUAD_EDGE = 6
TINY_M = 1e-12


class Edges(NamedTuple):
    """Gauss points of some edges.

    Attributes
    ----------
    nodes, shape : (k, 3) nodes of the edge and their shape functions.
    places : (k, 2) reference places r, z [m].
    areas : (k,) area that a point stands for [m^2].
    """

    nodes: np.ndarray
    shape: np.ndarray
    places: np.ndarray
    areas: np.ndarray


class RevolvedSection:
    """Elements, unknowns and surface of a specimen.

    Attributes
    ----------
    r_lines, z_lines : lines between the elements, see :func:`lines`.
    points : (n, 2) nodes r, z [m], along z first.
    quads : the elements.
    at, spread : (p, 2) Gauss points, and about the size of the element there [m].
    numbers : (2 n,) number of each displacement among the ``count`` unknowns; -1 is held, and ``count`` is carried by the tool.
    band : largest difference of the unknowns of an element.
    surface, base : where the tool can meet the body, and where springs can hold it.
    tied : the tool is glued to the nodes that it covers.
    base_gives_way : springs hold a bonded base sideways.
    """

    def __init__(
        self, specimen: SpecimenTable, tool: ToolTable, r_lines: np.ndarray, z_lines: np.ndarray, *, base_gives_way: bool
    ) -> None:
        self.height = 1e-3 * specimen.thickness_mm
        self.base_gives_way = base_gives_way
        self.tied = tool.shape == "bonded-disc"
        self.r_lines, self.z_lines = r_lines, z_lines
        self.smallest = float(min(np.diff(r_lines).min(), np.diff(z_lines).min()))
        r, z = (np.sort(np.concatenate([lines, 0.5 * (lines[1:] + lines[:-1])])) for lines in (r_lines, z_lines))
        self.points = np.stack(np.meshgrid(r, z, indexing="ij"), axis=2).reshape(-1, 2)
        first = (2 * np.arange(len(r_lines) - 1)[:, None] * len(z) + 2 * np.arange(len(z_lines) - 1)).ravel()
        nodes = first[:, None] + (np.arange(3)[:, None] * len(z) + np.arange(3)).ravel()
        corners = self.points[nodes][:, [0, 8]]
        self.quads = quad9.quads_of(nodes, corners)
        self.at = np.einsum("qa,mai->mqi", quad9.SHAPE, self.points[nodes]).reshape(-1, 2)
        self.spread = np.repeat(corners[:, 1, 1] - corners[:, 0, 1], quad9.QUAD_POINTS)
        self._number(specimen, tool, base_gives_way)
        self.surface = self._edges(self._reached(specimen, tool))
        self.base = self._edges(self.points[:, 1] < TINY_M)
        self.element_dofs, self.surface_dofs, self.base_dofs = _dofs(nodes), _dofs(self.surface.nodes), 2 * self.base.nodes
        self.element_numbers = self.numbers[self.element_dofs]
        on_tool = np.full((len(self.surface.areas), 1), self.count)
        self.surface_numbers = np.concatenate([self.numbers[self.surface_dofs], on_tool], axis=1)
        self.base_numbers = self.numbers[self.base_dofs]
        inner = np.where((self.element_numbers < 0) | (self.element_numbers == self.count), -1, self.element_numbers)
        least = np.where(inner < 0, self.count, inner).min(axis=1)
        self.band = int((inner.max(axis=1) - least).max())

    def _number(self, specimen: SpecimenTable, tool: ToolTable, base_gives_way: bool) -> None:
        r, z = self.points.T
        base, top = z < TINY_M, z > self.height - TINY_M
        within = np.inf if specimen.bonded_radius_mm is None else 1e-3 * specimen.bonded_radius_mm
        held = np.zeros((len(r), 2), dtype=bool)
        held[r < TINY_M, 0] = True
        held[base, 1] = True
        if specimen.base == "bonded" and not base_gives_way:
            held[base & (r <= within * (1.0 + 1e-9)), 0] = True
        carried = top & (r <= 1e-3 * tool.outer_radius_mm * (1.0 + 1e-9)) & self.tied
        held[carried] = True
        self.free = ~held.ravel()
        self.count = int(self.free.sum())
        self.numbers = np.full(2 * len(r), -1)
        self.numbers[self.free] = np.arange(self.count)
        self.carried = 2 * np.flatnonzero(carried) + 1
        self.numbers[self.carried] = self.count

    def _reached(self, specimen: SpecimenTable, tool: ToolTable) -> np.ndarray:
        """Nodes (n,) of the surface that the tool can meet."""
        r, z = self.points.T
        top = z > self.height - TINY_M
        if tool.shape == "platen":
            return top | (r > r.max() - TINY_M)
        return top & (r <= SECTION_REACH_RADII * 1e-3 * tool.outer_radius_mm) & (not self.tied)

    def _edges(self, inside: np.ndarray) -> Edges:
        """Gauss points of the edges whose nodes are all inside (n,)."""
        sides = np.array([[0, 1, 2], [6, 7, 8], [0, 3, 6], [2, 5, 8]])  # low r, high r, low z, high z
        nodes = self.quads.nodes[:, sides].reshape(-1, 3)
        nodes = nodes[inside[nodes].all(axis=1)]
        x, weight = np.polynomial.legendre.leggauss(CONTACT_POINTS_PER_QUAD_EDGE)
        shape = quad9.along_a_line(x)[0]
        places = np.einsum("qa,eai->eqi", shape, self.points[nodes])
        length = np.linalg.norm(self.points[nodes[:, 2]] - self.points[nodes[:, 0]], axis=1)
        areas = np.pi * places[:, :, 0] * length[:, None] * weight
        each = np.repeat(nodes, len(x), axis=0)
        return Edges(each, np.tile(shape, (len(nodes), 1)), places.reshape(-1, 2), areas.ravel())


def _dofs(nodes: np.ndarray) -> np.ndarray:
    """Displacements (k, 2 a) of nodes (k, a), r and z in turn."""
    return np.stack([2 * nodes, 2 * nodes + 1], axis=2).reshape(len(nodes), 2 * nodes.shape[1])


def lines(specimen: SpecimenTable, tool: ToolTable, fineness: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines r and z [m] between the elements: fine at the tool's edge and at the surface."""
    radius, height = 1e-3 * specimen.smallest_radius_mm, 1e-3 * specimen.thickness_mm
    reach = 0.0 if tool.radius_mm is None else 1e-3 * tool.radius_mm
    largest = LARGEST_SECTION_CELL_SHARE * min(radius, height) / fineness
    breaks: list[float] = []
    if tool.shape == "flat-cylinder":
        size = max(SECTION_CELL_SHARE_OF_ROUNDING * 1e-3 * tool.rounding_mm, EDGE_CELL_SHARE_OF_RADIUS * reach) / fineness
        zones = [(FINE_SECTION_START_SHARE * reach, reach + 0.5 * size, size)]
    elif tool.shape == "sphere":
        size = SECTION_CELL_SHARE_OF_BALL * reach / fineness
        zones = [(0.0, reach, size)]
    elif tool.shape == "bonded-disc":
        size = SECTION_CELL_SHARE_OF_DISC * reach / fineness
        zones, breaks = [(reach - size, reach + size, size)], [reach]
    else:
        size = SIDE_CELL_SHARE * largest
        zones = [(radius - size, radius, size)]
    if specimen.bonded_radius_mm is not None:
        breaks.append(1e-3 * specimen.bonded_radius_mm)
    layer = 1e-3 * specimen.layer_mm
    size, largest = min(size, largest), max(size, largest)
    top = min(size, 0.5 * layer) if layer > 0.0 else size
    zones = [zone for zone in zones if zone[0] < radius]
    r_lines = stations(radius, zones, largest_m=largest, growth=CELL_RATIO, breaks_m=breaks)
    z_breaks = [height - layer] if layer > 0.0 else []
    z_lines = stations(height, [(height - top, height, top)], largest_m=largest, growth=CELL_RATIO, breaks_m=z_breaks)
    return r_lines, z_lines
