"""The model of an indentation from the tables of a specimen and its tool.

The mesh is fine where the tool's edge is and below it, and grows away from there. The surface is sampled at points of its faces
for contact: Gauss points, and in a sector those of the line that turns into the surface.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.mesh.box import gridded_block, ringed_block
from explicitfe.fem.mesh.cylinder import cylinder_mesh, sector_mesh
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, shape_functions
from explicitfe.fem.mesh.size import check_size
from explicitfe.fem.mesh.stations import stations
from explicitfe.fem.model.gravity import gravity_load
from explicitfe.fem.model.model import Model, RotationalSymmetry, Tool
from explicitfe.platform.errors import InputError, shortened
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.effects import check_effects

# One degree: a polygon of so many sides has 5e-5 less area than its circle.
SECTOR_RAD = np.radians(1.0)
# How many of each part make the whole body.
COPIES = {"sector": 2.0 * np.pi / SECTOR_RAD, "quarter": 4.0, "half": 2.0, "whole": 1.0}
# Neighbouring elements differ by no more than this ratio, so that no large one hangs on a small one.
CELL_GROWTH_RATIO = 1.3
# Size of the largest elements, relative to the smaller of radius and height: ten across it.
LARGEST_CELL_SHARE = 0.1
ELEMENTS_AROUND_A_QUARTER = 8
# Along each edge of a face: two Gauss points integrate a pressure exactly that is cubic along it.
CONTACT_POINTS_PER_EDGE = 2
# The fine zone of a flat tool begins at this share of its radius, as tissue slides outwards under it, into the edge.
FINE_ZONE_START_SHARE = 0.7
# Points of the surface further from the axis than so many radii of the tool are left out: the tissue does not come from there.
CONTACT_REACH_RADII = 1.25
# A rough tool: only points that are about to lift still slip. A limit without end would let the force jump where a point lifts.
STICK_COEFFICIENT = 1.0
# Size of the elements at the tool's edge, by default, relative to the rounding, to a ball's radius and to a bonded disc's radius.
EDGE_CELL_SHARE_OF_ROUNDING, EDGE_CELL_SHARE_OF_BALL, EDGE_CELL_SHARE_OF_DISC = 0.4, 0.08, 1.0 / 60.0


def specimen_model(specimen: SpecimenTable, tool: ToolTable, effects: Sequence[Effect] = ()) -> Model:
    """A specimen under a tool, as in an indentation test.

    Parameters
    ----------
    specimen : its shape, material and boundary conditions.
    tool : its shape, size and friction.
    effects : effects of the material, the specimen or the tool (docs/reference/effects.md).

    Returns
    -------
    The model, for :class:`Relaxation`. Of a symmetric specimen only a part is meshed; ``model.copies`` of it make the whole.

    Raises
    ------
    InputError : too many elements, an unknown material, or an effect that cannot be combined with the rest.
    """
    for name, table, kind in (("specimen", specimen, SpecimenTable), ("tool", tool, ToolTable)):
        if not isinstance(table, kind):
            raise InputError(f"specimen_model: {name} must be a {kind.__name__}, not {shortened(repr(table))}.")
    for effect in effects:
        if not isinstance(effect, Effect):
            raise InputError(f"specimen_model: effects must be a list of effects, not of {shortened(repr(effect))}.")
        if effect.acts_on == "muscle":
            raise InputError(f"effects: {effect.about.title} is an effect of muscles, and a specimen has no muscles; remove it.")
        specimen, tool = effect.prepare(specimen, tool)
    check_effects(effects, specimen.element)
    size = _edge_size(specimen, tool)
    mesh = _mesh(specimen, tool, size)
    material = catalogue.material(specimen.material)
    centres = mesh.points[mesh.hexes].mean(axis=1)
    in_layer = centres[:, 2] > 1e-3 * (specimen.thickness_mm - specimen.layer_mm)
    held, sector = _held(specimen, mesh)
    weight = (gravity_load(mesh, material, specimen.gravity_m_s2),) if any(specimen.gravity_m_s2) else ()
    model = Model(
        mesh=mesh,
        material=material,
        held=held,
        element=specimen.element,
        loads=weight,
        stiffness=np.where(in_layer, specimen.layer_stiffness_ratio, 1.0),
        tool=_tool(specimen, tool, mesh, size),
        sector=sector,
        copies=COPIES[specimen.symmetry],
    )
    for effect in effects:
        model = effect.apply(model)
    return model


# ---- the mesh ----


def _edge_size(specimen: SpecimenTable, tool: ToolTable) -> float:
    """Size of the elements at the tool's edge [m]."""
    if specimen.edge_size_mm is not None:
        size = specimen.edge_size_mm
    elif tool.shape == "flat-cylinder":
        size = EDGE_CELL_SHARE_OF_ROUNDING * tool.rounding_mm
    elif tool.shape == "sphere":
        size = EDGE_CELL_SHARE_OF_BALL * tool.outer_radius_mm
    elif tool.shape == "bonded-disc":
        size = EDGE_CELL_SHARE_OF_DISC * tool.outer_radius_mm
    else:
        size = LARGEST_CELL_SHARE * min(specimen.thickness_mm, specimen.smallest_radius_mm)
    return size * 1e-3 / specimen.refinement


