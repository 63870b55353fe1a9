"""User-defined models: a hexahedral mesh that meshio reads, and a model file that describes it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import LONGEST_NAME_CHARACTERS, MOST_TABLES_OF_A_KIND, Name, Table, Title, Vector, validated
from explicitfe.fem.mesh.checked_arrays import FARTHEST_POINT_M
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.muscle_lines import Fibre, Muscle, locate_in_mesh, over_mean
from explicitfe.fem.mesh.quality import check
from explicitfe.fem.mesh.size import check_size
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.text import text_of, toml_of
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.anatomy.mesh_file import read_mesh

_METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# Lists of the nodes of a fine mesh are long.
LARGEST_MODEL_FILE_BYTES = 32 * 2**20
SMALLEST_EXTENT_M = 1e-5
# Points of a fibre that lie nearer to each other than this share of the mesh are the same but for rounding.
_SAME_POINT_SHARE = 1e-9


class ByPointData(Table):
    """Nodes where a point array of the mesh has a value."""

    point_data: str
    value: float


def _node_set(value: object) -> object:
    if isinstance(value, list) and all(type(node) is int for node in value):
        return value
    if isinstance(value, dict) and value.keys() == ByPointData.model_fields.keys():
        return ByPointData.model_validate(value, strict=True)
    raise ValueError('must be a list of node numbers or { point_data = "...", value = ... }')


NodeSet = Annotated[list[int] | ByPointData, BeforeValidator(_node_set)]


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
    """One muscle of a model file."""

    name: Name
    title: Title = ""
    max_force_N: float = Field(default=0.0, ge=0.0)
    origin_width_mm: float | None = Field(
        default=None, gt=0.0, description="width of its active stress at the origin, where fibres converge; 3 mm if left out"
    )
    fibre: list[FibreTable] = Field(min_length=1)


class MeshFile(Table):
    """The schema of a model file: the mesh, and what is what in it."""

    title: Title = ""
    source: str = ""
    mesh: str = Field(description="mesh file, relative to this file")
    length_unit: Literal["m", "cm", "mm"]
    first_number: Literal[0, 1] = Field(default=0, description="number of the first node in this file's lists")
    node_sets: dict[str, NodeSet] = Field(default={})
    fixed: list[str] = Field(default=[], description="node sets that are fixed")
    named_points: dict[str, int] = Field(default={})
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
    points, hexes, point_data = read_mesh(mesh_path)
    check_size(len(hexes), f"{mesh_path}: the mesh", "mesh it coarser")
    unit = _METRES_PER_UNIT[table.length_unit]
    _check_extent(points * unit, mesh_path, table.length_unit)
    try:
        bare = HexMesh(points * unit, hexes)
    except InputError as error:
        raise InputError(f"{mesh_path}: {str(error).removeprefix('HexMesh: ')}") from None
    check(bare, str(mesh_path))

    def nodes(numbers: list[int], what: str) -> np.ndarray:
        places = np.asarray(numbers, dtype=np.int64) - table.first_number
        wrong = places[(places < 0) | (places >= len(points))]
        if len(wrong):
            number = wrong[0] + table.first_number
            raise InputError(f"{path}: node {number} in {what} does not exist; the mesh has {len(points)} nodes.")
        return places

    sets = {
        name: _by_point_data(point_data, entry, f"{path}: node_sets.{name}")
        if isinstance(entry, ByPointData)
        else nodes(entry, f"node_sets.{name}")
        for name, entry in table.node_sets.items()
    }
    for name in table.fixed:
        if name not in sets:
            raise InputError(f'{path}: fixed names no node set "{name}"; {nearest(name, sets)}')
    named = {name: int(nodes([number], f"named_points.{name}")[0]) for name, number in table.named_points.items()}
    mesh = HexMesh(bare.points, bare.hexes, node_sets=sets).with_named_nodes(named)

    muscles = {}
    for muscle in table.muscle:
        fibres = []
        for number, fibre in enumerate(muscle.fibre):
            what = f"fibre {number + 1} of muscle {muscle.name}"
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
    return Anatomy(name=path.stem, mesh=mesh, muscles=muscles, fixed=tuple(table.fixed))


def _by_point_data(point_data: dict[str, np.ndarray], entry: ByPointData, where: str) -> np.ndarray:
    if entry.point_data not in point_data:
        name = shortened(entry.point_data)
        raise InputError(
            f'{where}: the mesh has no point array "{name}" with one number per node; {nearest(entry.point_data, point_data)}'
        )
    nodes = np.flatnonzero(point_data[entry.point_data] == entry.value)
    if not len(nodes):
        raise InputError(f"{where}: no node has {entry.point_data} = {entry.value:g}.")
    return nodes


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
