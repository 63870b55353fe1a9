"""Reading of mesh files in any format that meshio supports."""

from __future__ import annotations

import builtins
import contextlib
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.child import read_in_child
from explicitfe.platform.host.regular import size_of

LARGEST_MESH_FILE_BYTES = 4 * 2**30  # ten million elements as text
# A reader that asks so often for more where nothing follows would ask for ever.
MOST_READS_AT_THE_END = 1000
_AT_POINTS = "at points: "
_SOLID_CELLS = ("tetra", "pyramid", "wedge", "hexahedron")
_DAMAGED = "it is damaged, or its format does not match its suffix"


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Points (n, 3) in the unit of the file, hexes (m, 8), and the arrays (n,) of numbers that have a value at each point.

    Whether the hexes can be computed is for ``mesh/quality.py``.

    Raises
    ------
    InputError : no such file, another kind of file, a damaged one, or no mesh of hexes.
    """
    size_of(path, "give a mesh file", largest_bytes=LARGEST_MESH_FILE_BYTES)
    arrays = read_in_child(hex_mesh, path, f"meshio cannot read this mesh: {_DAMAGED}.")
    points, hexes = arrays.pop("points"), arrays.pop("hexes")
    return points, hexes, {name.removeprefix(_AT_POINTS): values for name, values in arrays.items()}


# ---- in a process of its own: some readers of the forty formats never end ----


class _Bytes(io.BufferedReader):
    """A binary file that does not let itself be read for ever behind its end."""

    reads_at_the_end = 0

    def readline(self, size: int | None = -1, /) -> bytes:
        return self._counted(super().readline(size))

    def read(self, size: int | None = -1, /) -> bytes:
        return self._counted(super().read(size))

    def _counted(self, data: bytes) -> bytes:
        self.reads_at_the_end += not data
        if self.reads_at_the_end > MOST_READS_AT_THE_END:
            raise EOFError("the file ends too early")
        return data


class _Text(io.TextIOWrapper):
    """The same of text."""

    reads_at_the_end = 0

    def readline(self, size: int = -1, /) -> str:  # type: ignore[override]
        line = super().readline(size)
        self.reads_at_the_end += not line
        if self.reads_at_the_end > MOST_READS_AT_THE_END:
            raise EOFError("the file ends too early")
        return line


def _open_with_an_end(file: Any, mode: str = "r", buffering: int = -1, *args: Any, **options: Any) -> IO[Any]:
    if mode not in ("r", "rb") or args:
        return io.open(file, mode, buffering, *args, **options)  # noqa: UP020
    stream = _Bytes(io.FileIO(file))
    return stream if mode == "rb" else _Text(stream, **options)


def hex_mesh(path: str) -> dict[str, np.ndarray]:
    """What ``read_mesh`` gives, as arrays by name; it changes ``open`` for all, so a process of its own is meant to call it."""
    import meshio  # slow to import, and only needed for a mesh of one's own

    builtins.open = _open_with_an_end  # type: ignore[assignment]

    endings = meshio.extension_to_filetypes
    if not any(path.lower().endswith(ending) for ending in endings):
        ending = Path(path).suffix
        hint = nearest(ending, endings) if ending else "rename it with the suffix of its format, such as .vtu or .msh."
        raise InputError(f'meshio cannot read this mesh: it supports no format "{shortened(ending)}"; {hint}')
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
            mesh = meshio.read(path)
    except MemoryError:
        raise InputError(f"meshio cannot read this mesh: it requested more memory than such a file needs; {_DAMAGED}.") from None
    except (Exception, SystemExit) as error:  # meshio raises what its formats raise, and where none of several fits it prints
        words = " ".join((printed.getvalue() if isinstance(error, SystemExit) else str(error)).split()).rstrip(".")
        words = f" ({shortened(words)})" if " " in words else ""  # a single word is a key of its own
        raise InputError(f"meshio cannot read this mesh{words}: {_DAMAGED}.") from None
    points = _points_of(mesh.points)
    at_points = {_AT_POINTS + name: values for name, values in _point_data_of(mesh.point_data, len(points)).items()}
    return {"points": points, "hexes": _hexes_of(mesh.cells), **at_points}


def _points_of(values: object) -> np.ndarray:
    points = _numbers(values)
    if points is None or points.ndim != 2 or not len(points):
        raise InputError("the mesh has no points.")
    if points.shape[1] != 3:
        raise InputError(f"the mesh has {points.shape[1]} coordinates per node; it must have 3.")
    return points.astype(float)


def _hexes_of(blocks: Sequence[Any]) -> np.ndarray:
    solids: dict[str, int] = {}
    hexes = []
    for block in blocks:
        if block.type.startswith(_SOLID_CELLS):
            solids[block.type] = solids.get(block.type, 0) + len(block.data)
        if block.type == "hexahedron" and len(block.data):
            nodes = _numbers(block.data)
            if nodes is None or nodes.ndim != 2 or nodes.shape[1] != 8 or nodes.dtype.kind not in "iu":
                raise InputError("the mesh contains hexahedra without eight nodes each; export the file again.")
            hexes.append(nodes.astype(np.int64))
    other = {kind: count for kind, count in solids.items() if kind != "hexahedron" and count}
    if other:
        listed = ", ".join(f"{count} {kind}" for kind, count in other.items())
        raise InputError(f"the mesh contains {listed} cells; only 8-node hexahedra are supported; mesh the body with them.")
    if not hexes:
        raise InputError("the mesh contains no hexahedra.")
    return np.concatenate(hexes)


def _point_data_of(arrays: Mapping[str, object], count: int) -> dict[str, np.ndarray]:
    """Those with one number for each point; others cannot choose nodes."""
    numbers = {name: _numbers(values) for name, values in arrays.items()}
    return {name: values.reshape(count) for name, values in numbers.items() if values is not None and values.size == count}


def _numbers(values: object) -> np.ndarray | None:
    try:
        array = np.asarray(values)
    except ValueError:  # rows of different lengths
        return None
    return array if array.dtype.kind in "iuf" else None