def _mesh(specimen: SpecimenTable, tool: ToolTable, size: float) -> HexMesh:
    height = 1e-3 * specimen.thickness_mm
    largest = max(size, 1e-3 * LARGEST_CELL_SHARE * min(specimen.thickness_mm, specimen.smallest_radius_mm) / specimen.refinement)
    # Lower bounds of the number of elements, before anything is cut that fine.
    _affordable(max(1.0, 1e-3 * specimen.smallest_radius_mm / largest) * max(1.0, height / largest))
    layer = 1e-3 * specimen.layer_mm
    top = min(size, 0.5 * layer) if layer > 0.0 else size
    zones = [(height - 2.0 * top, height, top)]
    heights = stations(height, zones, largest_m=largest, growth=CELL_GROWTH_RATIO, breaks_m=[height - layer] if layer else [])

    reach = 0.0 if tool.radius_mm is None else 1e-3 * tool.radius_mm
    breaks = []
    if tool.shape == "flat-cylinder":
        zones = [(FINE_ZONE_START_SHARE * reach, reach + 0.5 * size, size)]
    elif tool.shape == "sphere":
        zones = [(0.0, reach, size)]
    elif tool.shape == "bonded-disc":
        zones, breaks = [(reach - 2.0 * size, reach + 2.0 * size, size)], [reach]
    else:
        zones = []
    if specimen.bonded_radius_mm is not None:
        breaks = [*breaks, 1e-3 * specimen.bonded_radius_mm]

    _affordable(_fewest_cells(1e-3 * specimen.smallest_radius_mm, zones, largest) * len(heights))
    if specimen.size_mm is None:
        radius = 1e-3 * specimen.smallest_radius_mm
        radii = stations(
            radius, [z for z in zones if z[0] < radius], largest_m=largest, growth=CELL_GROWTH_RATIO, breaks_m=breaks
        )
        around = 1 if specimen.symmetry == "sector" else COPIES["quarter"] / COPIES[specimen.symmetry] * _around(specimen)
        _affordable(len(radii) * len(heights) * around)
        if specimen.symmetry == "sector":
            return sector_mesh(radii, heights, SECTOR_RAD)
        return cylinder_mesh(radii, heights, _around(specimen), specimen.symmetry, core_m=FINE_ZONE_START_SHARE * reach or np.inf)
    quarters = COPIES["quarter"] / COPIES[specimen.symmetry]
    half = 0.5e-3 * specimen.size_mm[0], 0.5e-3 * specimen.size_mm[1]
    _affordable(half[0] / largest * half[1] / largest * len(heights) * quarters)
    circle = zones[0][1] + 2.0 * size if zones else np.inf
    if circle < 0.95 * min(half):
        radii = stations(circle, zones, largest_m=largest, growth=CELL_GROWTH_RATIO, breaks_m=breaks)
        core = FINE_ZONE_START_SHARE * reach
        _affordable(2.0 * len(radii) * len(heights) * _around(specimen) * quarters)
        return ringed_block(
            half, radii, heights, _around(specimen), specimen.symmetry, largest_m=largest, growth=CELL_GROWTH_RATIO, core_m=core
        )
    x, y = (stations(h, [(0.0, h, size)] if zones else [], largest_m=largest, growth=CELL_GROWTH_RATIO) for h in half)
    _affordable(len(x) * len(y) * len(heights) * quarters)
    return gridded_block(x, y, heights, specimen.symmetry)


def _fewest_cells(length: float, zones: Sequence[tuple[float, float, float]], largest: float) -> float:
    """Along a length with zones (start, stop, size) of small cells, all in m; what grows in between is not counted."""
    within = [max(0.0, min(stop, length) - max(start, 0.0)) / size for start, stop, size in zones]
    return max(1.0, length / largest, *within)


def _affordable(count: float) -> None:
    check_size(count, "model: this specimen", "give a larger edge_size_mm, a smaller refinement or a thicker specimen")


def _around(specimen: SpecimenTable) -> int:
    return max(4, 2 * round(0.5 * ELEMENTS_AROUND_A_QUARTER * specimen.refinement))


# ---- what holds and what presses ----


