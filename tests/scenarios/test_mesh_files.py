"""Mesh and surface files that are damaged, cut short, or something else: one sentence, soon, and never a crash of the program."""

from __future__ import annotations

import builtins
import os
import random
import time
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
from support import block_mesh

from explicitfe.fem.bones.read import read_surface
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import child
from explicitfe.simulate.anatomy.own_mesh import read_model_file
from explicitfe.simulate.meshes.mesh_file import mesh_arrays, read_mesh

LONGEST_ANSWER_S = 8.0  # far below the limit of the child: what is damaged is seen, not waited for
MESH = block_mesh((3, 2, 2), 0.01)
CELLS = [("hexahedron", MESH.hexes)]


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], dict[str, np.ndarray]]:
    """Reads a mesh file without a child, for speed; ``open`` is put back afterwards."""
    monkeypatch.setattr(builtins, "open", builtins.open)
    return lambda path: mesh_arrays(str(path))


def refusal(read: Callable[[Path], object], path: Path) -> str | None:
    """The sentence with which a file is refused; None where it is read."""
    begin = time.perf_counter()
    try:
        read(path)
        return None
    except InputError as error:
        sentence = str(error)
    finally:
        assert time.perf_counter() - begin < LONGEST_ANSWER_S
    assert "\n" not in sentence and len(sentence) < 500 and sentence[-1] in ".?", sentence
    return sentence


FORMATS = [("msh", "gmsh22"), ("msh", "gmsh"), ("msh", "ansys"), ("vtu", None), ("vtk", None), ("inp", None), ("tec", None)]


@pytest.mark.parametrize(("ending", "kind"), FORMATS, ids=lambda name: name or "")
@pytest.mark.parametrize("binary", [True, False])
def test_files_that_are_cut_or_changed(ending: str, kind: str | None, binary: bool, tmp_path: Path, in_this_process) -> None:
    """At any length and with any byte changed: a reader that waits for what follows is told that nothing does."""
    path = tmp_path / f"block.{ending}"
    options = {} if ending in ("inp", "tec") else {"binary": binary}
    meshio.write(path, meshio.Mesh(MESH.points, CELLS), file_format=kind, **options)
    raw, draw = path.read_bytes(), random.Random(1)
    assert refusal(in_this_process, path) is None
    for length in [0, 1, 2, 10, *(draw.randrange(len(raw)) for _ in range(8))]:
        path.write_bytes(raw[:length])
        refusal(in_this_process, path)
    for _ in range(8):
        changed = bytearray(raw)
        changed[draw.randrange(len(raw))] = draw.randrange(256)
        path.write_bytes(changed)
        refusal(in_this_process, path)


ONE = block_mesh((1, 1, 1), 0.01, distort=0.0)
NODES = "".join(f"{k + 1} {x} {y} {z}\n" for k, (x, y, z) in enumerate(ONE.points))
CORNERS = " ".join(str(node + 1) for node in ONE.hexes[0])


def gmsh(nodes: str = NODES, corners: str = CORNERS, node_count: int = 8, count: int = 1) -> str:
    """A mesh of one hex as text, version 2.2."""
    head = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{node_count}\n{nodes}$EndNodes\n"
    return f"{head}$Elements\n{count}\n" + (f"1 5 2 1 1 {corners}\n" if corners else "") + "$EndElements\n"


FILES = {
    "one hex": (gmsh(), None),
    "a node that does not exist": (gmsh(corners=CORNERS[:-1] + "99"), ""),
    "a huge count of nodes": (gmsh(node_count=8_000_000_000_000), ""),
    "a huge count of elements": (gmsh(count=9_000_000_000_000), ""),
    "a coordinate that is no number": (gmsh(NODES.replace("0.01", "nan")), "finite"),
    "a coordinate beyond all": (gmsh(NODES.replace("0.01", "1e300")), "100 m"),
    "a point of a body": (gmsh(NODES.replace("0.01", "1e-9")), "10 micrometres"),
    "no elements": (gmsh(corners="", count=0), ""),
    "text": ("once upon a time", "damaged"),
    "nothing": ("", "the file is empty"),
}


