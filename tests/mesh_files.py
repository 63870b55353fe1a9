"""Writers of mesh files in unusual forms, all of a block of 2 x 2 x 2 hexahedra of 5 mm, or of tetrahedra."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyvista
import vtk

from explicitfe.fem.mesh.box import box

BLOCK = box((2, 2, 2), (10.0, 10.0, 10.0))
POINTS, HEXES = BLOCK.points, BLOCK.hexes
FOOT = np.flatnonzero(POINTS[:, 2] == 0.0)
# Five tetrahedra in a cube of hexahedra's corners.
FIVE = ((0, 1, 2, 5), (0, 2, 3, 7), (0, 5, 7, 4), (2, 7, 5, 6), (0, 2, 7, 5))
CUBE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float) * 10.0


def nodes(points: np.ndarray = POINTS, labels: Sequence[int] | None = None, form: str = "{}, {!r}, {!r}, {!r}") -> str:
    """The data lines of *Node."""
    labels = labels if labels is not None else range(1, len(points) + 1)
    return "".join(form.format(label, *map(float, xyz)) + "\n" for label, xyz in zip(labels, points, strict=True))


def elements(cells: Sequence[Sequence[int]] = HEXES, labels: Sequence[int] | None = None, first: int = 1) -> str:
    """The data lines of *Element; nodes are counted from 0, or have labels."""
    names = [str(labels[node] if labels is not None else node + 1) for node in range(10_000 if labels is None else len(labels))]
    return "".join(f"{k}, " + ", ".join(names[node] for node in cell) + "\n" for k, cell in enumerate(cells, first))


def numbers(of: Sequence[int], step: int = 1) -> str:
    """Labels of nodes counted from 0, in lines of at most 16."""
    words = [str(node * step + 1) for node in of]
    return "".join(", ".join(words[k : k + 16]) + "\n" for k in range(0, len(words), 16))


PART = f"*Node\n{nodes()}*Element, type=C3D8R\n{elements()}*Nset, nset=FOOT\n{numbers(FOOT)}*Elset, elset=LOW\n1, 2, 3, 4\n"


def assembly(*instances: str, part: str = PART, sets: str = "") -> str:
    """An input file of a part CUBE and its instances."""
    placed = "".join(instances)
    return f"*Heading\n any words\n*Part, name=CUBE\n{part}*End Part\n*Assembly, name=A\n{placed}{sets}*End Assembly\n"


def instance(name: str, data: str = "") -> str:
    """A placement of CUBE."""
    return f"*Instance, name={name}, part=CUBE\n{data}*End Instance\n"


def feb(version: str) -> str:
    """FEBio's block with a node set, a surface and an element set, as each version writes them."""
    new = version >= "3"
    node_lines = "".join(f'<node id="{k}">{x:g},{y:g},{z:g}</node>\n' for k, (x, y, z) in enumerate(POINTS, 1))
    cells = "".join(f'<elem id="{k}">{",".join(str(n + 1) for n in cell)}</elem>\n' for k, cell in enumerate(HEXES, 1))
    tag = {"2.5": "node", "3.0": "n", "4.0": ""}[version]
    members = "".join(f'<{tag} id="{n + 1}"/>' for n in FOOT) if tag else ",".join(str(n + 1) for n in FOOT)
    low = {"2.5": "elem", "3.0": "e", "4.0": ""}[version]
    chosen = "".join(f'<{low} id="{k}"/>' for k in (1, 2, 3, 4)) if low else "1,2,3,4"
    quads = [hex_[:4] for hex_ in HEXES if set(hex_[:4]) <= set(FOOT)]
    faces = "".join(f'<quad4 id="{k}">{",".join(str(n + 1) for n in quad)}</quad4>' for k, quad in enumerate(quads, 1))
    material = "" if new else 'mat="1" '
    mesh = (
        f'<Nodes name="all">\n{node_lines}</Nodes>\n<Elements type="hex8" {material}name="tissue">\n{cells}</Elements>\n'
        f'<NodeSet name="FOOT">{members}</NodeSet>\n'
        f'<Surface name="sole">{faces}</Surface>\n<ElementSet name="LOW">{chosen}</ElementSet>\n'
    )
    body = f"<Mesh>\n{mesh}</Mesh>" if new else f"<Geometry>\n{mesh}</Geometry>"
    return f'<?xml version="1.0" encoding="ISO-8859-1"?>\n<febio_spec version="{version}">\n{body}\n</febio_spec>\n'


def gmsh_text(tags: np.ndarray, physical: bool = True, extra: str = "") -> str:
    """Version 2.2 with sparse node tags, a surface group "clamp" at z = 0, a volume group "tissue", and one without a name."""
    quads = [hex_[:4] for hex_ in HEXES if set(hex_[:4]) <= set(FOOT)]
    rows = [(3, 1, quad) for quad in quads] + [(5, 2, hex_) for hex_ in HEXES] + [(5, 7, hex_) for hex_ in HEXES[:4]]
    lines = "".join(
        f"{k} {kind} 2 {group if physical else 0} 1 {' '.join(str(tags[n]) for n in nodes_)}\n"
        for k, (kind, group, nodes_) in enumerate(rows if physical else rows[: len(quads) + len(HEXES)], 1)
    )
    points = "".join(f"{tag} {x} {y} {z}\n" for tag, (x, y, z) in zip(tags, POINTS, strict=True)) + extra
    names = '$PhysicalNames\n2\n2 1 "clamp"\n3 2 "tissue"\n$EndPhysicalNames\n' if physical else ""
    head = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{names}$Nodes\n{len(points.splitlines())}\n{points}$EndNodes\n"
    return f"{head}$Elements\n{len(lines.splitlines())}\n{lines}$EndElements\n"


