"""Gmsh's mesh files of versions 2.2 and 4.1, as text and binary, with their physical groups (Gmsh reference manual, chapter 10).

A group is a set with its name. One without a name, or with the name of a group of another dimension, is called by its dimension
too: ``surface.3``, ``surface.clamp``.
"""

from __future__ import annotations

import re
import shlex
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.simulate.meshes.content import SOLIDS, FileMesh, MeshBuilder

_DIMENSIONS = ("point", "curve", "surface", "volume")
# Type -> what it is, its number of nodes and its dimension.
_TYPES = {
    1: ("line", 2, 1), 2: ("triangle", 3, 2), 3: ("quad", 4, 2), 4: ("tetra", 4, 3), 5: ("hexahedron", 8, 3), 6: ("wedge", 6, 3),
    7: ("pyramid", 5, 3), 8: ("line3", 3, 1), 9: ("triangle6", 6, 2), 10: ("quad9", 9, 2), 11: ("tetra10", 10, 3),
    12: ("hexahedron27", 27, 3), 13: ("wedge18", 18, 3), 14: ("pyramid14", 14, 3), 15: ("vertex", 1, 0), 16: ("quad8", 8, 2),
    17: ("hexahedron20", 20, 3), 18: ("wedge15", 15, 3), 19: ("pyramid13", 13, 3),
}  # fmt: skip
# Where Gmsh puts the nodes at the middles of edges, in the order of SOLID_EDGES, by the number of corners.
_MIDDLES_OF_GMSH = {
    4: (4, 5, 6, 7, 9, 8), 6: (6, 9, 7, 12, 14, 13, 8, 10, 11), 8: (8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
}  # fmt: skip
_BINARY = {"i": "<i4", "u": "<u8", "d": "<f8"}
_CUT = "it is damaged, or not written to its end"


class _Numbers:
    """The numbers of a section one after the other, from text or from bytes."""

    def __init__(self, name: str, body: bytes, binary: bool) -> None:
        self.name, self.body, self.binary, self.at = name, body, binary, 0
        if not binary:
            try:
                self.values = np.array(body.split(), dtype=float)
            except ValueError:
                raise InputError(f"${name} has something else than numbers: {_CUT}.") from None

    def take(self, kind: str, count: int) -> np.ndarray:
        """The next numbers: "i" and "u" are whole ones of 4 and 8 bytes, "d" others."""
        width = np.dtype(_BINARY[kind]).itemsize if self.binary else 1
        left = (len(self.body if self.binary else self.values) - self.at) // width
        if not 0 <= count <= left:
            raise InputError(f"${self.name} has {left} numbers where {count} are announced: {_CUT}.")
        begin, self.at = self.at, self.at + width * count
        if self.binary:
            return np.frombuffer(self.body, _BINARY[kind], count, begin).astype(float if kind == "d" else np.int64)
        return self.values[begin : self.at].astype(float if kind == "d" else np.int64)

    def one(self, kind: str = "i") -> int:
        """The next number."""
        return int(self.take(kind, 1)[0])


def is_gmsh(path: str) -> bool:
    """Whether a file is one of Gmsh: Ansys has the same suffix."""
    with Path(path).open("rb") as file:
        return b"$MeshFormat" in file.read(1000)


def read_gmsh(path: str) -> FileMesh:
    """The mesh of a file with its physical groups.

    Raises
    ------
    InputError : another version, a part that is not supported, or a damaged file.
    """
    sections = {}
    raw = Path(path).read_bytes()
    at = 0
    while begin := re.compile(rb"\$(?!End)(\w+)[ \t]*\r?\n").search(raw, at):
        name = begin[1].decode()
        end = raw.find(b"$End" + begin[1], begin.end())
        if end < 0:
            raise InputError(f"${name} has no end: {_CUT}.")
        sections[name], at = raw[begin.end() : end], end + 4
    version, binary, size, *_ = [*sections.get("MeshFormat", b"").split()[:3], b"", b"", b""]
    if not re.fullmatch(rb"2(\.[0-2])?|4\.1", version):
        raise InputError(
            f'version "{version.decode(errors="replace")}" of Gmsh\'s format is not supported; save it in version 4.1: '
            "gmsh -save -format msh41 FILE."
        )
    is_binary = binary == b"1"
    if is_binary and (size != b"8" or sections["MeshFormat"].partition(b"\n")[2][:4] != b"\x01\x00\x00\x00"):
        raise InputError("its binary numbers are of a machine with another order of bytes; save it as text.")
    for name in ("PartitionedEntities", "Parametrizations"):
        if name in sections:
            raise InputError(f"${name} is not supported; save the mesh without partitions.")
    for name in ("Nodes", "Elements"):
        if name not in sections:
            raise InputError(f"the section ${name} is missing: {_CUT}.")
    mesh, groups = MeshBuilder(), defaultdict[tuple[int, int], list[int]](list)
    read = _version_4 if version == b"4.1" else _version_2
    read(sections, is_binary, mesh, groups)
    names = _names(sections.get("PhysicalNames", b""))
    dimensions_of = Counter(name for name in names.values())
    for cell, (kind, nodes) in enumerate(mesh.cells):
        count = SOLIDS.get(kind, len(nodes))
        if len(nodes) > count:
            mesh.cells[cell] = kind, nodes[:count] + [nodes[at] for at in _MIDDLES_OF_GMSH[count]]
    for (dimension, tag), cells in groups.items():
        name = names.get((dimension, tag), str(tag))
        alone = (dimension, tag) in names and dimensions_of[name] == 1
        mesh.name_cells(name if alone else f"{_DIMENSIONS[dimension]}.{name}", cells)
    return mesh.finish()


def _names(body: bytes) -> dict[tuple[int, int], str]:
    names = {}
    for line in body.decode("utf-8", "replace").splitlines()[1:]:
        words = shlex.split(line) if line.count('"') == 2 else line.split(None, 2)
        if len(words) == 3:
            names[int(words[0]), int(words[1])] = words[2]
    return names


def _node_numbers(numbers: dict[int, int], tags: np.ndarray) -> list[int]:
    try:
        return [numbers[tag] for tag in tags.tolist()]
    except KeyError as error:
        raise InputError(f"an element names node {error}, which the file does not have: {_CUT}.") from None


def _type(code: int) -> tuple[str, int, int]:
    if code not in _TYPES:
        raise InputError(f"the element type {code} is not supported; mesh with elements of first order.")
    return _TYPES[code]


def _version_2(
    sections: dict[str, bytes], binary: bool, mesh: MeshBuilder, groups: defaultdict[tuple[int, int], list[int]]
) -> None:
    counts, bodies = {}, {}
    for name in ("Nodes", "Elements"):
        first, _, bodies[name] = sections[name].partition(b"\n")  # text in binary files too
        counts[name] = int(first) if first.strip().isdigit() else -1
    if binary:
        table = np.frombuffer(bodies["Nodes"], [("tag", "<i4"), ("at", "<f8", 3)], len(bodies["Nodes"]) // 28)
        tags, points = table["tag"].astype(np.int64), table["at"]
    else:
        numbers = _Numbers("Nodes", bodies["Nodes"], binary)
        columns = numbers.take("d", 4 * (len(numbers.values) // 4)).reshape(-1, 4)
        tags, points = columns[:, 0].astype(np.int64), columns[:, 1:]
    if len(tags) != counts["Nodes"]:
        raise InputError(f"$Nodes has {len(tags)} nodes where {counts['Nodes']} are announced: {_CUT}.")
    node = dict(zip(tags.tolist(), mesh.add_points(points, tags.tolist()), strict=True))
    numbers = _Numbers("Elements", bodies["Elements"], binary)
    known: dict[tuple[int, ...], tuple[int, int]] = {}
    done = 0
    if counts["Elements"] < 0:
        raise InputError(f"$Elements does not begin with the number of elements: {_CUT}.")
    while done < counts["Elements"]:
        head = numbers.take("i", 3)
        code, of_type, tag_count = (int(one) for one in (head if binary else (head[1], 1, head[2])))
        kind, node_count, dimension = _type(code)
        for _ in range(of_type):
            row = numbers.take("i", binary + tag_count + node_count)[int(binary) :]
            nodes = _node_numbers(node, row[tag_count:])
            group = abs(int(row[0])) if tag_count else 0
            # An element of several groups stands there once for each of them.
            cell, in_group = known.get((code, *nodes), (-1, group))
            if in_group == group:
                cell = mesh.add_cell(kind, nodes)
                known[code, *nodes] = cell, group
            if group:
                groups[dimension, group].append(cell)
        done += of_type


def _version_4(
    sections: dict[str, bytes], binary: bool, mesh: MeshBuilder, groups: defaultdict[tuple[int, int], list[int]]
) -> None:
    groups_of: dict[tuple[int, int], list[int]] = {}
    if "Entities" in sections:
        numbers = _Numbers("Entities", sections["Entities"], binary)
        for dimension, count in enumerate(numbers.take("u", 4)):
            for _ in range(count):
                tag = numbers.one()
                numbers.take("d", 6 if dimension else 3)
                groups_of[dimension, tag] = [abs(int(group)) for group in numbers.take("i", numbers.one("u"))]
                if dimension:
                    numbers.take("i", numbers.one("u"))
    numbers = _Numbers("Nodes", sections["Nodes"], binary)
    blocks, *_ = numbers.take("u", 4)
    node: dict[int, int] = {}
    for _ in range(blocks):
        dimension, _, parametric = numbers.take("i", 3)
        count = numbers.one("u")
        tags = numbers.take("u", count).tolist()
        columns = 3 + (int(dimension) if parametric else 0)
        points = numbers.take("d", columns * count).reshape(-1, columns)[:, :3]
        node |= zip(tags, mesh.add_points(points, tags), strict=True)
    numbers = _Numbers("Elements", sections["Elements"], binary)
    blocks, *_ = numbers.take("u", 4)
    for _ in range(blocks):
        dimension, entity, code = numbers.take("i", 3)
        kind, node_count, _ = _type(int(code))
        rows = numbers.take("u", numbers.one("u") * (1 + node_count)).reshape(-1, 1 + node_count)
        cells = [mesh.add_cell(kind, _node_numbers(node, row)) for row in rows[:, 1:]]
        for group in groups_of.get((int(dimension), int(entity)), ()):
            groups[int(dimension), group] += cells
