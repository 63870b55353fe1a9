"""Reading of surface files: STL, OBJ, PLY or VTP."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.child import read_in_child
from explicitfe.platform.host.extras import require
from explicitfe.platform.host.regular import size_of

_METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FORMATS = (".stl", ".obj", ".ply", ".vtp")
# Corners nearer to each other than this share of the surface are one point: STL gives every triangle its own, often rounded.
_SAME_CORNER_SHARE = 1e-5
LARGEST_SURFACE_FILE_BYTES = 2**30  # ten million triangles


def read_surface(path: Path | str, length_unit: str) -> TriangleSurface:
    """The triangles of a file; polygons are cut into triangles, and corners in the same place become one point.

    Whether the surface is closed and of a sensible size is for ``check_surface``.

    Parameters
    ----------
    length_unit : "m", "cm" or "mm"; no such file says in what unit it is.

    Raises
    ------
    InputError : no such file, another kind of file, or one that holds no triangles.
    """
    path = Path(path)
    if path.suffix.lower() not in _FORMATS:
        raise InputError(f"{path}: is not in a supported surface format; use a file that ends in {', '.join(_FORMATS)}.")
    size_of(path, "give a surface", largest_bytes=LARGEST_SURFACE_FILE_BYTES)
    if length_unit not in _METRES_PER_UNIT:
        raise InputError(f'{path}: unknown length_unit "{length_unit}"; give one of {", ".join(_METRES_PER_UNIT)}.')
    require("view", f"{path}: reading a surface")
    kind = path.suffix[1:].upper()
    arrays = read_in_child(surface_arrays, path, f"cannot be read as {kind}: it is damaged, or a file of another format.")
    if not len(arrays["triangles"]):
        raise InputError(f"{path}: contains no triangles; check that it is a surface in the format {kind}?")
    return TriangleSurface(_METRES_PER_UNIT[length_unit] * arrays["points"], arrays["triangles"])


def surface_arrays(path: str) -> dict[str, np.ndarray]:
    """Points and triangles of a file. VTK crashes on some damaged files, so a process of its own is meant to call it."""
    import pyvista
    from vtkmodules.vtkCommonCore import vtkObject

    vtkObject.SetGlobalWarningDisplay(0)  # It prints errors and goes on; an empty surface tells as much.
    try:
        mesh = pyvista.read(path)
        mesh = mesh.extract_surface() if not isinstance(mesh, pyvista.PolyData) else mesh
        mesh = mesh.triangulate().clean(tolerance=_SAME_CORNER_SHARE, absolute=False)
    except Exception as error:  # pyvista raises many kinds for a file that is not what its name says
        words = shortened(" ".join(str(error).split()).rstrip("."))
        raise InputError(f"cannot be read as {Path(path).suffix[1:].upper()}: {words}.") from error
    return {"points": np.asarray(mesh.points, dtype=float), "triangles": mesh.faces.reshape(-1, 4)[:, 1:].astype(np.int64)}
