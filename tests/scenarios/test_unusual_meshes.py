"""Right mesh files in unusual forms: nodes, elements, sets and volume are all read, or the file is refused with its cause."""

from __future__ import annotations

import builtins
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mesh_files as files
import meshio
import numpy as np
import pytest
import pyvista
from command import command

from explicitfe.app.tools.mesh_contents import mesh_contents
from explicitfe.app.tools.new_model import write_new_model
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.mesh.soundness import soundness
from explicitfe.fem.mesh.traced_fibres import harmonic_direction, trace_fibres
from explicitfe.fem.model.fibre_stress import fibre_stress
from explicitfe.fem.model.profile import Profile
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.anatomy.own_mesh import read_model_file
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.meshes import mesh_file
from explicitfe.simulate.meshes.mesh_file import read_mesh
from explicitfe.simulate.meshes.midpoints import hexahedra
from explicitfe.simulate.scenario.read import read_scenario
from explicitfe.simulate.scenario.transient import TransientScenario

BLOCK = {"nodes": 27, "hexahedra": 8, "volume": 1000.0, "lowest": [0, 0, 0], "highest": [10, 10, 10]}
TWICE = BLOCK | {"nodes": 54, "hexahedra": 16, "volume": 2000.0}
FOOT, LOW = {"FOOT": 9}, {"LOW": 4}
FLAGGED = (BLOCK, {"foot": 9, "low": 18}, {"low": 4})
IMAGE = pyvista.ImageData(dimensions=(3, 3, 3), spacing=(5, 5, 5))
LABELS = [101 + 7 * k for k in range(27)]
SPLIT = "*Node\n{}*Node, nset=TOP\n{}"
FLAT = f"*Node\n{files.nodes()}*Element, type=C3D8, elset=ALL\n{files.elements()}"


def text(name: str, content: str, **others: str) -> Callable[[Path], Path]:
    """A writer of a file, and of others beside it."""

    def write(folder: Path) -> Path:
        for other, of in others.items():
            (folder / other.replace("_", ".")).write_text(of)
        (folder / name).write_text(content)
        return folder / name

    return write


def written(ending: str, cells: list, points: np.ndarray = files.POINTS, **options: Any) -> Callable[[Path], Path]:
    """A writer by meshio."""
    kinds = {key: options.pop(key) for key in ("file_format", "binary") if key in options}

    def write(folder: Path) -> Path:
        meshio.write(folder / f"block.{ending}", meshio.Mesh(points, cells, **options), **kinds)
        return folder / f"block.{ending}"

    return write


def by_vtk(name: str, writer: str, of: Any = None, **settings: Any) -> Callable[[Path], Path]:
    """A writer by VTK."""
    return lambda folder: files.by_vtk(folder / name, writer, of, **settings)


def med(folder: Path) -> Path:
    """A MED file with groups of nodes and of elements."""
    mesh = meshio.Mesh(files.POINTS, HEX, point_data={"point_tags": (files.POINTS[:, 2] == 0).astype(int)})
    mesh.cell_data = {"cell_tags": [np.where(np.arange(8) < 4, -1, -2)]}
    mesh.point_tags, mesh.cell_tags = {1: ["foot"]}, {-1: ["low", "tissue"], -2: ["tissue"]}
    meshio.write(folder / "a.med", mesh)
    return folder / "a.med"


def generated(**options: Any) -> Callable[[Path], Path]:
    """A writer by Gmsh."""
    pytest.importorskip("gmsh", exc_type=(ImportError, OSError))  # its wheel lacks the libraries of the system
    return lambda folder: files.from_gmsh(folder / "box.msh", **options)


