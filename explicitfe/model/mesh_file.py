"""A mesh file of any format that meshio knows, read in a process of its own.

Readers of some forty formats trust what a file says: on a damaged one some never end, some ask for more memory than there is, and
libraries below them crash. So this module runs itself in a child that may take some time and some memory, and no more, and hands
over arrays or a sentence.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.errors import InputError, nearest, shortened
from explicitfe.host.regular import size_of

LARGEST_MESH_FILE_BYTES = 4 * 2**30  # ten million elements as text
# The slowest readers of sound files take a third of this per MB, and the start of a process a second.
SECONDS_TO_BEGIN, SECONDS_PER_MB = 15.0, 3.0
# Some readers hold forty times what stands in the file.
MEMORY_TO_BEGIN_BYTES, MEMORY_PER_FILE_BYTE = 4 * 2**30, 60
_SOLID_CELLS = ("tetra", "pyramid", "wedge", "hexahedron")
_DAMAGED = "it is damaged, or not what the ending of its name says"


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Points (n, 3) in the unit of the file, hexes (m, 8), and the arrays (n,) of numbers that have a value at each point.

    Whether the hexes can be computed is for ``mesh/quality.py``.

    Raises
    ------
    InputError : no such file, another kind of file, a damaged one, or no mesh of hexes.
    """
    size = size_of(path, "give a mesh file", largest_bytes=LARGEST_MESH_FILE_BYTES)
    limit_s = SECONDS_TO_BEGIN + SECONDS_PER_MB * size / 1e6
    # The package is found as it is found here, whatever the folder is called from which the command runs.
    code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import answer; answer(sys.argv[1])"
    command = [sys.executable, "-c", code, str(path)]
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        child = subprocess.run(
            command, capture_output=True, timeout=limit_s, stdin=subprocess.DEVNULL, env=one_thread, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: the mesh was not read within {limit_s:.0f} s: {_DAMAGED}.") from None
    head, _, arrays = child.stdout.partition(b"\n")
    try:
        document = json.loads(head)
    except ValueError:  # the child ended before it could say why
        raise InputError(f"{path}: meshio cannot read this mesh: {_DAMAGED}.") from None
    if "fault" in document:
        raise InputError(f"{path}: {document['fault']}")
    stream = io.BytesIO(arrays)
    points, hexes, *values = [np.load(stream, allow_pickle=False) for _ in range(2 + len(document["point_data"]))]
    return points, hexes, dict(zip(document["point_data"], values, strict=True))


# ---- in the child ----


def answer(path: str) -> None:
    """Read a mesh and write it to stdout: a line of JSON, then arrays; or a line that says what is wrong."""
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    _limit_memory(MEMORY_TO_BEGIN_BYTES + MEMORY_PER_FILE_BYTE * Path(path).stat().st_size)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):  # meshio prints its warnings
            points, hexes, point_data = _hex_mesh(path)
    except InputError as error:
        out.write(json.dumps({"fault": str(error)}).encode() + b"\n")
    else:
        out.write(json.dumps({"point_data": list(point_data)}).encode() + b"\n")
        for array in (points, hexes, *point_data.values()):
            packed = io.BytesIO()  # straight into a pipe numpy cannot write
            np.save(packed, array, allow_pickle=False)
            out.write(packed.getbuffer())
    out.flush()


def _limit_memory(most_bytes: int) -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):  # no such limits on Windows
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))


def _hex_mesh(path: str) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    import meshio  # slow to import, and only needed for a mesh of one's own

    endings = meshio.extension_to_filetypes
    if not any(path.lower().endswith(ending) for ending in endings):
        ending = Path(path).suffix
        hint = nearest(ending, endings) if ending else "give it the ending of its format, such as .vtu or .msh."
        raise InputError(f'meshio cannot read this mesh: it knows no format "{shortened(ending)}"; {hint}')
    try:
        mesh = meshio.read(path)
    except MemoryError:
        raise InputError(f"meshio cannot read this mesh: it asks for more memory than such a file needs; {_DAMAGED}.") from None
    except (Exception, SystemExit) as error:  # meshio raises what its formats raise, and leaves where none of several fits
        words = shortened(" ".join(str(error).split())) if isinstance(error, meshio.ReadError) else ""
        raise InputError(f"meshio cannot read this mesh: {words or _DAMAGED}.") from None
    return _points_of(mesh.points), _hexes_of(mesh.cells), _point_data_of(mesh.point_data, len(mesh.points))


def _points_of(values: object) -> np.ndarray:
    points = _numbers(values)
    if points is None or points.ndim != 2 or not len(points):
        raise InputError("the mesh has no points.")
    if points.shape[1] != 3:
        raise InputError(f"the mesh has {points.shape[1]} coordinates a node; it must have 3.")
    return points.astype(float)


def _hexes_of(blocks: Sequence[Any]) -> np.ndarray:
    solids: dict[str, int] = {}
    hexes = []
    for block in blocks:
        if block.type.startswith(_SOLID_CELLS):
            solids[block.type] = solids.get(block.type, 0) + len(block.data)
        if block.type == "hexahedron":
            nodes = _numbers(block.data)
            if nodes is None or nodes.ndim != 2 or nodes.shape[1] != 8 or nodes.dtype.kind not in "iu":
                raise InputError("the mesh holds hexahedra that do not name eight nodes each; write the file anew.")
            hexes.append(nodes.astype(np.int64))
    other = {kind: count for kind, count in solids.items() if kind != "hexahedron" and count}
    if other:
        listed = ", ".join(f"{count} {kind}" for kind, count in other.items())
        raise InputError(f"the mesh holds {listed} cells; only 8-node hexahedra can be computed, so mesh it with hexes.")
    if not sum(map(len, hexes)):
        raise InputError("the mesh holds no hexahedra.")
    return np.concatenate(hexes)


def _point_data_of(arrays: dict[str, object], count: int) -> dict[str, np.ndarray]:
    """Those with one number for each point; others cannot choose nodes."""
    numbers = {name: _numbers(values) for name, values in arrays.items()}
    return {name: values.reshape(count) for name, values in numbers.items() if values is not None and values.size == count}


def _numbers(values: object) -> np.ndarray | None:
    try:
        array = np.asarray(values)
    except ValueError:  # rows of different lengths
        return None
    return array if array.dtype.kind in "iuf" else None
