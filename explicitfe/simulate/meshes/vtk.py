"""VTK's files, read by VTK itself: all versions and compressions, several pieces, structured grids and images."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.extras import require
from explicitfe.simulate.meshes.content import DAMAGED, SOLIDS, FileMesh, check_kinds, corners_and_middles, nodes_each

VTK_SUFFIXES = (".vtu", ".vtk", ".pvtu", ".vti", ".vts", ".vtr")
# VTK's numbers of the cells with the nodes and the order of nodes of SOLIDS; 11 is a voxel.
_KINDS = {
    10: "tetra", 11: "hexahedron", 12: "hexahedron", 13: "wedge", 14: "pyramid", 24: "tetra10", 25: "hexahedron20",
    26: "wedge15", 27: "pyramid13", 29: "hexahedron27", 32: "wedge18", 33: "hexahedron24",
}  # fmt: skip
_VOXEL, _ORDER_OF_VOXEL = 11, [0, 1, 3, 2, 4, 5, 7, 6]


def read_vtk(path: str) -> FileMesh:
    """The mesh of a file with all its arrays; coincident nodes of its pieces become one, and ghost cells are left out.

    Raises
    ------
    InputError : pyvista is not installed, VTK reports an error, or the elements cannot be computed.
    """
    require("view", "reading a VTK file")
    import pyvista
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    window = vtkStringOutputWindow()  # VTK prints what is wrong, and goes on with a part of the file
    vtkOutputWindow.SetInstance(window)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            grid = pyvista.read(path)
        fault = str(window.GetOutput()) if grid.n_cells else "it has no elements"
    except Exception as error:  # pyvista raises many kinds
        fault = str(window.GetOutput()) or str(error)
    if fault:
        first = re.sub(r".*, line \d+\n|\w+ \(0x\w+\): |The VTK reader .*\n", "", fault.strip().split("\n\n")[0])
        words = shortened(" ".join(first.replace('"', "").split()).rstrip("."))
        raise InputError(f"VTK cannot read this mesh ({words}): {DAMAGED}.")
    grid = grid.cast_to_unstructured_grid()
    grid.RemoveGhostCells()
    if Path(path).read_bytes().count(b"<Piece") > 1:
        grid = grid.clean(tolerance=0.0, remove_unused_points=False, average_point_data=False)
    types = np.asarray(grid.celltypes)
    kinds = {code: _KINDS.get(code, pyvista.CellType(code).name.lower()) for code in map(int, np.unique(types))}
    for code in kinds.keys() - _KINDS.keys():
        cell = vtkGenericCell()
        cell.SetCellType(code)
        kinds[code] = f"solid {kinds[code]}" if cell.GetCellDimension() == 3 else kinds[code]
    check_kinds(Counter(kinds[code] for code in types.tolist()))
    points, parts = np.asarray(grid.points, dtype=float), grid.GetCells()
    first, nodes = (np.asarray(pyvista.convert_array(of)) for of in (parts.GetOffsetsArray(), parts.GetConnectivityArray()))
    solid = np.isin(types, [code for code, kind in kinds.items() if kind in SOLIDS])
    cells, middles, number = np.full((solid.sum(), 8), -1), [np.zeros((0, 3), dtype=np.int64)], np.cumsum(solid) - 1
    for code, kind in kinds.items():
        if kind in SOLIDS:
            of = np.flatnonzero(types == code)
            if (np.diff(first)[of] != nodes_each(kind)).any():
                raise InputError(f"the mesh contains {kind} cells without {nodes_each(kind)} nodes each; export the file again.")
            table = nodes[first[of, None] + np.arange(nodes_each(kind))].astype(np.int64)
            table = table[:, _ORDER_OF_VOXEL] if code == _VOXEL else table
            cells[number[of]], of_edges = corners_and_middles(kind, table, points)
            middles.append(of_edges)
    numbers = [
        {
            name: np.asarray(values)
            for name, values in data.items()
            if values.ndim == 1 and values.dtype.kind in "iuf" and name != "vtkGhostType"
        }
        for data in (grid.point_data, grid.cell_data)
    ]
    of_cells = {name: values[solid] for name, values in numbers[1].items()}
    return FileMesh(points, cells, np.concatenate(middles), point_data=numbers[0], cell_data=of_cells)
