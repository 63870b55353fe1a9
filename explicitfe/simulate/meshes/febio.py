"""FEBio's model files (.feb) of versions 2 to 4: nodes, elements, node sets, surfaces and element sets (FEBio user manual).

Materials, boundary conditions and loads are not read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from explicitfe.platform.errors import InputError, nearest
from explicitfe.simulate.meshes.content import FileMesh, MeshBuilder

_KINDS = {
    "hex8": "hexahedron", "tet4": "tetra", "penta6": "wedge", "pyra5": "pyramid", "hex20": "hexahedron20",
    "hex27": "hexahedron27",
    "tet10": "tetra10", "tet15": "tetra15", "tet20": "tetra20", "penta15": "wedge15", "pyra13": "pyramid13",
}  # fmt: skip
_NO_SOLIDS = ("quad", "tri", "q4", "q8", "truss", "line", "beam", "rod", "spring", "point", "node")
_NOT_READ = ("Part", "Instance", "Include")


def read_febio(path: str) -> FileMesh:
    """The mesh of a file with its sets; a part (``Elements``) and a discrete surface are sets of their names too.

    Raises
    ------
    InputError : a damaged file, or a part of the format that is not supported.
    """
    section = _mesh_section(Path(path))
    mesh = MeshBuilder()
    node: dict[int, int] = {}
    cell: dict[int, int] = {}
    for part in section.findall("Nodes"):
        labels = [_label(one) for one in part]
        rows = [_values(one, float) for one in part]
        wrong = next((label for label, row in zip(labels, rows, strict=True) if len(row) != 3), None)
        if wrong is not None:
            raise InputError(f'<node id="{wrong}"> does not have three coordinates; export the file again.')
        points = np.array(rows).reshape(-1, 3)
        repeated = next((label for label in labels if label in node), None)
        if repeated is not None or len(set(labels)) < len(labels):
            raise InputError("a number of a node occurs twice in <Nodes>; export the file again.")
        node |= zip(labels, mesh.add_points(points, labels), strict=True)
        if part.get("name"):
            mesh.name_nodes(part.attrib["name"], [node[label] for label in labels])
    for part in section.findall("Elements"):
        kind = part.get("type", "").lower()
        if kind not in _KINDS and not kind.startswith(_NO_SOLIDS):
            raise InputError(f'elements of the type "{kind}" are not supported; mesh the body with hex8 or tet4.')
        own = [mesh.add_cell(_KINDS.get(kind, "other"), _nodes(one, node)) for one in part]
        count = re.sub(r"\D", "", kind)
        wrong = next((one for one in own if kind in _KINDS and len(mesh.cells[one][1]) != int(count)), None)
        if wrong is not None:
            raise InputError(f"an element of the type {kind} has {len(mesh.cells[wrong][1])} nodes; export the file again.")
        cell |= zip(map(_label, part), own, strict=True)
        if part.get("name") or part.get("elset"):
            mesh.name_cells(part.get("name") or part.attrib["elset"], own)
    for one in section.findall("Surface"):
        mesh.name_nodes(one.get("name", ""), [n for face in one for n in _nodes(face, node)])
    for one in section.findall("DiscreteSet"):
        mesh.name_nodes(one.get("name", ""), [n for line in one for n in _nodes(line, node)])
    for tag, numbers in (("NodeSet", node), ("ElementSet", cell)):
        tables = {one.get("name", ""): one for one in section.findall(tag)}
        for name in tables:
            members = list(_members(tables, name, numbers))
            (mesh.name_nodes if tag == "NodeSet" else mesh.name_cells)(name, members)
    return mesh.finish()


def _mesh_section(path: Path) -> ElementTree.Element:
    """The section ``Mesh``, or ``Geometry`` before version 3; in another file if it says so."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise InputError(f"{path.name} is no whole XML file ({error}); export it again.") from None
    if root.tag != "febio_spec":
        raise InputError(f"{path.name} begins with <{root.tag}>, not with <febio_spec>, so that it is no FEBio file.")
    section = root.find("Mesh") if root.find("Mesh") is not None else root.find("Geometry")
    if section is None:
        raise InputError(f"{path.name} has neither <Mesh> nor <Geometry>, so that it holds no mesh.")
    other = section.get("from")
    if other:
        if not (path.parent / other).is_file() or (path.parent / other).samefile(path):
            raise InputError(f'{path.name} takes its mesh from "{other}", which does not exist; put it next to {path.name}.')
        return _mesh_section(path.parent / other)
    for tag in _NOT_READ:
        if section.find(tag) is not None:
            raise InputError(f"{path.name}: <{tag}> in its mesh is not supported; let your program write the mesh out in full.")
    return section


def _label(one: ElementTree.Element) -> int:
    text = one.get("id", "")
    if not text.isdigit():
        raise InputError(f'<{one.tag} id="{text}"> has no whole number as id; export the file again.')
    return int(text)


def _values(one: ElementTree.Element, kind: type) -> list[float]:
    try:
        return [kind(word) for word in (one.text or "").replace(",", " ").split()]
    except ValueError:
        raise InputError(f'<{one.tag} id="{one.get("id", "")}"> has a word where a number is expected.') from None


def _nodes(one: ElementTree.Element, node: dict[int, int]) -> list[int]:
    numbers = _values(one, int)
    missing = [number for number in numbers if number not in node]
    if missing:
        raise InputError(f'<{one.tag} id="{one.get("id", "")}"> names node {missing[0]}, which the file does not have.')
    return [node[int(number)] for number in numbers]


def _range(name: str, word: str) -> range:
    """The numbers that a word of a list stands for: "7", "1:10" or "1:10:3"."""
    numbers = word.split(":")
    if len(numbers) > 3 or not all(number.isdigit() for number in numbers):
        raise InputError(f'the set "{name}" has "{word}" where a number is expected.')
    return range(int(numbers[0]), int(numbers[min(1, len(numbers) - 1)]) + 1, max(1, int(numbers[2])) if numbers[2:] else 1)


def _members(
    tables: dict[str, ElementTree.Element], name: str, numbers: dict[int, int], within: tuple[str, ...] = ()
) -> Iterator[int]:
    """Numbers of a set, whose members are elements with an id, a list as text, or other sets."""
    if name not in tables or name in within:
        raise InputError(f'there is no set "{name}" to include; {nearest(name, tables)}')
    labels = [label for word in (tables[name].text or "").replace(",", " ").split() for label in _range(name, word)]
    for one in tables[name]:
        other = one.get("node_set") or one.get("elem_set") or one.get("set")
        if other:
            yield from _members(tables, other, numbers, (*within, name))
        else:
            labels.append(_label(one))
    missing = [label for label in labels if label not in numbers]
    if missing:
        raise InputError(f'the set "{name}" names number {missing[0]}, which the file does not have.')
    yield from (numbers[label] for label in labels)
