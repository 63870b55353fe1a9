"""VTK's files, read by VTK itself: all versions and compressions, several pieces, structured grids and images."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.extras import require
from explicitfe.simulate.meshes.content import DAMAGED

VTK_SUFFIXES = (".vtu", ".vtk", ".pvtu", ".vti", ".vts", ".vtr")


def read_vtk(path: str) -> Any:
    """The mesh of a file as one of meshio; coincident nodes of its pieces become one, and ghost cells are left out.

    Raises
    ------
    InputError : pyvista is not installed, VTK reports an error, or there are cells that meshio does not know.
    """
    require("view", "reading a VTK file")
    import pyvista
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

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
    for data in (grid.point_data, grid.cell_data):
        data.pop("vtkGhostType", None)
    try:
        mesh = pyvista.to_meshio(grid)
    except KeyError as error:
        raise InputError(f"the mesh contains cells of VTK's type {error}, which are not supported; remove them.") from None
    # pyvista changes the names.
    mesh.point_data = dict(zip(grid.point_data.keys(), mesh.point_data.values(), strict=True))
    mesh.cell_data = dict(zip(grid.cell_data.keys(), mesh.cell_data.values(), strict=True))
    return mesh
