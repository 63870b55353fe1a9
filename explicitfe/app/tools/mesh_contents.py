"""Contents of a mesh file: its size, the quality of its elements, and the sets that a model file can name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from explicitfe.fem.mesh.quality import check, scaled_jacobians, volumes
from explicitfe.platform.errors import InputError
from explicitfe.results.documents.mesh_contents import MeshArray, MeshContents
from explicitfe.simulate.meshes.content import nodes_of_cells
from explicitfe.simulate.meshes.mesh_file import read_mesh
from explicitfe.simulate.meshes.midpoints import hexahedra, without_loose_nodes

MOST_VALUES = 20  # of an array that are listed one by one


def mesh_contents(path: Path) -> MeshContents:
    """What a mesh file holds.

    Raises
    ------
    InputError : the file cannot be read, or has no solid elements.
    """
    content = read_mesh(path)
    try:
        body = hexahedra(content.points, content.cells, content.middles)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    points = content.points[np.unique([*nodes_of_cells(content.cells), *content.middles[:, 2]]).astype(np.int64)]
    fault = ""
    try:  # in a unit of length in which the mesh is not too large
        check(without_loose_nodes(replace(body, points=body.points / max(1.0, np.abs(points).max())))[1], "the mesh")
    except InputError as error:
        fault = str(error).removeprefix("HexMesh: ")
        if not np.isfinite(points).all():
            raise InputError(f"{path}: {fault}") from None
    size = (content.cells >= 0).sum(axis=1)
    names = {8: "hexahedra", 6: "wedges", 4: "tetrahedra"}
    return MeshContents(
        mesh=str(path),
        nodes=len(points),
        cells={name: int((size == count).sum()) for count, name in names.items() if (size == count).any()},
        hexahedra=len(body.hexes),
        lowest=points.min(axis=0).tolist(),
        highest=points.max(axis=0).tolist(),
        volume=float(volumes(body.points, body.hexes).sum()),
        smallest_scaled_jacobian=float(scaled_jacobians(body.points, body.hexes).min()),
        fault=fault,
        node_sets={name: len(nodes) for name, nodes in content.node_sets.items()},
        element_sets={name: len(cells) for name, cells in content.element_sets.items()},
        arrays=[
            _array(name, values, of)
            for of, table in (("node", content.point_data), ("element", content.cell_data))
            for name, values in table.items()
        ],
    )


def _array(name: str, values: np.ndarray, of: str) -> MeshArray:
    distinct, counts = np.unique(values, return_counts=True)
    few = (
        {f"{value:g}": int(count) for value, count in zip(distinct, counts, strict=True)} if len(distinct) <= MOST_VALUES else {}
    )
    return MeshArray(name=name, of=of, lowest=float(distinct[0]), highest=float(distinct[-1]), counts=few)
