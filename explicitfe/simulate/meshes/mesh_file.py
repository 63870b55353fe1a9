"""Reading of mesh files: Abaqus, FEBio and Gmsh by readers of this package, VTK's by VTK, all other formats by meshio."""

from __future__ import annotations

import builtins
import contextlib
import io
import itertools
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.child import read_in_child
from explicitfe.platform.host.extras import has_extra
from explicitfe.platform.host.regular import size_of
from explicitfe.simulate.meshes.abaqus import read_abaqus
from explicitfe.simulate.meshes.content import DAMAGED, SOLIDS, FileMesh, check_kinds, corners_and_middles, set_name
from explicitfe.simulate.meshes.febio import read_febio
from explicitfe.simulate.meshes.gmsh import is_gmsh, read_gmsh
from explicitfe.simulate.meshes.nastran import read_nastran
from explicitfe.simulate.meshes.vtk import VTK_SUFFIXES, read_vtk

LARGEST_MESH_FILE_BYTES = 4 * 2**30  # ten million elements as text
# A reader that asks so often for more where nothing follows would ask for ever.
MOST_READS_AT_THE_END = 1000
_READERS: dict[str, Callable[[str], FileMesh]] = {".inp": read_abaqus, ".feb": read_febio}
_READERS |= dict.fromkeys((".bdf", ".nas", ".fem"), read_nastran)
_SURFACES = (".stl", ".obj", ".ply", ".vtp")
_BY_MESHIO = (
    ".avs", ".cgns", ".dat", ".dato", ".e", ".ele", ".ex2", ".exo", ".f3grid", ".h5m", ".hmf", ".mdpa", ".med",
    ".mesh", ".meshb", ".node", ".post", ".su2", ".tec", ".ugrid", ".vol", ".dato.gz", ".post.gz", ".vol.gz", ".xdmf",
    ".xmf", ".xml",
)  # fmt: skip
MESH_SUFFIXES = (*_READERS, ".msh", *VTK_SUFFIXES, *_BY_MESHIO)


def read_mesh(path: Path) -> FileMesh:
    """The nodes, solid elements and named sets of a file, in its unit of length.

    Whether the elements can be computed is for ``midpoints.py`` and ``fem/mesh/quality.py``.

    Raises
    ------
    InputError : no such file, another kind of file, a damaged one, or no solid elements.
    """
    size_of(path, "give a mesh file", largest_bytes=LARGEST_MESH_FILE_BYTES)
    return FileMesh.of_arrays(read_in_child(mesh_arrays, path, f"this mesh cannot be read: {DAMAGED}."))


# ---- in a process of its own: some readers of the forty formats never end ----


def _open_with_an_end(*args: Any, **options: Any) -> IO[Any]:
    """A file that does not let itself be read for ever behind its end."""
    stream = io.open(*args, **options)  # noqa: UP020, SIM115
    ends = itertools.count()

    def counted(read: Callable[..., Any]) -> Callable[..., Any]:
        def call(*size: int) -> Any:
            data = read(*size)
            if not data and next(ends) >= MOST_READS_AT_THE_END:
                raise EOFError("the file ends too early")
            return data

        return call

    stream.read, stream.readline = counted(stream.read), counted(stream.readline)
    return stream


def mesh_arrays(path: str) -> dict[str, np.ndarray]:
    """What ``read_mesh`` gives, as arrays by name; it changes ``open`` for all, so a process of its own is meant to call it."""
    suffix = Path(path).suffix.lower()
    if suffix in _SURFACES:
        raise InputError(
            f"a {suffix[1:].upper()} file holds a surface without a volume; mesh it by "
            f"`explicitfe new model --mesh {Path(path).name} --size MM`."
        )
    if not path.lower().endswith(MESH_SUFFIXES):
        what = (
            f'the suffix "{shortened(suffix)}" is of no mesh format that is read'
            if suffix
            else "its name has no suffix of a mesh format"
        )
        raise InputError(f"{what}; save the mesh in one that is: {', '.join(MESH_SUFFIXES)}.")
    read = read_gmsh if suffix == ".msh" and is_gmsh(path) else _READERS.get(suffix, _read_others)
    mesh = read(path)
    if not len(mesh.points):
        raise InputError("the mesh has no points.")
    if mesh.cells.max() >= len(mesh.points):
        raise InputError(f"an element names node {mesh.cells.max()}, and the file has {len(mesh.points)} nodes: {DAMAGED}.")
    mesh.add_flags()
    return mesh.arrays()


