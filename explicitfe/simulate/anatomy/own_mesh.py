"""User-defined models: a mesh file, and a model file that describes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import (
    LONGEST_NAME_CHARACTERS,
    MOST_TABLES_OF_A_KIND,
    Name,
    Names,
    Table,
    Title,
    Vector,
    validated,
)
from explicitfe.fem.mesh.checked_arrays import FARTHEST_POINT_M
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.muscle_lines import Fibre, Muscle, locate_in_mesh, over_mean
from explicitfe.fem.mesh.quality import check
from explicitfe.fem.mesh.size import check_size
from explicitfe.fem.mesh.traced_fibres import harmonic_direction, trace_fibres
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.text import text_of, toml_of
from explicitfe.results.measure.sections import middle
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.meshes.content import FileMesh, nodes_of_cells
from explicitfe.simulate.meshes.mesh_file import read_mesh
from explicitfe.simulate.meshes.midpoints import Hexahedra, hexahedra, without_loose_nodes

_METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# Lists of the nodes of a fine mesh are long.
LARGEST_MODEL_FILE_BYTES = 32 * 2**20
SMALLEST_EXTENT_M = 1e-5
# Points of a fibre that lie nearer to each other than this share of the mesh are the same but for rounding.
_SAME_POINT_SHARE = 1e-9


class ByArray(Table):
    """Nodes or elements where an array of the mesh has a value."""

    point_data: str | None = None
    cell_data: str | None = None
    value: float


def _node_set(value: object) -> object:
    if isinstance(value, list) and all(type(node) is int for node in value):
        return value
    if isinstance(value, dict) and set(value) in ({"point_data", "value"}, {"cell_data", "value"}):
        return ByArray.model_validate(value, strict=True)
    raise ValueError('must be a list of node numbers, { point_data = "...", value = ... } or { cell_data = "...", value = ... }')


NodeSet = Annotated[list[int] | ByArray, BeforeValidator(_node_set)]


class FibreTable(Table):
    """One fibre, from origin to insertion: through nodes or through points, from a point in space if ``anchor`` is given."""

    side: Literal["left", "right"]
    nodes: list[int] = Field(default=[])
    points: list[Vector] = Field(default=[], description="in the mesh's length unit")
    anchor: Vector | None = Field(default=None, description="origin fixed in space (on a bone), in the mesh's length unit")
    tension: list[Annotated[float, Field(ge=0.0)]] = Field(
        default=[], description="at each node or point, in proportion; for muscle as stress; uniform if left out"
    )

    @model_validator(mode="after")
    def _nodes_or_points(self) -> FibreTable:
        if bool(self.nodes) == bool(self.points):
            raise ValueError("give either nodes or points")
        count = len(self.nodes) + len(self.points)
        if self.tension and len(self.tension) != count:
            raise ValueError(f"tension needs a value for each of the {count} points, not {len(self.tension)}")
        if self.tension and not any(self.tension):
            raise ValueError("tension is 0 at every point; at least one value must be above 0")
        if len(self.nodes) + len(self.points) + (self.anchor is not None) < 2:
            raise ValueError("a fibre needs at least two points")
        return self


class FileMuscle(Table):
    """One muscle of a model file: by its fibres, by an element set and their direction, or between two node sets."""

    name: Name
    title: Title = ""
    max_force_N: float = Field(default=0.0, ge=0.0)
    origin_width_mm: float | None = Field(
        default=None, gt=0.0, description="width of its active stress at the origin, where fibres converge; 3 mm if left out"
    )
    elements: Name | None = Field(default=None, description="element set of the muscle; all of the body between two node sets")
    direction: Vector | None = Field(default=None, description="of all fibres of the element set")
    origin: Name | None = Field(default=None, description="node set where fibres begin; insertion is then required")
    insertion: Name | None = Field(default=None, description="node set where fibres end")
    side: Literal["left", "right"] | None = Field(default=None, description="of all its fibres; by their y if left out")
    fibre: list[FibreTable] = Field(default=[])

    @model_validator(mode="after")
    def _one_description(self) -> FileMuscle:
        between = self.origin is not None and self.insertion is not None
        along = self.elements is not None and self.direction is not None and any(self.direction)
        if (self.origin is None) != (self.insertion is None) or [bool(self.fibre), between, along].count(True) != 1:
            raise ValueError(
                "give one description of a muscle: [[muscle.fibre]] tables, elements and direction, or origin and insertion"
            )
        if self.fibre and (self.elements or self.side):
            raise ValueError("elements and side do not go with [[muscle.fibre]]; remove them")
        return self


class MeshFile(Table):
    """The schema of a model file: the mesh, and what is what in it."""

    title: Title = ""
    source: str = ""
    mesh: str = Field(description="mesh file, relative to this file")
    length_unit: Literal["m", "cm", "mm"]
    first_number: Literal[0, 1, "labels"] = Field(
        default=0, description="number of the first node in this file's lists, or that they have the labels of the mesh file"
    )
    node_sets: dict[str, NodeSet] = Field(default={}, description="further to those of the mesh file")
    fixed: Names = Field(default=[], description="node sets that are fixed")
    named_points: dict[str, int | Vector] = Field(default={}, description="node, or position in the mesh's length unit")
    muscle: list[FileMuscle] = Field(default=[], max_length=MOST_TABLES_OF_A_KIND)

    @field_validator("node_sets", "named_points")
    @classmethod
    def _names_can_be_stored(cls, named: dict[str, object]) -> dict[str, object]:
        for name in named:
            if not name.strip() or name == "." or "/" in name or len(name) > LONGEST_NAME_CHARACTERS:
                raise ValueError(
                    f'"{shortened(name)}" cannot be a name in a result file; use up to '
                    f'{LONGEST_NAME_CHARACTERS} letters and digits, without "/"'
                )
        return named

    @model_validator(mode="after")
    def _muscles_differ(self) -> MeshFile:
        for name, count in Counter(muscle.name for muscle in self.muscle).items():
            if count > 1:
                raise ValueError(f"{count} muscles have the name {name}; rename them, or put all fibres into one")
        return self


def read_model_file(path: Path) -> Anatomy:
    """The mesh, muscles and attachments that a model file describes.

    Raises
    ------
    InputError : the file or the mesh cannot be used; one sentence.
    """
    text = text_of(path, "model.file names the model file of a mesh", largest_bytes=LARGEST_MODEL_FILE_BYTES)
    data = toml_of(text, path)
    try:
        table = validated(MeshFile, data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, data, MeshFile).replace('the scenario', 'the model file')}") from None

    mesh_path = path.parent / table.mesh
    content = read_mesh(mesh_path)
    check_size(len(content.cells), f"{mesh_path}: the mesh", "mesh it coarser")
    unit = _METRES_PER_UNIT[table.length_unit]
    _check_extent(content.points * unit, mesh_path, table.length_unit)
    try:
        body = hexahedra(content.points * unit, content.cells, content.middles)
        check_size(len(body.hexes), f"{mesh_path}: the mesh", "mesh it coarser")
        number, bare = without_loose_nodes(body)
    except InputError as error:
        raise InputError(f"{mesh_path}: {str(error).removeprefix('HexMesh: ')}") from None
    check(bare, str(mesh_path))
    labels = _labels(content, table.first_number, path)

    def nodes(numbers: list[int], what: str) -> np.ndarray:
        places = [labels.get(one, -1) for one in numbers]
        wrong = [one for one, place in zip(numbers, places, strict=True) if place < 0 or number[place] < 0]
        if wrong:
            unknown = f"does not exist; the mesh has {len(content.points)} nodes"
            why = "belongs to no element" if wrong[0] in labels else unknown
            raise InputError(f"{path}: node {wrong[0]} in {what} {why}.")
        return number[np.array(places, dtype=np.int64)]

    sets, element_sets = _sets_of(content, body, number)
    for name, entry in table.node_sets.items():
        where = f"node_sets.{name}"
        if isinstance(entry, ByArray):
            chosen, cells = _by_array(content, entry, f"{path}: {where}")
            sets[name] = _left(number, body.nodes(chosen))
            if len(cells):
                element_sets[name] = body.elements(cells)
                sets[name] = np.unique(bare.hexes[element_sets[name]])
        else:
            nodes(entry, where)
            sets[name] = _left(number, body.nodes(np.array([labels[one] for one in entry], dtype=np.int64)))
    for name in table.fixed:
        if name not in sets and name in content.node_sets:
            raise InputError(f"{path}: fixed: the nodes of {name} belong to no element; name another node set.")
        if name not in sets:
            raise InputError(f'{path}: fixed names no node set "{name}"; {nearest(name, sets)}')
    mesh = HexMesh(bare.points, bare.hexes, node_sets=sets)
    for name, place in table.named_points.items():
        what = f"named_points.{name}"
        try:
            if isinstance(place, int):
                point = mesh.points_at_nodes(nodes([place], what))
            else:
                point = locate_in_mesh(mesh, np.array(place) * unit)
        except InputError as error:
            raise InputError(str(error) if str(path) in str(error) else f"{path}: {what}: {error}") from None
        mesh.named_points[name] = point

    muscles = {}
    for muscle in table.muscle:
        if not muscle.fibre:
            try:
                muscles[muscle.name] = _muscle_of_elements(mesh, muscle, element_sets)
            except InputError as error:
                raise InputError(f"{path}: muscle {muscle.name}: {error}") from None
            continue
        fibres = []
        for count, fibre in enumerate(muscle.fibre, 1):
            what = f"fibre {count} of muscle {muscle.name}"
            numbers = nodes(fibre.nodes, what)
            try:
                chain = mesh.points_at_nodes(numbers) if fibre.nodes else locate_in_mesh(mesh, np.array(fibre.points) * unit)
                tension = _tension(chain, fibre)
                chain = _anchored(chain, fibre.anchor, unit)
                _check_pieces(chain, mesh)
                fibres.append(Fibre.through(chain, fibre.side, mesh, tension))
            except InputError as error:
                raise InputError(f"{path}: {what}: {error}") from None
        width = None if muscle.origin_width_mm is None else 1e-3 * muscle.origin_width_mm
        muscles[muscle.name] = Muscle.of(muscle.name, muscle.title, muscle.max_force_N, tuple(fibres), origin_width_m=width)
    notes = (f"{mesh_path}: {body.note}",) if body.note else ()
    return Anatomy(path.stem, mesh, muscles, tuple(table.fixed), element_sets, notes)


def _muscle_of_elements(mesh: HexMesh, muscle: FileMuscle, element_sets: Mapping[str, np.ndarray]) -> Muscle:
    """A muscle without fibres of its own: they are traced."""
    elements = np.arange(mesh.element_count)
    if muscle.elements is not None:
        if muscle.elements not in element_sets:
            raise InputError(f'there is no element set "{muscle.elements}"; {nearest(muscle.elements, element_sets)}')
        elements = element_sets[muscle.elements]
    if muscle.direction is not None:
        direction = np.tile(np.array(muscle.direction) / np.linalg.norm(muscle.direction), (len(elements), 1))
    else:
        ends = [mesh.nodes_of(name) for name in (muscle.origin or "", muscle.insertion or "")]
        direction = harmonic_direction(mesh, elements, *ends)
    fibres, tissue = trace_fibres(mesh, elements, direction, middle(mesh), muscle.side)
    return replace(Muscle.of(muscle.name, muscle.title, muscle.max_force_N, fibres), elements=elements, tissue=tissue)


def _left(number: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """The numbers of those nodes that elements have."""
    left = number[nodes]
    return np.unique(left[left >= 0])


def _labels(content: FileMesh, first: int | str, path: Path) -> dict[int, int]:
    """Number of a node in the model file -> its place in the mesh file."""
    if first != "labels":
        return {place + int(first): place for place in range(len(content.points))}
    if not len(content.labels):
        raise InputError(
            f'{path}: first_number = "labels" needs a mesh file in which each node has one label (Abaqus without parts, Gmsh, '
            "FEBio); name sets of the mesh file, or count its nodes from 0."
        )
    return {int(label): place for place, label in enumerate(content.labels)}


def _sets_of(content: FileMesh, body: Hexahedra, number: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The node sets and element sets of a mesh file as those of its hexahedra."""
    elements = {name: body.elements(cells) for name, cells in content.element_sets.items()}
    nodes = {}
    for name, of in content.node_sets.items():
        of_elements = np.unique(body.hexes[elements.get(name, [])])
        whole = np.array_equal(of, nodes_of_cells(content.cells[content.element_sets[name]])) if len(of_elements) else False
        nodes[name] = _left(number, of_elements if whole else body.nodes(of))
    return {name: of for name, of in nodes.items() if len(of)}, elements