def from_gmsh(path: Path, *, recombine: bool = False, version: float = 4.1, binary: bool = False, save_all: bool = False) -> Path:
    """A box of 10 x 10 x 20 of Gmsh, with the groups clamp (x = 0, and the point at the origin too), tissue and half."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 5.0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.SaveAll", save_all)
        geometry = gmsh.model.geo
        square = [geometry.addPoint(0, y, z) for y, z in ((0, 0), (10, 0), (10, 10), (0, 10))]
        geometry.addPoint(50, 50, 50)  # belongs to no element
        loop = geometry.addCurveLoop([geometry.addLine(square[k], square[k - 3]) for k in range(4)])
        face = geometry.addPlaneSurface([loop])
        if recombine:
            geometry.mesh.setTransfiniteSurface(face)
            geometry.mesh.setRecombine(2, face)
        options = {"numElements": [2], "recombine": True} if recombine else {}
        lower = geometry.extrude([(2, face)], 10, 0, 0, **options)
        upper = geometry.extrude([lower[0]], 10, 0, 0, **options)
        geometry.synchronize()
        volumes = [lower[1][1], upper[1][1]]
        for dimension, tags, name in ((2, [face], "clamp"), (3, volumes, "tissue"), (3, volumes[1:], "half")):
            gmsh.model.addPhysicalGroup(dimension, tags, name=name)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def round_body(path: Path, kind: str, order: int, *, incomplete: bool = False) -> Path:
    """A ball of tetrahedra, or a cylinder of wedges or hexahedra, of radius 10 (and height 10) by Gmsh, with the group skin."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        options = {"General.Terminal": 0, "Mesh.MeshSizeMax": 5, "Mesh.ElementOrder": order}
        options["Mesh.SecondOrderIncomplete"] = incomplete
        options |= {"Mesh.RecombineAll": 1, "Mesh.Algorithm": 8} if kind == "hexahedra" else {}
        for option, value in options.items():
            gmsh.option.setNumber(option, value)
        if kind == "tetrahedra":
            gmsh.model.occ.addSphere(0, 0, 0, 10)
        else:
            disk = gmsh.model.occ.addDisk(0, 0, 0, 10, 10)
            gmsh.model.occ.synchronize()
            gmsh.model.occ.extrude([(2, disk)], 0, 0, 10, numElements=[2], recombine=True)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], name="tissue")
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)], name="skin")
        gmsh.model.mesh.generate(3)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def grid(hexes: np.ndarray = HEXES, **cell_data: np.ndarray) -> pyvista.UnstructuredGrid:
    """The block for VTK, with the flags "foot" of nodes and "low" of elements in small integers."""
    made = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: hexes}, POINTS)
    made.point_data["foot"] = (POINTS[:, 2] == 0.0).astype(np.uint8)
    made.cell_data["low"] = (np.arange(len(hexes)) < 4).astype(np.int64)
    made.cell_data.update(cell_data)
    return made


def by_vtk(path: Path, writer: str, of: pyvista.DataSet | None = None, **settings: Sequence) -> Path:
    """A file of VTK's own writer, such as XMLUnstructuredGrid; settings are its methods with their arguments."""
    writes = getattr(vtk, f"vtk{writer}Writer")()
    writes.SetFileName(str(path))
    writes.SetInputData(grid() if of is None else of)
    for name, arguments in settings.items():
        getattr(writes, name)(*arguments)
    writes.Write()
    return path


def two_pieces(path: Path) -> Path:
    """A VTU of two pieces, each with its own nodes at the face between them."""
    half, other = (
        by_vtk(path, "XMLUnstructuredGrid", grid(of, low=np.full(4, low)).clean(), SetDataModeToAscii=()).read_text()
        for of, low in ((HEXES[:4], 1), (HEXES[4:], 0))
    )
    begin, end = other.index("<Piece"), other.index("</UnstructuredGrid>")
    path.write_text(half.replace("</UnstructuredGrid>", other[begin:end] + "</UnstructuredGrid>"))
    return path


def nastran(form: str = "{:8}", system: str = "", points: np.ndarray = POINTS) -> str:
    """Bulk data in small fields, in free ones ("{},") or in large ones ("{:16}"), as Gmsh writes it: without its begin."""
    wide = form == "{:16}"
    most = 4 if wide else 8
    lines = []
    cards = [("GRID", label, system, *map(float, xyz)) for label, xyz in enumerate(points, 1)]
    cards += [("CHEXA", label, 1 + (label > 4), *(node + 1 for node in cell)) for label, cell in enumerate(HEXES, 1)]
    for name, *fields in cards:
        for first in range(0, len(fields), most):
            head = f"{name if first == 0 else '' if form == '{:8}' else '+'}{'*' * wide}"
            words = "".join(form.format(str(field)) for field in fields[first : first + most])
            lines.append(("{}," if form == "{}," else "{:8}").format(head) + words.rstrip(","))
    return "$ made by a test\n" + "\n".join(lines) + "\nENDDATA\n"