def _by_meshio(path: str) -> Any:
    import meshio  # slow to import, and only needed for a mesh of one's own

    builtins.open = _open_with_an_end  # type: ignore[assignment]
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            mesh = meshio.read(path)
    except MemoryError:
        raise InputError(f"meshio cannot read this mesh: it requested more memory than such a file needs; {DAMAGED}.") from None
    except ImportError as error:
        raise InputError(f"meshio cannot read this mesh without {error.name}; install it, or convert the mesh to .vtu.") from None
    except (Exception, SystemExit) as error:  # meshio raises what its formats raise, and where none of several fits it prints
        words = " ".join((printed.getvalue() if isinstance(error, SystemExit) else str(error)).split()).rstrip(".")
        words = f" ({shortened(words)})" if " " in words else ""  # a single word is a key of its own
        why = "it is damaged, of another format than its suffix says, or in a form that meshio does not read; save it as .vtu"
        raise InputError(f"meshio cannot read this mesh{words}: {why}.") from None
    if re.search("skipping|cannot handle|could not", printed.getvalue(), re.IGNORECASE):
        words = shortened(" ".join(printed.getvalue().split()).rstrip("."))
        raise InputError(f"meshio reads this mesh in part only ({words}); save it in another format, such as .vtu.")
    return mesh


def _read_others(path: str) -> FileMesh:
    suffix = Path(path).suffix.lower()
    whole = suffix == ".vtu" and not has_extra("view") and Path(path).read_bytes().count(b"<Piece") == 1
    mesh = read_vtk(path) if suffix in VTK_SUFFIXES and not whole else _by_meshio(path)
    _name_families(mesh)
    points = _points_of(mesh.points)
    kinds = dict.fromkeys(block.type for block in mesh.cells)
    check_kinds({kind: sum(len(block.data) for block in mesh.cells if block.type == kind) for kind in kinds})
    solid = [block.type in SOLIDS and len(block.data) > 0 for block in mesh.cells]
    blocks = [_nodes_of(block, points) for block, has_volume in zip(mesh.cells, solid, strict=True) if has_volume]
    cells, middles = (np.concatenate(of) for of in zip(*blocks, strict=True))
    content = FileMesh(points, cells, middles, point_data=_point_data_of(mesh.point_data, len(points)))
    for name, arrays in mesh.cell_data.items():
        values = [_numbers(array) for array, has_volume in zip(arrays, solid, strict=True) if has_volume]
        flat = [array for array in values if array is not None and array.ndim == 1]
        if len(flat) == len(values):
            content.cell_data[name] = np.concatenate(flat)
    _name_sets(content, mesh, solid)
    return content


def _name_families(mesh: Any) -> None:
    """Make sets of the groups of a MED file, which meshio keeps as names by the tags of nodes and cells."""
    for tags, data, sets in (("point_tags", mesh.point_data, mesh.point_sets), ("cell_tags", mesh.cell_data, mesh.cell_sets)):
        families = getattr(mesh, tags, {})
        for name in dict.fromkeys(name for names in families.values() for name in names if tags in data):
            chosen = [tag for tag, names in families.items() if name in names]
            blocks = data[tags] if tags == "cell_tags" else [data[tags]]
            members = [np.flatnonzero(np.isin(block, chosen)) for block in blocks]
            sets[name] = members if tags == "cell_tags" else members[0]


def _name_sets(content: FileMesh, mesh: Any, solid: list[bool]) -> None:
    """Name the sets of nodes and cells that meshio found."""
    content.node_sets |= {set_name(name): np.unique(nodes).astype(np.int64) for name, nodes in mesh.point_sets.items()}
    first = np.cumsum([0, *(len(block.data) * has_volume for block, has_volume in zip(mesh.cells, solid, strict=True))])
    for name, members in mesh.cell_sets.items():
        if name.startswith("gmsh:") or len(members) != len(mesh.cells):
            continue
        chosen = [(k, np.asarray(of, dtype=np.int64)) for k, of in enumerate(members) if of is not None and len(of)]
        nodes = [np.unique(mesh.cells[k].data[of]) for k, of in chosen]
        elements = [first[k] + of for k, of in chosen if solid[k]]
        if nodes:
            content.node_sets.setdefault(set_name(name), np.unique(np.concatenate(nodes)).astype(np.int64))
        if elements:
            content.element_sets[set_name(name)] = np.concatenate(elements)


def _nodes_of(block: Any, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (k, 8) of solid cells, and the nodes between them."""
    nodes = _numbers(block.data)
    count = int(re.sub(r"\D", "", block.type) or SOLIDS[block.type])
    if nodes is None or nodes.ndim != 2 or nodes.shape[1] != count or nodes.dtype.kind not in "iu":
        raise InputError(f"the mesh contains {block.type} cells without {count} nodes each; export the file again.")
    return corners_and_middles(block.type, nodes.astype(np.int64), points)


def _points_of(values: object) -> np.ndarray:
    points = _numbers(values)
    if points is None or points.ndim != 2 or not len(points):
        raise InputError("the mesh has no points.")
    if points.shape[1] != 3:
        raise InputError(f"the mesh has {points.shape[1]} coordinates per node; it must have 3.")
    return points.astype(float)


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