def _by_array(content: FileMesh, entry: ByArray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """The nodes, and the elements of a cell array, that have a value."""
    kind, name, arrays, each = "point", entry.point_data, content.point_data, "node"
    if name is None:
        kind, name, arrays, each = "cell", entry.cell_data or "", content.cell_data, "element"
    if name not in arrays:
        raise InputError(
            f'{where}: the mesh has no {kind} array "{shortened(name)}" with one number per {each}; {nearest(name, arrays)}'
        )
    chosen = np.flatnonzero(arrays[name] == entry.value)
    if not len(chosen):
        raise InputError(f"{where}: no {each} has {name} = {entry.value:g}.")
    if kind == "point":
        return chosen, chosen[:0]
    return nodes_of_cells(content.cells[chosen]), chosen


def _check_extent(points: np.ndarray, path: Path, unit: str) -> None:
    """Refuse a body of an implausible size."""
    extent_m = float(np.ptp(points, axis=0).max())
    farthest_m = float(np.abs(points).max())
    if extent_m < SMALLEST_EXTENT_M or farthest_m > FARTHEST_POINT_M:  # HexMesh refuses what is not finite
        raise InputError(
            f"{path}: the mesh is {extent_m:.3g} m large and reaches {farthest_m:.3g} m from its origin; a body must have "
            f'10 micrometres at least and lie within 100 m. Check length_unit = "{unit}".'
        )


def _check_pieces(chain: MaterialPoints, mesh: HexMesh) -> None:
    """InputError where two points in a row are the same: the piece between them has no direction to pull in."""
    lengths = np.linalg.norm(np.diff(chain.position, axis=0), axis=1)
    same = np.flatnonzero(lengths <= _SAME_POINT_SHARE * np.ptp(mesh.points, axis=0).max())
    if len(same):
        x, y, z = 1e3 * chain.position[same[0]]
        raise InputError(f"two successive points are at the same position, ({x:.2f}, {y:.2f}, {z:.2f}) mm; remove one of them.")


def _tension(chain: MaterialPoints, fibre: FibreTable) -> np.ndarray | None:
    """Of each segment over the fibre's mean, from that at its points; 1 outside, from the anchor on."""
    if not fibre.tension or len(chain) < 2:
        return None
    at = np.array(fibre.tension)
    tension = over_mean(0.5 * (at[:-1] + at[1:]), chain)
    return tension if fibre.anchor is None else np.append(1.0, tension)


def _anchored(chain: MaterialPoints, anchor: tuple[float, float, float] | None, unit: float) -> MaterialPoints:
    if anchor is None:
        return chain
    return MaterialPoints(
        element=np.concatenate([[-1], chain.element]),
        natural=np.concatenate([np.zeros((1, 3)), chain.natural]),
        position=np.concatenate([np.array([anchor]) * unit, chain.position]),
    )