@pytest.mark.parametrize(("text", "words"), FILES.values(), ids=FILES)
def test_meshes_that_cannot_be(text: str, words: str | None, tmp_path: Path) -> None:
    (tmp_path / "one.msh").write_text(text)
    (tmp_path / "one.toml").write_text('mesh = "one.msh"\nlength_unit = "m"\n')
    sentence = refusal(read_model_file, tmp_path / "one.toml")
    assert sentence is None if words is None else (sentence and "one.msh" in sentence and words in sentence), sentence


def test_what_is_no_file_of_a_mesh(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.vtu")
    (tmp_path / "block.xyz").write_text("x")
    (tmp_path / "block").write_text("x")
    with (tmp_path / "sparse.vtu").open("wb") as file:
        file.truncate(10 * 2**30)
    pyramid = meshio.Mesh(MESH.points, [*CELLS, ("pyramid", MESH.hexes[:2, :5])])
    meshio.write(tmp_path / "pyramid.vtu", pyramid)
    meshio.write(tmp_path / "flat.vtu", meshio.Mesh(MESH.points, [("quad", MESH.hexes[:, :4])]))
    for name, words in [
        ("pipe.vtu", "this is a pipe"),
        ("sparse.vtu", "10240 MiB"),
        (".", "this is a folder"),
        ("none.vtu", "No such file"),
        ("block.xyz", '".xyz" is of no mesh format'),
        ("block", "its name has no suffix"),
        ("pyramid.vtu", "2 pyramid"),
        ("flat.vtu", "no hexahedra"),
        (f"{'x' * 300}.vtu", "cannot be read"),
    ]:
        sentence = refusal(read_mesh, tmp_path / name)
        assert sentence and words in sentence, sentence


def test_nodes_are_chosen_by_arrays_of_one_number_a_node(tmp_path: Path) -> None:
    """Of an array of several columns "value" means nothing, and its place in the flattened array is no node."""
    data = {"wall": np.arange(len(MESH.points)), "pairs": np.zeros((len(MESH.points), 2))}
    meshio.write(tmp_path / "block.vtu", meshio.Mesh(MESH.points, CELLS, point_data=data))
    model = tmp_path / "block.toml"
    for name, words in [("wall", None), ("pairs", 'did you mean "'), ("x" * 150, "(150 characters)")]:
        model.write_text(f'mesh = "block.vtu"\nlength_unit = "m"\n[node_sets]\na = {{ point_data = "{name}", value = 3.0 }}\n')
        sentence = refusal(read_model_file, model)
        assert sentence is None if words is None else (sentence and "with one number per node" in sentence), sentence
        if words is None:
            assert read_model_file(model).mesh.node_sets["a"].tolist() == [3]


def never_ends(path: str) -> dict[str, np.ndarray]:
    """A reader like some."""
    while True:
        pass


def crashes(path: str) -> dict[str, np.ndarray]:
    """A reader like others."""
    os.abort()


@pytest.mark.parametrize("reader", [never_ends, crashes])
def test_readers_may_hang_and_crash(reader: child.Reader, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "SECONDS_TO_BEGIN", 2.0)
    (tmp_path / "file").write_text("x")
    sentence = refusal(lambda path: child.read_in_child(reader, path, "it is damaged."), tmp_path / "file")
    assert sentence and sentence.endswith("file: it is damaged.")


def test_a_damaged_surface_ends_no_run(tmp_path: Path) -> None:
    """VTK crashes on a PLY whose header names a type that there is none of."""
    path = tmp_path / "bone.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty floXt x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    sentence = refusal(lambda path: read_surface(path, "mm"), path)
    assert sentence and "PLY" in sentence
    os.mkfifo(tmp_path / "pipe.stl")
    assert "this is a pipe" in (refusal(lambda path: read_surface(path, "mm"), tmp_path / "pipe.stl") or "")
