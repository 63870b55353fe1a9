"""A model file and a scenario for a mesh file, or for a closed surface that is meshed with hexahedra."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from explicitfe.app.tools.mesh_contents import mesh_contents
from explicitfe.fem.bones.read import read_surface
from explicitfe.fem.bones.surface import TriangleSurface, check_surface
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.fem.mesh.quality import check
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.files import reason
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.results.documents.mesh_contents import MeshContents
from explicitfe.simulate.meshes.fitted_grid import mesh_surface

SURFACE_SUFFIXES = (".stl", ".obj", ".ply", ".vtp")
_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_MODEL = """\
title = {title}
mesh = {mesh}
length_unit = "{unit}"
fixed = {fixed}
# Node sets: {node_sets}
# Element sets: {element_sets}

# [[muscle]]                       # explicitfe run works with muscles too: see the page on model files
# name = "M"
# elements = "name of an element set"
# direction = [0.0, 0.0, 1.0]      # or origin and insertion, two node sets
"""
_SCENARIO = """\
title = {title}

[model]
file = {model}
material = "buchaillard-2009"      # explicitfe list materials
damping = {{ alpha_per_s = 40.0 }}
gravity_m_s2 = [0.0, 0.0, -9.81]

[analysis]
duration_ms = 50.0
"""


class NewModel(TypedDict):
    """The files that were written, and the mesh; ``volume_ratio``: its volume over that of the surface, None for a mesh file."""

    model: str
    scenario: str
    contents: MeshContents
    volume_ratio: float | None


def write_new_model(mesh_path: Path, out: Path, *, size_mm: float | None = None, unit: str = "mm") -> NewModel:
    """Write a model file and a scenario that can be run at once; for a surface, also the mesh of hexahedra in it.

    Parameters
    ----------
    mesh_path : mesh file, or closed surface.
    out : folder of the new files, which must not exist.
    size_mm : edge of the elements in a surface.
    unit : of the lengths in the file.

    Raises
    ------
    InputError : the file cannot be read or meshed, or a new file exists.
    """
    if unit not in _METRES:
        raise InputError(f'--unit "{unit}" is not possible; {nearest(unit, _METRES)}')
    is_surface = mesh_path.suffix.lower() in SURFACE_SUFFIXES
    if is_surface and not (size_mm is not None and 0.0 < size_mm < np.inf):
        raise InputError("--size is missing: the edge of the elements in mm, such as --size 4.")
    if not is_surface and size_mm is not None and mesh_contents(mesh_path):
        raise InputError(f"{mesh_path}: --size is for a surface ({', '.join(SURFACE_SUFFIXES)}); this mesh has elements already.")
    model, scenario, meshed = (out / f"{mesh_path.stem}{ending}" for ending in (".toml", "-run.toml", ".vtu"))
    for path in (model, scenario, *([meshed] if is_surface else [])):
        if os.path.lexists(path):
            raise InputError(f"{path}: this exists already; move it, or give another folder with --out.")
    ratio = None
    if is_surface and size_mm is not None:
        surface = read_surface(mesh_path, unit)
        if surface.volume_m3 < 0.0:
            surface = TriangleSurface(surface.points, surface.triangles[:, ::-1])
        check_surface(surface, str(mesh_path))
        try:
            mesh = mesh_surface(surface, 1e-3 * size_mm)
        except InputError as error:
            raise InputError(f"{mesh_path}: {error}") from None
        check(mesh, str(mesh_path))
    try:
        out.mkdir(parents=True, exist_ok=True)
        if is_surface:
            _write_mesh(meshed, mesh, unit)
            mesh_path = meshed
        contents = mesh_contents(mesh_path)
        if is_surface:
            ratio = contents["volume"] * _METRES[unit] ** 3 / surface.volume_m3
        named = {kind: ", ".join(contents[kind]) or "none" for kind in ("node_sets", "element_sets")}
        title, place = toml_value(mesh_path.stem), toml_value(os.path.relpath(mesh_path, out))
        fixed = '["z0"]' if is_surface else "[]                        # names of node sets"
        model.write_text(_MODEL.format(title=title, mesh=place, unit=unit, fixed=fixed, **named), encoding="utf-8")
        scenario.write_text(_SCENARIO.format(title=title, model=toml_value(model.name)), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: the files cannot be written ({reason(error)}).") from None
    return {"model": str(model), "scenario": str(scenario), "contents": contents, "volume_ratio": ratio}


def _write_mesh(path: Path, mesh: HexMesh, unit: str) -> None:
    """Write hexahedra as VTU with node sets: ``surface``, and ``x0`` to ``z1`` within an element of either end of an axis."""
    import meshio

    element, face = free_faces(mesh.hexes)
    quads = mesh.hexes[element[:, None], FACES[face]]
    surface = np.zeros(mesh.node_count, dtype=np.int32)
    surface[quads] = 1
    x = mesh.points
    width = float(np.median(np.linalg.norm(x[quads[:, 0]] - x[quads[:, 1]], axis=1)))
    flags = {"surface": surface}
    for axis, letter in enumerate("xyz"):
        low, high = x[:, axis].min(), x[:, axis].max()
        flags[f"{letter}0"] = surface * (x[:, axis] <= low + width)
        flags[f"{letter}1"] = surface * (x[:, axis] >= high - width)
    meshio.write(path, meshio.Mesh(x / _METRES[unit], [("hexahedron", mesh.hexes)], point_data=flags))