def _held(specimen: SpecimenTable, mesh: HexMesh) -> tuple[np.ndarray, RotationalSymmetry | None]:
    """Components that do not move (n, 3), and the symmetry of a sector."""
    held = np.zeros((mesh.node_count, 3), dtype=bool)
    sets = mesh.node_sets
    base = sets["base"]
    held[base, 2] = True
    away = np.hypot(mesh.points[base, 0], mesh.points[base, 1])
    if specimen.base == "bonded":
        within = np.inf if specimen.bonded_radius_mm is None else 1e-3 * specimen.bonded_radius_mm
        held[base[away <= within * (1.0 + 1e-9)]] = True
    for plane, axis in (("x0", 0), ("y0", 1)):
        if plane in sets:
            held[sets[plane], axis] = True
    # A body that slides could also drift or turn as a whole; nothing presses it to, so the middle of its base is held.
    held[base[away == 0.0], :2] = True
    sector = None
    if specimen.symmetry == "sector":
        held[sets["plane"], 1] = True
        held[sets["axis"], :2] = True
        sector = RotationalSymmetry(sets["turned"], sets["turned_from"], float(SECTOR_RAD))
    return held, sector


def _tool(specimen: SpecimenTable, tool: ToolTable, mesh: HexMesh, size: float) -> Tool:
    radius = 1e-3 * tool.outer_radius_mm
    tied = tool.shape == "bonded-disc"
    # A ball is all edge; its upper half has no wall.
    edge = {"flat-cylinder": 1e-3 * tool.rounding_mm, "sphere": radius}.get(tool.shape, 0.0)
    surface = ("top", "side") if tool.shape == "platen" else ("top",)
    nodes, weights, areas = _sector_points(mesh, surface) if specimen.symmetry == "sector" else _face_points(mesh, surface)
    place = np.einsum("kc,kci->ki", weights, mesh.points[nodes])
    facing = np.where(place[:, 2] > 1e-3 * specimen.thickness_mm * (1.0 - 1e-9), areas, 0.0)
    near = np.hypot(place[:, 0], place[:, 1]) <= (1.0 if tied else CONTACT_REACH_RADII) * radius
    return Tool(
        flat_radius_m=radius - edge,
        edge_radius_m=edge,
        wall=tool.shape == "flat-cylinder",
        height_m=1e-3 * specimen.thickness_mm,
        friction=STICK_COEFFICIENT if tool.friction == "stick" else float(tool.friction),
        nodes=nodes[near],
        weights=weights[near],
        areas_m2=areas[near],
        facing_m2=facing[near],
        face_size_m=size,
        tied=tied,
    )


def _sector_points(mesh: HexMesh, surface: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact points of a sector on its near plane: nodes (k, 4), weights (k, 4), and the areas (k,) m^2 of their arcs."""
    share, weight = np.polynomial.legendre.leggauss(CONTACT_POINTS_PER_EDGE)
    share, weight = 0.5 * (share + 1.0), 0.5 * weight
    parts = []
    for name in surface:
        chain = np.intersect1d(mesh.node_sets[name], mesh.node_sets["plane"])
        chain = chain[np.lexsort((mesh.points[chain, 2], mesh.points[chain, 0]))]
        start, end = chain[:-1], chain[1:]
        length = np.linalg.norm(mesh.points[end] - mesh.points[start], axis=1)
        for s, w in zip(share, weight, strict=True):
            radius = (1.0 - s) * mesh.points[start, 0] + s * mesh.points[end, 0]
            # only two nodes carry a point; the others of its four have no weight
            nodes = np.stack([start, end, start, end], axis=1)
            parts.append((nodes, np.tile([1.0 - s, s, 0.0, 0.0], (len(start), 1)), SECTOR_RAD * w * length * radius))
    nodes, weights, areas = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return nodes, weights, areas


def _face_points(mesh: HexMesh, surface: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact points of a body: nodes (k, 4) and shape functions (k, 4) of their faces, and areas (k,) m^2."""
    faces = np.concatenate([_faces(mesh, name) for name in surface])
    share, weight = np.polynomial.legendre.leggauss(CONTACT_POINTS_PER_EDGE)
    x, y = (grid.ravel() for grid in np.meshgrid(share, share))
    weight = np.outer(weight, weight).ravel()
    natural = np.column_stack([x, y, np.full(len(x), -1.0)])
    shape = shape_functions(natural)[:, :4]
    step = 1e-6
    along = [
        (shape_functions(natural + step * e) - shape_functions(natural - step * e))[:, :4] / (2.0 * step) for e in np.eye(3)[:2]
    ]
    corners = mesh.points[faces]
    tangents = [np.einsum("qc,fci->fqi", slope, corners) for slope in along]
    areas = np.linalg.norm(np.cross(*tangents), axis=2) * weight
    count = len(faces)
    return np.repeat(faces, len(shape), axis=0), np.tile(shape, (count, 1)), areas.ravel()


def _faces(mesh: HexMesh, name: str) -> np.ndarray:
    """Faces of elements (k, 4), corner after corner, whose nodes all belong to a set."""
    inside = np.zeros(mesh.node_count, dtype=bool)
    inside[mesh.node_sets[name]] = True
    faces = mesh.hexes[:, FACES].reshape(-1, 4)
    return faces[inside[faces].all(axis=1)]
