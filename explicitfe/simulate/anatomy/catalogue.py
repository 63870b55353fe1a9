"""The built-in models and materials, read from data folders.

Laws and result files are imported where they are needed: whoever asks for the names of models waits for no compiler.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.bones.tables import BoneShape, channel, read_bones
from explicitfe.fem.mesh.bent_block import ContourMap
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.muscle_lines import Fibre, Muscle, read_muscles
from explicitfe.fem.mesh.quality import check
from explicitfe.fem.mesh.size import check_size
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.shipped import folder_of
from explicitfe.platform.host.stored import store_answers
from explicitfe.simulate.anatomy.anatomy import Anatomy

if TYPE_CHECKING:
    from explicitfe.fem.materials import Law
    from explicitfe.results.files.airway_table import AirwayTable

_Shared = TypeVar("_Shared")

# So many meshes are kept for the next run of this process: one, and a finer one to compare with.
_KEPT_MESHES = 2


def model_folders() -> dict[str, Path]:
    """Built-in models: name -> folder."""
    return {path.parent.name: path.parent for path in sorted(folder_of("models").glob("*/geometry.toml"))}


@cache
def materials() -> dict[str, Law]:
    """Named materials of all built-in models.

    Raises
    ------
    InputError : two models give the same name.
    """
    from explicitfe.fem.materials import LAWS

    laws: dict[str, Law] = {}
    places: dict[str, Path] = {}
    for path in sorted(folder_of("models").glob("*/materials.toml")):
        for name, table in tomllib.loads(path.read_text(encoding="utf-8")).items():
            if name in laws:
                raise InputError(f'{path}: {places[name]} also has a material "{name}"; rename one of them.')
            places[name] = path
            laws[name] = LAWS[table.get("law", "yeoh")][0].model_validate(table)
    return laws


def material(choice: str | Law) -> Law:
    """The material that a scenario names or spells out.

    Raises
    ------
    InputError : no material has that name.
    """
    if not isinstance(choice, str):
        return choice
    if choice not in materials():
        raise InputError(f'unknown material "{choice}"; {nearest(choice, materials())}')
    return materials()[choice]


@cache
def contour(name: str) -> ContourMap:
    """The contour map of a built-in model; the arrays are shared, so read-only."""
    folders = model_folders()
    if name not in folders:
        raise InputError(f'unknown model "{name}"; {nearest(name, folders)}')
    return _locked(ContourMap.from_toml(folders[name] / "geometry.toml"))


@cache
def bones(name: str) -> dict[str, BoneShape]:
    """The surfaces around a built-in model by name: its bones, and the walls of its airway; the arrays are read-only."""
    path, around = _file(name, "bones.toml"), airway(name)
    return _bones(path, _text(path), "" if around is None else around.wall.model_dump_json())


@store_answers(BoneShape, TriangleSurface, sources=("fem/bones",))
def _bones(path: Path | None, text: str, wall: str) -> dict[str, BoneShape]:
    """The bones of a file with this text, and the wall of a pharynx as JSON; "" for none."""
    shapes = {} if path is None else read_bones(path)
    if wall:
        table = json.loads(wall)
        shapes["pharynx"] = BoneShape("pharynx", table["title"], channel(table), hard=channel(table, sides=False))
    return shapes


@cache
def airway(name: str) -> AirwayTable | None:
    """The airway around a built-in model by name; None for a mesh of one's own, and where its folder has no airway.toml."""
    from explicitfe.results.files.airway_table import AirwayTable

    path = _file(name, "airway.toml") if name in model_folders() else None
    return None if path is None else AirwayTable.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))


def _file(name: str, file: str) -> Path | None:
    """A file of a built-in model, or of the one that it is based on; None if neither has it."""
    based_on = contour(name).based_on  # refuses an unknown model
    path = model_folders()[name] / file
    if path.is_file():
        return path
    return _file(based_on, file) if based_on else None


def _text(path: Path | None) -> str:
    return "" if path is None else path.read_text(encoding="utf-8")


def cells_of(name: str, resolution: str | None, cells: tuple[int, int, int] | None) -> tuple[int, int, int]:
    """Numbers of elements along s, t and w for a resolution's name, or those asked for."""
    if cells is not None:
        return cells
    resolutions = contour(name).resolutions
    resolution = resolution or "medium"
    if resolution not in resolutions:
        raise InputError(f'unknown resolution "{resolution}"; {nearest(resolution, resolutions)}')
    return resolutions[resolution]


def built_in(name: str, resolution: str | None = None, cells: tuple[int, int, int] | None = None) -> Anatomy:
    """A built-in model at a resolution ('medium' if neither it nor cells is given); the arrays are shared, so read-only."""
    grid = tuple(cells_of(name, resolution, cells))
    check_size(math.prod(grid), "model: this mesh", "use fewer cells or a coarser resolution")
    return _built_in(name, grid)


@lru_cache(maxsize=_KEPT_MESHES)
def _built_in(name: str, grid: tuple[int, int, int]) -> Anatomy:
    path = _file(name, "muscles.toml")
    return _anatomy(name, contour(name), grid, path, _text(path))


@store_answers(Anatomy, HexMesh, MaterialPoints, Muscle, Fibre, sources=("fem/mesh", "simulate/anatomy"))
def _anatomy(name: str, shape: ContourMap, grid: tuple[int, int, int], path: Path | None, text: str) -> Anatomy:
    """A model with the muscles of a file with this text."""
    muscles = {} if path is None else read_muscles(path, shape, grid)
    mesh = shape.mesh(grid)
    check(mesh, f"model {name}")
    return Anatomy(name=name, mesh=mesh, muscles=muscles, fixed=shape.fixed)


@lru_cache(maxsize=_KEPT_MESHES)
def attachment_points(name: str, cells: tuple[int, int, int], patch: str) -> tuple[MaterialPoints, np.ndarray]:
    """Points and areas of an attachment of a built-in model; see :meth:`ContourMap.attachment_points`. Read-only."""
    return _attachment_points(contour(name), cells, patch)


@store_answers(MaterialPoints, sources=("fem/mesh",))
def _attachment_points(shape: ContourMap, cells: tuple[int, int, int], patch: str) -> tuple[MaterialPoints, np.ndarray]:
    return shape.attachment_points(cells, patch)


def _locked(shared: _Shared) -> _Shared:
    """The same, all arrays in it read-only: what one run of a process wrote into it another would compute with."""
    waiting: list[object] = [shared]
    seen: set[int] = set()
    while waiting:
        value = waiting.pop()
        if id(value) in seen:
            continue
        seen.add(id(value))
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        elif isinstance(value, Mapping):
            waiting.extend(value.values())
        elif isinstance(value, tuple | list):
            waiting.extend(value)
        elif is_dataclass(value):
            waiting.extend(getattr(value, of.name) for of in fields(value))
    return shared