HEX = [("hexahedron", files.HEXES)]
CUBE = [("tetra", np.array(files.FIVE))]
FLAGS = {"foot": (files.POINTS[:, 2] == 0).astype(float), "height": files.POINTS[:, 2]}
REGION = {"low": [np.array([1, 1, 1, 1, 0, 0, 0, 0])], "region": [np.arange(8) // 2]}
WEDGES = np.array([(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)])
BOX = {"hexahedra": 16, "volume": 2000.0, "highest": [20, 10, 10]}
# Name -> writer, what is found in it, sizes of its node sets and of its element sets.
READ: dict[str, tuple[Callable[[Path], Path], Mapping[str, Any], Mapping[str, int], Mapping[str, int]]] = {
    "two instances": (
        text("a.inp", files.assembly(files.instance("A"), files.instance("B", "0., 0., 10.5\n"))),
        TWICE | {"highest": [10, 10, 20.5]}, {"FOOT": 18, "A.FOOT": 9, "B.FOOT": 9}, {"LOW": 8, "A.LOW": 4, "B.LOW": 4},
    ),
    "a moved instance": (
        text("a.inp", files.assembly(files.instance("A", "1, 2.,\n"))), BLOCK | {"lowest": [1, 2, 0], "highest": [11, 12, 10]},
        FOOT, LOW,
    ),
    "an instance that is moved and turned by 90 degrees about x = 10": (
        text("a.inp", files.assembly(files.instance("A", "10., 0., 0.\n10., 0., 0., 10., 0., 1., 90.\n"))),
        BLOCK | {"lowest": [0, 0, 0], "highest": [10, 10, 10]}, FOOT, LOW,
    ),
    "an instance that is turned about an oblique axis": (
        text("a.inp", files.assembly(files.instance("A", "10.\n0., 0., 0., 1., 1., 1., 120.\n"))),
        BLOCK | {"lowest": [0, 10, 0], "highest": [10, 20, 10]}, FOOT, LOW,
    ),
    "sets of the assembly": (
        text("a.inp", files.assembly(
            files.instance("A"), files.instance("B", "0., 0., 10.5\n"),
            sets=f"*Nset, nset=CLAMP, instance=A\n{files.numbers(files.FOOT)}*Nset, nset=CLAMP, instance=B\n 1,\n"
            "*Elset, elset=SOFT, instance=B, generate\n 1, 7, 2\n*Nset, nset=BOTH\nA.FOOT, B.1\n",
        )),
        TWICE | {"highest": [10, 10, 20.5]}, {"CLAMP": 10, "BOTH": 10}, {"SOFT": 4},
    ),
    "two parts with the same labels": (
        text("a.inp", files.assembly(files.instance("A")) + f"*Part, name=OTHER\n{FLAT}*End Part\n"
             "*Assembly, name=B\n*Instance, name=B, part=other\n20., 0., 0.\n*End Instance\n*End Assembly\n"),
        TWICE | {"highest": [30, 10, 10]}, {"FOOT": 9, "B.ALL": 27}, {"ALL": 8},
    ),
    "parts without an assembly": (text("a.inp", f"*Part, name=P\n{files.PART}*End Part\n"), BLOCK, FOOT, LOW),
    "a mesh within the instance": (
        text("a.inp", "*Part, name=CUBE\n*End Part\n*Assembly, name=A\n*Instance, name=A, part=CUBE\n5., 0., 0.\n"
             f"{files.PART}*End Instance\n*End Assembly\n"),
        BLOCK | {"lowest": [5, 0, 0], "highest": [15, 10, 10]}, FOOT, LOW,
    ),
    "reference points": (
        text("a.inp", files.assembly(files.instance("A"), sets="*Node\n 1, 500., 0., 0.\n*Nset, nset=RP\n1\n")),
        {"hexahedra": 8, "volume": 1000.0}, FOOT | {"RP": 1}, LOW,
    ),
    "two blocks of nodes, one of them named": (
        text("a.inp", SPLIT.format(files.nodes(files.POINTS[:18]), files.nodes(files.POINTS[18:], range(19, 28)))
             + f"*Element, type=C3D8, elset=E1\n{files.elements(files.HEXES[:4])}*ELEMENT, ELSET = E2, TYPE=c3d8h\n"
             + files.elements(files.HEXES[4:], first=5)),
        BLOCK, {"TOP": 9, "E1": None}, {"E1": 4, "E2": 4},
    ),
    "labels with gaps, and a generated set": (
        text("a.inp", f"*NODE, NSET=Nall\n{files.nodes(labels=LABELS)}*Element,type=C3D8\n"
             f"{files.elements(labels=LABELS, first=1001)}*Nset, nset=FIXED, generate\n101, {LABELS[8]}, 7\n164, 164\n"),
        BLOCK, {"FIXED": 10, "Nall": 27}, {},
    ),
    "elements over several lines": (
        text("a.inp", f"*Node\n{files.nodes()}*Element, type=C3D8\n"
             + files.elements().replace(", ", ",\n", 5).replace(", ", " ,", 3)),
        BLOCK, {}, {},
    ),
    "continued keyword lines, comments, quoted names and sets of sets": (
        text("a.inp", f"** by hand\n*Node,\n  nset=\"all nodes\"\n{files.nodes()}** between\n"
             f"*Element, type=C3D8,\nelset=BODY\n{files.elements()}"
             "*Nset, nset=A\n1, 2, 3,\n*Nset, nset=B\na, 4\n\n*Nset, nset=C\n\"all nodes\", B\n"
             "*Elset, elset=D\nBODY\n*Nset, nset=E, elset=D\n*Elset, elset=D1\n 1\n*Nset, nset=F, elset=d1\n"),
        BLOCK, {"A": 3, "B": 4, "C": 27, "E": 27, "F": 8, "all nodes": 27}, {"D": 8, "BODY": 8},
    ),
    "nested includes and input files": (
        text("a.inp", "*Include, input=one.inp\n*Nset, nset=FOOT\n" + files.numbers(files.FOOT),
             one_inp="*Include, INPUT=two.inp\n*Element, type=C3D8, input=cells.txt\n", two_inp="*Node, input=nodes.txt\n",
             nodes_txt=files.nodes(), cells_txt=files.elements()),
        BLOCK, FOOT, {},
    ),
    "Fortran's numbers, tabs, DOS lines and a mark of the order of bytes": (
        text("a.inp", "\ufeff" + FLAT.replace(".0", ".D+00").replace(", ", "\t,\t").replace("\n", "\r\n")), BLOCK, {}, {"ALL": 8},
    ),
    "surfaces of elements and nodes, and shells as a set": (
        text("a.inp", FLAT + "*Element, type=S4R, elset=SHELL\n101, 1, 2, 5, 4\n*Elset, elset=LOW, generate\n1, 4\n"
             "*Surface, type=ELEMENT, name=SOLE\nLOW, S1\n*Surface, name=ONE\n8, S2\n*Surface, type=NODE, name=N\nALL\n"
             .replace("NODE, name=N\nALL", "NODE, name=N\n1, 1.\n")),
        BLOCK, {"SOLE": None, "ONE": 4, "N": 1, "SHELL": 4}, {"LOW": 4},
    ),
    "surfaces of free faces, and combined ones": (
        text("a.inp", FLAT + "*Elset, elset=LOW, generate\n1, 4\n*Surface, name=SKIN\nALL,\n*Surface, name=BARE\nLOW\n"
             "*Surface, name=SOLE\nLOW, S1\n*Surface, name=ONE\n8, S2\n*Surface, name=SUM, combine=union\nSOLE, ONE\n"
             "*Surface, name=LESS, combine=difference\nBARE, SOLE\n"),
        BLOCK, {"SKIN": 26, "BARE": 17, "SOLE": 12, "ONE": 4, "SUM": 16, "LESS": 6}, {},
    ),
    "hexahedra of which all are inside out": (
        text("a.inp", f"*Node\n{files.nodes()}*Element, type=C3D8\n{files.elements([[*h[4:], *h[:4]] for h in files.HEXES])}"),
        BLOCK, {}, {},
    ),
    "steps and loads after the mesh": (
        text("a.inp", FLAT + "*Material, name=M\n*Elastic\n1., 0.3\n*Step\n*Static\n1., 1.\n*Node print\nU\n*End Step\n"),
        BLOCK, {}, {},
    ),
    "tetrahedra of Abaqus, some turned inside out": (
        text("a.inp", f"*Node\n{files.nodes(files.CUBE)}*Element, type=C3D4\n"
             + files.elements([files.FIVE[0][::-1], *files.FIVE[1:]])),
        {"nodes": 8, "hexahedra": 20, "volume": 1000.0, "cells": {"tetrahedra": 5}}, {}, {},
    ),
    "wedges": (
        text("a.inp", f"*Node\n{files.nodes(files.CUBE)}*Element, type=C3D6\n{files.elements(WEDGES)}"),
        {"nodes": 8, "hexahedra": 12, "volume": 1000.0, "cells": {"wedges": 2}}, {}, {},
    ),
    "Gmsh 2.2 with sparse tags, an element in two groups and an unused node": (
        text("a.msh", files.gmsh_text(np.arange(27) * 3 + 40, extra="9999 7 7 7\n")),
        {"hexahedra": 8, "volume": 1000.0}, {"clamp": 9, "tissue": 27}, {"tissue": 8, "volume.7": 4},
    ),
    "Gmsh 2.2 without groups": (text("a.msh", files.gmsh_text(np.arange(27) + 1, physical=False)), BLOCK, {}, {}),
    "the same name for a surface and a volume": (
        text("a.msh", files.gmsh_text(np.arange(27) + 1).replace('"clamp"', '"tissue"')),
        BLOCK, {"surface.tissue": 9, "volume.tissue": 27}, {"volume.tissue": 8},
    ),
    **{
        f"Gmsh {version}, {'binary' if binary else 'text'}, {'hexahedra' if recombine else 'tetrahedra'}": (
            generated(version=version, binary=binary, recombine=recombine),
            BOX if recombine else {"volume": 2000.0, "highest": [20, 10, 10]},
            {"clamp": 9 if recombine else None}, {"half": 8 if recombine else None, "tissue": 16 if recombine else None},
        )
        for version, binary, recombine in [
            (2.2, False, True), (2.2, True, True), (4.1, False, True), (4.1, True, True), (4.1, True, False), (2.2, False, False),
        ]
    },
    "Gmsh 4.1 with all elements saved": (
        generated(save_all=True, recombine=True), {"hexahedra": 16, "volume": 2000.0}, {"clamp": 9}, {"half": 8, "tissue": 16},
    ),
    "VTU with arrays of 0 and 1": (
        written("vtu", HEX, point_data=FLAGS, cell_data=REGION), BLOCK, {"foot": 9, "low": 18}, {"low": 4}),
    "VTK as text": (written("vtk", HEX, point_data=FLAGS, cell_data=REGION, binary=False), BLOCK, {"foot": 9}, {"low": 4}),
    **{
        f"VTK {version / 10}, {kind}": (
            by_vtk("a.vtk", "UnstructuredGrid", SetFileVersion=(version,), **{f"SetFileTypeTo{kind}": ()}), *FLAGGED)
        for version in (42, 51) for kind in ("ASCII", "Binary")
    },
    **{
        f"VTU, {compressor}": (
            by_vtk("a.vtu", "XMLUnstructuredGrid", SetDataModeToAppended=(), **{f"SetCompressorTypeTo{compressor}": ()}),
            *FLAGGED,
        )
        for compressor in ("None", "LZ4", "LZMA")
    },
    "VTU of two pieces": (lambda folder: files.two_pieces(folder / "a.vtu"), *FLAGGED),
    "VTU with a ghost cell": (
        by_vtk("a.vtu", "XMLUnstructuredGrid", files.grid(files.HEXES[[*range(8), 0]], vtkGhostType=np.uint8([0] * 8 + [1]))),
        *FLAGGED,
    ),
    "PVTU": (by_vtk("a.pvtu", "XMLPUnstructuredGrid"), *FLAGGED),
    "VTU of voxels": (by_vtk("a.vtu", "XMLUnstructuredGrid", IMAGE.cast_to_unstructured_grid()), BLOCK, {}, {}),
    "an image": (by_vtk("a.vti", "XMLImageData", IMAGE), BLOCK, {}, {}),
    "a structured grid": (by_vtk("a.vtk", "StructuredGrid", IMAGE.cast_to_structured_grid()), BLOCK, {}, {}),
    "groups of MED": (med, BLOCK, {"foot": 9, "low": 18, "tissue": 27}, {"low": 4, "tissue": 8}),
    **{f"Nastran {form}": (text("a.bdf", files.nastran(form)), BLOCK, {}, {}) for form in ("{:8}", "{:16}", "{},")},
    "Nastran in small letters and numbers without E": (
        text("a.bdf", "SOL 101\nBEGIN BULK\n" + files.nastran(points=0.1 * files.POINTS).lower().replace("0.5", "5.-1")
             .replace("1.0", "1.+0")),
        BLOCK | {"volume": 1.0, "highest": [1, 1, 1]}, {}, {},
    ),
    "a node of no element": (text("a.inp", FLAT.replace("*Node", "*Node\n500, 900., 0., 0.", 1)), BLOCK, {}, {}),
    "an element that is inside out": (
        text("a.inp", f"*Node\n{files.nodes()}*Element, type=C3D8\n"
             + files.elements([np.roll(files.HEXES[0], 4), *files.HEXES[1:]])),
        {"hexahedra": 8, "fault": "element 0 is inverted"}, {}, {},
    ),
    "a wedge as a hexahedron": (
        text("a.inp", f"*Node\n{files.nodes(files.CUBE)}*Element, type=C3D8\n1, 1, 2, 3, 3, 5, 6, 7, 7\n"),
        {"hexahedra": 1, "fault": "element 0 has node 2 at corners 2 and 3"}, {}, {},
    ),
    "VTU of tetrahedra and hexahedra that do not touch": (
        written("vtu", [*HEX, ("tetra", np.array(files.FIVE) + 27)], points=np.concatenate([files.POINTS, files.CUBE + 30.0])),
        {"nodes": 35, "volume": 2000.0, "cells": {"hexahedra": 8, "tetrahedra": 5}, "hexahedra": 8 * 8 + 20}, {}, {},
    ),
    **{
        f"FEBio {version}": (
            text("a.feb", files.feb(version)), BLOCK, {"FOOT": 9, "sole": 9, "all": 27, "tissue": 27}, LOW | {"tissue": 8},
        )
        for version in ("2.5", "3.0", "4.0")
    },
    "FEBio with its mesh in another file and ranges": (
        text("a.feb", '<febio_spec version="4.0"><Mesh from="b.feb"/></febio_spec>',
             b_feb=files.feb("4.0").replace(">1,2,3,4</ElementSet>", ">1:4</ElementSet>")),
        BLOCK, FOOT, LOW,
    ),
}  # fmt: skip


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are read without a child, for speed; ``open`` is put back afterwards."""
    monkeypatch.setattr(builtins, "open", builtins.open)
    monkeypatch.setattr(mesh_file, "read_in_child", lambda reader, path, damaged: reader(str(path)))


@pytest.mark.parametrize(("write", "found", "node_sets", "element_sets"), READ.values(), ids=READ)
def test_a_right_file_is_read_whole(
    write: Callable[[Path], Path],
    found: Mapping,
    node_sets: Mapping,
    element_sets: Mapping,
    tmp_path: Path,
    in_this_process: None,
) -> None:
    contents = mesh_contents(write(tmp_path))
    for key, value in found.items():
        if key in ("nodes", "hexahedra", "cells"):
            assert contents[key] == value, key
        elif key == "fault":
            assert value in contents["fault"]
        else:
            np.testing.assert_allclose(contents[key], value, rtol=1e-9, atol=1e-9, err_msg=key)
    for kind, sizes in (("node_sets", node_sets), ("element_sets", element_sets)):
        for name, size in sizes.items():
            assert contents[kind][name] == size or (size is None and contents[kind][name] > 0), (name, contents[kind])


@pytest.mark.parametrize(("kind", "endings"), [("tetrahedra", 3), ("wedges", 2), ("hexahedra", 4)])
def test_elements_of_second_order_stay_curved(kind: str, endings: int, tmp_path: Path, in_this_process: None) -> None:
    """An arc of n chords has an error of area of 1/n^2: a fourth of it with nodes in the middles, alike in all formats."""
    pytest.importorskip("gmsh", exc_type=(ImportError, OSError))
    right = 4000.0 / 3.0 * np.pi if kind == "tetrahedra" else 1000.0 * np.pi
    errors = {}
    for order, incomplete, ending in ((1, 0, "msh"), (2, 1, "msh"), (2, 1, "inp"), (2, 0, "msh"), (2, 0, "vtk"))[: 1 + endings]:
        path = files.round_body(tmp_path / f"a{order}{incomplete}.{ending}", kind, order, incomplete=bool(incomplete))
        contents = mesh_contents(path)
        errors[order, incomplete, ending] = contents["volume"] / right - 1.0
        content = read_mesh(path)
        body = hexahedra(content.points, content.cells, content.middles)
        assert np.isin(content.middles[:, 2], body.hexes).all()
        if ending != "vtk":
            free = np.unique(body.hexes[free_faces(body.hexes)[0][:, None], FACES[free_faces(body.hexes)[1]]])
            skin = body.nodes(content.node_sets["skin"])
            np.testing.assert_array_equal(skin[np.isin(skin, body.hexes)], free)
    first, *second = errors.values()
    assert -0.05 < first < 0.0
    np.testing.assert_allclose(second, first / 4.0, rtol=0.15)


REFUSED = {
    "an instance of no part": (
        text("a.inp", files.assembly(files.instance("A").replace("part=CUBE", "part=CUB"))), 'did you mean "CUBE"'),
    "generated nodes": (text("a.inp", FLAT + "*Nfill, nset=X\nA, B, 3, 1\n"), "*Nfill: this generates nodes"),
    "cylindrical coordinates": (text("a.inp", FLAT.replace("*Node", "*Node, system=C")), "rectangular"),
    "a label that is twice there": (text("a.inp", FLAT + "*Node\n5, 1., 1., 1.\n"), "node 5 is defined twice"),
    "an element without a node": (text("a.inp", FLAT.replace("8, 14,", "8, 999,")), "names node 999"),
    "a set without a node": (text("a.inp", FLAT + "*Nset, nset=A\n1, 99\n"), "line 38, *Nset: node 99 does not exist"),
    "a set of no set": (text("a.inp", FLAT + "*Nset, nset=ABC\n1\n*Nset, nset=B\nABD\n"), 'no set "ABD"; did you mean "ABC"'),
    "a set within itself": (text("a.inp", FLAT + "*Nset, nset=A\nB\n*Nset, nset=B\nA\n"), "contains itself"),
    "elements of another order": (text("a.inp", FLAT.replace("C3D8,", "C3D20,")), "does not have the 20 nodes of the type C3D20"),
    "cohesive elements": (text("a.inp", FLAT + "*Element, type=COH3D8\n99, 1,2,3,4,5,6,7,8\n"), "COH3D8 is not supported"),
    "shells alone": (
        text("a.inp", f"*Node\n{files.nodes()}*Element, type=S4\n1, 1, 2, 5, 4\n"), "no hexahedra and no tetrahedra"),
    "a file to include that is not there": (text("a.inp", "*Include, input=b.inp\n"), 'the file "b.inp" does not exist'),
    "another file": (text("a.inp", "once upon a time\n"), "line 1: there is no keyword"),
    "a word as coordinate": (text("a.inp", FLAT.replace("5.0", "five", 1)), "line 3, *Node"),
    "a pyramid": (text("a.inp", FLAT + "*Element, type=C3D5\n99, 1, 2, 5, 4, 10\n"), "four edges meet at the apex of a pyramid"),
    "tetrahedra on hexahedra": (written("vtu", [*HEX, ("tetra", files.HEXES[:1, [0, 1, 3, 4]])]), "do not fit together"),
    "tetrahedra whose middles lie elsewhere": (
        written("vtu", [("tetra10", np.arange(10)[None])]), "do not lie near the middle of their edges, "),
    "tetrahedra of third order": (
        text("a.feb", files.feb("3.0").replace("hex8", "tet20")), "tet20 has 8 nodes"),
    "Gmsh 4.0": (text("a.msh", "$MeshFormat\n4 0 8\n$EndMeshFormat\n"), "msh41"),
    "a Gmsh file that is cut": (text("a.msh", files.gmsh_text(np.arange(27))[:900]), "has no end"),
    "a surface file": (text("a.stl", "solid a\nendsolid a\n"), "explicitfe new model"),
    "FEBio with parts of an assembly": (text("a.feb", files.feb("4.0").replace("<Mesh>", "<Mesh><Part/>")), "<Part> in its mesh"),
    "a FEBio node of two coordinates": (text("a.feb", files.feb("4.0").replace(">0,0,0<", ">0,0<")), '<node id="1"> does not'),
    "a FEBio element of seven nodes": (text("a.feb", files.feb("4.0").replace(",14,5<", ",14<", 1)), "hex8 has 7 nodes"),
    "FEBio that is cut": (text("a.feb", files.feb("4.0")[:500]), "no whole XML"),
    "FEBio's elements of another order": (text("a.feb", files.feb("3.0").replace("hex8", "hex20")), "hex20 has 8 nodes"),
    "Nastran with a coordinate system": (
        text("a.bdf", files.nastran(system="5")), "line 2, GRID: the nodes are in the coordinate system 5"),
    "Nastran with a default system": (
        text("a.bdf", "GRDSET,,5\n" + files.nastran("{},")), "line 1, GRDSET: the nodes are in the coordinate system 5"),
    "Nastran in two files": (text("a.bdf", "INCLUDE 'b.bdf'\n" + files.nastran()), "line 1, INCLUDE: this card is not supported"),
    "Nastran with an unknown solid": (text("a.bdf", files.nastran().replace("CHEXA", "CHEX8")), "CHEX8: this card is not"),
    "a Nastran element of seven nodes": (
        text("a.bdf", files.nastran("{},").replace("+,27,18", "+,27")), "too few numbers"),
    "LS-DYNA": (
        text("a.k", "*KEYWORD\n"), 'the suffix ".k" is of no mesh format that is read; save the mesh in one that is: .inp'),
    "a surface as VTK": (
        by_vtk("a.vtk", "PolyData", pyvista.Sphere()), "closed surface, saved as STL, OBJ, PLY or VTP"),
    "a surface of VTK": (text("a.vtp", "<VTKFile/>"), "a VTP file holds a surface"),
    "cells of Lagrange": (
        by_vtk("a.vtu", "XMLUnstructuredGrid",
               pyvista.UnstructuredGrid(np.insert(files.HEXES, 0, 8, axis=1).ravel(), [72, *[12] * 7], files.POINTS)),
        "1 VTK_LAGRANGE_HEXAHEDRON cells"),
    "a missing piece": (
        lambda folder: [files.by_vtk(folder / "a.pvtu", "XMLPUnstructuredGrid"), (folder / "a_0.vtu").unlink()][0],
        "File for piece 0 cannot be read"),
    "a surface of a face that is none": (text("a.inp", FLAT + "*Surface, name=A\n1, S7\n"), '"S7" is no face of element 1'),
}  # fmt: skip


@pytest.mark.parametrize(("write", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_not_read_is_refused_with_its_cause(
    write: Callable[[Path], Path], words: str, tmp_path: Path, in_this_process: None
) -> None:
    with pytest.raises(InputError) as refusal:
        mesh_contents(write(tmp_path))
    assert words in str(refusal.value) and str(refusal.value).endswith((".", "?")), refusal.value


def test_vtu_without_pyvista(tmp_path: Path, in_this_process: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshio reads it, and what meshio would read in part is refused."""
    for module in ("simulate.meshes.mesh_file", "platform.host.extras"):
        monkeypatch.setattr(f"explicitfe.{module}.has_extra", lambda extra: False)
    assert mesh_contents(READ["VTU with arrays of 0 and 1"][0](tmp_path))["hexahedra"] == 8
    mixed = files.grid().merge(IMAGE.translate((20, 0, 0)).cast_to_unstructured_grid())
    for path, words in (
        (files.by_vtk(tmp_path / "a.vtu", "XMLUnstructuredGrid", mixed), "reads this mesh in part only"),
        (files.two_pieces(tmp_path / "b.vtu"), "needs pyvista"),
    ):
        with pytest.raises(InputError, match=words):
            mesh_contents(path)


def test_inspect_names_what_no_file_of_a_result_is(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    assert command(["inspect", str(text("a.unv", "    -1\n")(tmp_path))]) == 2
    assert 'the suffix ".unv" is of no mesh format' in " ".join(capfd.readouterr().err.split())


# ---- sets by name in model files and scenarios ----

SCENARIO = """\
title = "A block"
[model]
file = "block.toml"
{model}
[[load]]
nodes = "TOP"
force_N = [0.01, 0.0, 0.0]
[analysis]
duration_ms = 1.0
"""
NAMED = FLAT + (
    f"*Nset, nset=FOOT\n{files.numbers(files.FOOT)}*Nset, nset=TOP, generate\n19, 27\n*Elset, elset=LOW\n1, 2, 3, 4\n"
)


def model_of(folder: Path, mesh: str, model_file: str, model: str = "", scenario: str = SCENARIO) -> Any:
    """The physics of a scenario on a mesh file that is described by a model file."""
    (folder / "block.inp").write_text(mesh)
    (folder / "block.toml").write_text(f'mesh = "block.inp"\nlength_unit = "mm"\n{model_file}')
    (folder / "run.toml").write_text(scenario.format(model=model))
    read, _ = read_scenario(folder / "run.toml")
    assert isinstance(read, TransientScenario)
    return assemble(read, folder).model


def test_sets_of_the_mesh_hold_and_load(tmp_path: Path) -> None:
    """By name, without a list of numbers; a single name needs no brackets."""
    model = model_of(tmp_path, NAMED, 'fixed = "FOOT"\n')
    assert np.flatnonzero(model.held.all(axis=1)).tolist() == files.FOOT.tolist()
    assert len(model.loads[0].nodes) == 9 and np.isclose(model.loads[0].force_N[:, 0].sum(), 0.01)


def test_elements_of_a_set_have_their_own_material(tmp_path: Path) -> None:
    materials = "material = { C10_Pa = 1000.0, C20_Pa = 0.0 }\nmaterials = { LOW = { C10_Pa = 3000.0, C20_Pa = 0.0 } }"
    model = model_of(tmp_path, NAMED, 'fixed = ["FOOT"]\n', materials)
    (part,) = model.inclusions
    assert part.elements.tolist() == [0, 1, 2, 3] and part.material.C10_Pa == 3000.0
    with pytest.raises(InputError, match=r'model.materials: unknown element set "LO"; did you mean "LOW"'):
        model_of(tmp_path, NAMED, 'fixed = ["FOOT"]\n', materials.replace("LOW", "LO"))


def test_nodes_by_the_labels_of_the_file(tmp_path: Path) -> None:
    """Abaqus numbers nodes as it likes: the lists of a model file may use these numbers."""
    mesh = f"*Node\n{files.nodes(labels=LABELS)}*Element, type=C3D8\n{files.elements(labels=LABELS)}*Nset, nset=TOP\n283\n"
    model = model_of(tmp_path, mesh, 'first_number = "labels"\nfixed = ["a"]\n[node_sets]\na = [101, 108]\n')
    assert np.flatnonzero(model.held.all(axis=1)).tolist() == [0, 1]
    with pytest.raises(InputError, match=r"node 102 in node_sets.a does not exist"):
        model_of(tmp_path, mesh, 'first_number = "labels"\n[node_sets]\na = [102]\n')
    parts = files.assembly(files.instance("A"), files.instance("B", "0., 0., 11.\n"))
    with pytest.raises(InputError, match="needs a mesh file in which each node has one label"):
        model_of(tmp_path, parts, 'first_number = "labels"\n')


def test_nodes_without_elements_are_left_out(tmp_path: Path) -> None:
    """Reference points are no tissue; who needs one is told."""
    mesh = "*Node\n500, 90., 0., 0.\n" + NAMED + "*Nset, nset=RP\n500\n"
    model = model_of(tmp_path, mesh, 'fixed = ["FOOT"]\n')
    assert model.mesh.node_count == 27 and np.flatnonzero(model.held.all(axis=1)).tolist() == files.FOOT.tolist()
    with pytest.raises(InputError, match="nodes of RP belong to no element"):
        model_of(tmp_path, mesh, 'fixed = ["RP"]\n')
    with pytest.raises(InputError, match=r"node 0 in named_points.p belongs to no element"):
        model_of(tmp_path, mesh, "named_points = { p = 0 }\n")


def test_sets_of_tetrahedra_become_those_of_hexahedra(tmp_path: Path) -> None:
    """New nodes between those of a set on the surface belong to it, and those inside the body do not."""
    mesh = f"*Node\n{files.nodes(files.CUBE)}*Element, type=C3D4, elset=ALL\n{files.elements(files.FIVE)}"
    mesh += "*Nset, nset=FOOT\n1, 2, 3, 4\n*Nset, nset=TOP\n5, 6, 7, 8\n*Nset, nset=EDGE\n1, 2\n*Elset, elset=ONE\n1\n"
    model = model_of(tmp_path, mesh, 'fixed = ["FOOT"]\n')
    sets = model.mesh.node_sets
    # A square of two triangles: 4 corners, 5 middles of edges, 2 of triangles.
    assert {name: len(sets[name]) for name in ("FOOT", "TOP", "EDGE", "ONE")} == {"FOOT": 11, "TOP": 11, "EDGE": 3, "ONE": 15}
    assert (model.mesh.points[sets["FOOT"], 2] == 0.0).all()
    assert np.isclose(volumes(model.mesh.points, model.mesh.hexes).sum(), 1e-6)


def test_a_cell_array_names_elements_and_nodes(tmp_path: Path) -> None:
    cells = {"region": [np.arange(8) // 4 + 1]}
    meshio.write(tmp_path / "block.vtu", meshio.Mesh(files.POINTS, HEX, cell_data=cells))
    path = tmp_path / "block.toml"
    path.write_text(
        'mesh = "block.vtu"\nlength_unit = "mm"\nfixed = ["low"]\n[node_sets]\nlow = { cell_data = "region", value = 1 }\n'
    )
    anatomy = read_model_file(path)
    assert anatomy.element_sets["low"].tolist() == [0, 1, 2, 3] and len(anatomy.mesh.node_sets["low"]) == 18
    path.write_text(path.read_text().replace("value = 1", "value = 7"))
    with pytest.raises(InputError, match="no element has region = 7"):
        read_model_file(path)


# ---- muscles by sets ----


def _bar(folder: Path, muscle: str) -> Anatomy:
    """A bar of 40 x 10 x 10 mm with the element set BELLY, its upper half, and node sets of its ends."""
    bar = box((8, 2, 2), (4.0, 1.0, 1.0))  # cm
    ends = [np.flatnonzero(bar.points[:, 0] == x) for x in (0.0, 4.0)]
    belly = np.flatnonzero(bar.points[bar.hexes].mean(axis=1)[:, 2] > 0.5)
    sets = "".join(f"*Nset, nset={name}\n{files.numbers(of)}" for name, of in zip(("NEAR", "FAR"), ends, strict=True))
    mesh = f"*Node\n{files.nodes(bar.points)}*Element, type=C3D8\n{files.elements(bar.hexes)}{sets}"
    (folder / "bar.inp").write_text(f"{mesh}*Elset, elset=BELLY\n{files.numbers(belly)}")
    (folder / "bar.toml").write_text(f'mesh = "bar.inp"\nlength_unit = "cm"\n[[muscle]]\nname = "M"\n{muscle}')
    return read_model_file(folder / "bar.toml")


DESCRIPTIONS = ['elements = "BELLY"\ndirection = [2.0, 0.0, 0.0]\n', 'elements = "BELLY"\norigin = "NEAR"\ninsertion = "FAR"\n']


@pytest.mark.parametrize("muscle", DESCRIPTIONS, ids=["direction", "between"])
def test_a_muscle_of_elements_pulls_with_its_force(muscle: str, tmp_path: Path) -> None:
    """Its stress is the force over the section, 50 mm², uniform and along the bar, in its elements alone."""
    anatomy = _bar(tmp_path, muscle)
    m, mesh = anatomy.muscles["M"], anatomy.mesh
    for side, elements, area_m2 in (("both", 16, 50e-6), ("left", 8, 25e-6)):
        stress = fibre_stress(mesh, m, 0.1 * area_m2 / 50e-6, side, Profile.constant())
        assert len(stress.elements) == elements and set(stress.elements) <= set(anatomy.element_sets["BELLY"])
        np.testing.assert_allclose(stress.stress_Pa, 0.1 / 50e-6, rtol=2e-3)
        np.testing.assert_allclose(np.abs(stress.direction[:, 0]), 1.0, rtol=1e-9)
    assert {fibre.side for fibre in m.fibres} == {"left", "right"} and len(m.fibres) == 2
    for fibre in m.fibres:
        np.testing.assert_allclose(fibre.points.position[[0, -1], 0], [0.0, 0.04], atol=1e-4)


def test_fibres_follow_a_bent_muscle(tmp_path: Path) -> None:
    """In a quarter of a ring they run around its centre, not straight from end to end."""
    flat = box((16, 2, 4), (1.0, 1.0, 1.0))
    angle, radius = 0.5 * np.pi * flat.points[:, 0], 0.02 + 0.01 * flat.points[:, 2]
    points = np.stack([radius * np.cos(angle), 0.01 * flat.points[:, 1], radius * np.sin(angle)], axis=1)
    ring = HexMesh(points, flat.hexes[:, [3, 2, 1, 0, 7, 6, 5, 4]])
    ends = [np.flatnonzero(flat.points[:, 0] == x) for x in (0.0, 1.0)]
    everywhere = np.arange(ring.element_count)
    direction = harmonic_direction(ring, everywhere, *ends)
    centre = ring.points[ring.hexes].mean(axis=1)
    around = np.cross([0.0, -1.0, 0.0], centre * [1.0, 0.0, 1.0])
    assert (np.einsum("ij,ij->i", direction, around) / np.linalg.norm(around, axis=1) > 0.999).all()
    fibres, tissue = trace_fibres(ring, everywhere, direction, 0.005)
    for fibre in fibres:
        r = np.hypot(*fibre.points.position[:, [0, 2]].T)
        assert np.ptp(r) < 0.002
    assert set(tissue.fibre) == set(range(len(fibres)))


WRONG_MUSCLES = {
    "no such set": ('elements = "BELY"\ndirection = [1.0, 0.0, 0.0]\n', 'no element set "BELY"; did you mean "BELLY"'),
    "sets that meet": ('origin = "NEAR"\ninsertion = "NEAR"\n', "have nodes in common"),
    "one end": ('elements = "BELLY"\norigin = "NEAR"\n', "give one description of a muscle"),
    "no direction": ('elements = "BELLY"\ndirection = [0.0, 0.0, 0.0]\n', "give one description of a muscle"),
}


@pytest.mark.parametrize(("muscle", "words"), WRONG_MUSCLES.values(), ids=WRONG_MUSCLES)
def test_muscles_of_sets_that_cannot_be(muscle: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refusal:
        _bar(tmp_path, muscle)
    assert words in str(refusal.value) and "bar.toml" in str(refusal.value)


# ---- surfaces ----


def _surface(folder: Path, name: str, poly: Any) -> Path:
    poly.triangulate().save(folder / name)
    return folder / name


def _two_balls() -> Any:
    """Balls of radius 15 and 14 mm that overlap, as a contour on a grid: triangles of very different sizes."""
    grid = pyvista.ImageData(dimensions=(80, 50, 50), spacing=(1, 1, 1), origin=(-40, -25, -25))
    balls = [np.linalg.norm(grid.points - centre, axis=1) - radius for centre, radius in (([-11, 0, 0], 15), ([11, 0, 3], 14))]
    grid["distance"] = np.minimum(*balls)
    return grid.contour([0.0], scalars="distance")


def _bracket() -> Any:
    """An L of 40 x 40 x 20 mm, 18 mm wide, with a concave edge."""
    outline = np.array([(0, 0, 0), (40, 0, 0), (40, 18, 0), (18, 18, 0), (18, 40, 0), (0, 40, 0)], dtype=float)
    walls = pyvista.PolyData(outline, faces=[6, *range(6)]).triangulate().extrude((0, 0, 20), capping=True).triangulate().clean()
    return walls.compute_normals(auto_orient_normals=True, consistent_normals=True, split_vertices=False)


def _unmerged(ball: Any) -> Any:
    """Triangles of their own corners, which differ by about 1e-5 mm."""
    corners = ball.points[ball.regular_faces].reshape(-1, 3)
    away = 1e-5 * np.random.default_rng(0).standard_normal(corners.shape)
    return pyvista.PolyData.from_regular_faces(corners + away, np.arange(len(corners)).reshape(-1, 3))


SURFACES = {
    "ball.stl": (lambda: pyvista.Sphere(radius=20), 4.0, 0.03, 0.5),
    "egg.ply": (lambda: pyvista.ParametricEllipsoid(30, 18, 14), 4.0, 0.04, 0.5),
    "ring.obj": (lambda: pyvista.ParametricTorus(ringradius=20, crosssectionradius=8), 2.5, 0.03, 0.5),
    "balls.stl": (_two_balls, 2.5, 0.03, 0.45),
    # Flat faces and straight edges are exact; the circle of the cylinder loses what chords lose.
    "box.stl": (lambda: pyvista.Box((0, 30, 0, 20, 0, 20)), 4.0, 1e-6, 0.5),
    "turned.stl": (lambda: pyvista.Box((0, 30, 0, 20, 0, 20)).rotate_vector((1, 2, 3), 35), 3.0, 1e-6, 0.3),
    "bracket.stl": (_bracket, 4.0, 1e-6, 0.45),
    "can.stl": (lambda: pyvista.Cylinder(radius=12, height=25, direction=(0, 0, 1), resolution=64), 4.0, 0.03, 0.6),
    "unmerged.stl": (lambda: _unmerged(pyvista.Sphere(radius=20)), 4.0, 0.03, 0.5),
    "octahedron.stl": (
        lambda: pyvista.Octahedron(radius=20).rotate_vector((1, -1, 0), 54.7356),
        2.5,
        0.01,
        0.2,
    ),  # four edges at a corner
}


@pytest.mark.parametrize(("name", "make", "size", "missing", "worst"), [(k, *v) for k, v in SURFACES.items()], ids=SURFACES)
def test_a_surface_is_filled_with_hexahedra(
    name: str, make: Callable[[], Any], size: float, missing: float, worst: float, tmp_path: Path, in_this_process: None
) -> None:
    """Of one piece, without a bad element, and with the volume of the surface; the model file and the scenario work."""
    model = write_new_model(_surface(tmp_path, name, make()), tmp_path, size_mm=size)
    assert model["volume_ratio"] is not None and abs(model["volume_ratio"] - 1.0) < missing, model["volume_ratio"]
    assert model["contents"]["smallest_scaled_jacobian"] > worst
    anatomy = read_model_file(Path(model["model"]))
    assert anatomy.fixed == ("z0",) and len(anatomy.mesh.node_sets["z0"]) > 3
    assert soundness(anatomy.mesh).part_count == 1 and not len(soundness(anatomy.mesh).same_place)
    scenario, _ = read_scenario(Path(model["scenario"]))
    assert isinstance(scenario, TransientScenario) and scenario.model.file == f"{name[:-4]}.toml"


def test_sharp_edges_are_rounded_where_elements_would_be_bad(
    tmp_path: Path, in_this_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = _surface(tmp_path, "box.stl", pyvista.Box((0, 30, 0, 20, 0, 20)))
    monkeypatch.setattr("explicitfe.simulate.meshes.fitted_grid._WORST_QUALITY", 0.99)
    model = write_new_model(path, tmp_path, size_mm=2.0)
    assert model["volume_ratio"] is not None and 0.93 < model["volume_ratio"] < 0.97
    assert model["contents"]["smallest_scaled_jacobian"] > 0.4


def test_surfaces_that_cannot_be_filled(tmp_path: Path, in_this_process: None) -> None:
    thin = _surface(tmp_path, "ring.stl", pyvista.ParametricTorus(ringradius=20, crosssectionradius=6))
    ball = _surface(tmp_path, "ball.stl", pyvista.Sphere(radius=20))
    two = _surface(tmp_path, "two.stl", pyvista.Sphere(radius=20) + pyvista.Sphere(radius=10, center=(50, 0, 0)))
    open_ = _surface(tmp_path, "open.stl", pyvista.Sphere(radius=20, end_phi=120))
    for path, size, words in (
        (thin, 4.0, "would be missing; decrease --size"),
        (ball, 50.0, "no cube of 50 mm"),
        (ball, None, "--size is missing"),
        (two, 4.0, "one of 2 separate bodies"),
        (
            _surface(tmp_path, "metres.stl", pyvista.Sphere(radius=0.02)),
            4.0,
            " x 0.04 mm large; decrease --size, or give the unit",
        ),
        (_surface(tmp_path, "ball.vtk", pyvista.Sphere(radius=20)), 4.0, "saved as STL, OBJ, PLY or VTP"),
        (open_, 4.0, "is not closed"),
        (ball, 0.01, "increase --size"),
    ):
        with pytest.raises(InputError) as refusal:
            write_new_model(path, tmp_path, size_mm=size)
        assert words in str(refusal.value), refusal.value
    write_new_model(ball, tmp_path, size_mm=6.0)
    with pytest.raises(InputError, match="exists already"):
        write_new_model(ball, tmp_path, size_mm=6.0)
    mesh = files.from_gmsh(tmp_path / "box.msh")
    with pytest.raises(InputError, match="--size is for a surface"):
        write_new_model(mesh, tmp_path, size_mm=4.0)
    model = write_new_model(mesh, tmp_path)
    assert read_model_file(Path(model["model"])).notes[0].endswith("hexahedra.")
