"""A result at one time, for programs that know meshes: the hexes with all fields, or the deformed surface."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.platform.errors import InputError
from explicitfe.results.files.reader import Result

MILLIMETRES_PER_METRE = 1e3


def vtu_bytes(result: Result, time_s: float | None) -> bytes:
    """An unstructured grid of VTK: hexes where they are at rest, m, with all fields at a time, displacement among them.

    The stored time nearest to ``time_s`` is taken, the last one if that is None; so in :func:`stl_bytes`.
    """
    import meshio

    data: dict[str, dict[str, np.ndarray]] = {"point": {}, "cell": {}}
    for name, (kind, _) in result.fields.items():
        data[kind][name] = result.field(name, time_s=time_s)
    mesh = meshio.Mesh(
        result.mesh.points,
        [("hexahedron", result.mesh.hexes)],
        point_data=data["point"],
        cell_data={name: [values] for name, values in data["cell"].items()},
    )
    return _written(partial(meshio.vtu.write, mesh=mesh))


def stl_bytes(result: Result, time_s: float | None) -> bytes:
    """The surface where it is at a time, as binary STL in mm; a face is four triangles around its middle.

    Raises
    ------
    InputError : displacements are not finite there.
    """
    import meshio

    displacement = result.displacement(time_s=time_s)
    if not np.isfinite(displacement).all():
        raise InputError(f"{result.path}: displacements are not finite at that time; give an earlier time.")
    corners, _ = surface_triangles(result.mesh, result.mesh.points + displacement)
    points = MILLIMETRES_PER_METRE * corners.reshape(-1, 3)
    mesh = meshio.Mesh(points, [("triangle", np.arange(len(points)).reshape(-1, 3))])
    return _written(partial(meshio.stl.write, mesh=mesh, binary=True))


def _written(write: Callable[[Path], None]) -> bytes:
    """What a function writes that takes the name of a file only."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "content"
        write(file)
        return file.read_bytes()
