"""Abaqus and CalculiX input files: the mesh with its parts, instances, sets and surfaces (Abaqus keyword reference).

Materials, steps and loads are not read. A keyword that generates or moves nodes in a way that is not read is refused.
"""

from __future__ import annotations

import csv
import operator
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, reduce
from pathlib import Path

import numpy as np

from explicitfe.platform.errors import InputError, nearest
from explicitfe.simulate.meshes.content import SOLIDS, FileMesh, MeshBuilder

# Nodes of continuum elements by their number -> how the package calls them.
_SOLID = re.compile(r"C3D(\d+)[A-Z]*$")
_KINDS = {
    4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20", 27: "hexahedron27",
}  # fmt: skip
# Shells, membranes, rigid and plane elements, lines, points and connectors: without the volume of tissue.
_NO_SOLID = re.compile(
    r"(S\d|STRI|SAX|SFM|M3D|MCL|MAX|R3D|R2D|RAX|RB|CPS|CPE|CAX|CGAX|T\dD|B\d|PIPE|ELBOW|FRAME|SPRING|DASHPOT|MASS|ROTARYI|CONN|"
    r"DCOUP|HEATCAP|DS\d|DC[12]D|F3D|GAP|JOINT|ITS|ITT)"
)
_REFUSED = {
    "NGEN": "generates nodes", "NFILL": "generates nodes", "NCOPY": "generates nodes", "NMAP": "moves nodes",
    "ELGEN": "generates elements", "ELCOPY": "generates elements", "SYSTEM": "moves the nodes that follow",
    "SYMMETRIC MODEL GENERATION": "generates the mesh", "PARAMETER": "replaces numbers by formulas",
    "IMPORT": "takes the mesh from another job",
}  # fmt: skip
# Faces of elements by the number of their corners.
_FACES = {
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
}
_MOST_INCLUDES = 10  # one within the other


@dataclass
class _Block:
    """A keyword line with its parameters, and the lines of data that follow it."""

    file: Path
    line: int
    head: str
    data: list[tuple[int, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        words = next(csv.reader([self.head[1:]], skipinitialspace=True), []) or [""]
        pairs = [word.partition("=") for word in words[1:] if word.strip()]
        self.keyword = " ".join(words[0].split()).upper()
        self.parameters = {" ".join(key.split()).upper(): value.strip().strip('"') for key, _, value in pairs}

    def fault(self, words: str, line: int | None = None) -> InputError:
        return InputError(f"{self.file.name}, line {line or self.line}, *{self.keyword.capitalize()}: {words}")

    def value(self, key: str) -> str:
        if not self.parameters.get(key):
            raise self.fault(f"{key.capitalize()}= is missing; export the file again.")
        return self.parameters[key]


@dataclass
class _Scope:
    """What stands in a part, an instance, or outside of both."""

    name: str = ""
    nodes: dict[int, np.ndarray] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    nsets: dict[str, list[tuple[_Block, str, list[str]]]] = field(default_factory=dict)
    elsets: dict[str, list[tuple[_Block, str, list[str]]]] = field(default_factory=dict)
    surfaces: dict[str, _Block] = field(default_factory=dict)
    part: _Scope | None = None
    moves: Callable[[np.ndarray], np.ndarray] = lambda points: points
    node_at: dict[int, int] = field(default_factory=dict)
    element_at: dict[int, int] = field(default_factory=dict)

    def add(self, sets: str, name: str, block: _Block, instance: str, items: list[str]) -> None:
        table = getattr(self, sets)
        known = next((one for one in table if one.upper() == name.upper()), name)
        table.setdefault(known, []).append((block, instance, items))


def read_abaqus(path: str) -> FileMesh:
    """The mesh of an input file: all parts as often as instances place them, and the sets of each.

    A set of an instance is called ``INSTANCE.SET``, and ``SET`` is that of all instances where no other one has that name.

    Raises
    ------
    InputError : a line that cannot be read or is not supported; with its number.
    """
    root, scopes = _parse(Path(path))
    mesh = MeshBuilder()
    for scope in (root, *scopes.values()):
        own = [one for one in (scope.part, scope) if one is not None]
        points = scope.moves(np.array([xyz for one in own for xyz in one.nodes.values()]).reshape(-1, 3))
        labels = [label for one in own for label in one.nodes]
        scope.node_at = dict(zip(labels, mesh.add_points(points, labels), strict=True))
        for one in own:
            for label, (kind, nodes) in one.elements.items():
                missing = [node for node in nodes if node not in scope.node_at]
                if missing:
                    raise InputError(f"element {label}{_of(scope)} names node {missing[0]}, which the file does not have.")
                scope.element_at[label] = mesh.add_cell(kind, [scope.node_at[node] for node in nodes])
    sets = _Sets(mesh, scopes)
    for scope in (root, *scopes.values()):
        sets.name_all(scope)
    if scopes:
        mesh.labels.clear()  # each part has its own
    return mesh.finish()


def _of(scope: _Scope) -> str:
    return f" of {scope.name}" if scope.name else ""


def _parse(path: Path) -> tuple[_Scope, dict[str, _Scope]]:
    """What stands outside of parts, and the instances by name; the parts where nothing places them."""
    root = scope = _Scope()
    parts: dict[str, _Scope] = {}
    instances: dict[str, _Scope] = {}
    for block in _blocks(path):
        keyword = block.keyword
        if keyword in _REFUSED:
            raise block.fault(f"this {_REFUSED[keyword]}, which is not supported; let your program write the mesh out in full.")
        if keyword == "PART":
            scope = parts[block.value("NAME").upper()] = _Scope(block.value("NAME"))
        elif keyword == "INSTANCE":
            scope = instances[block.value("NAME").upper()] = _instance(block, parts)
        elif keyword in ("END PART", "END INSTANCE"):
            scope = root
        elif keyword == "NODE":
            _nodes(block, scope)
        elif keyword == "ELEMENT":
            _elements(block, scope)
        elif keyword in ("NSET", "ELSET"):
            _set(block, scope, keyword)
        elif keyword == "SURFACE" and block.parameters.get("TYPE", "ELEMENT").upper() in ("ELEMENT", "NODE"):
            scope.surfaces[block.value("NAME")] = block
    return root, instances or parts


def _blocks(path: Path, depth: int = 0) -> Iterator[_Block]:
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    block: _Block | None = None
    head, begun = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if head or line.startswith("*"):
            if not head and block is not None:
                yield block
            head, begun = head + line, begun or number
            if head.endswith(","):  # the keyword line continues
                continue
            block, head, begun = _Block(path, begun, head), "", 0
            if block.keyword == "INCLUDE":
                if depth == _MOST_INCLUDES:
                    raise block.fault("this includes itself; remove it.")
                yield from _blocks(_input_file(block), depth + 1)
        elif block is None:
            raise InputError(f"{path.name}, line {number}: there is no keyword before it, so that this is no Abaqus input file.")
        else:
            block.data.append((number, line))
    if head:
        raise InputError(f"{path.name}, line {begun}: the keyword line ends with a comma, and nothing follows.")
    if block is not None:
        yield block


def _input_file(block: _Block) -> Path:
    path = block.file.parent / block.value("INPUT")
    if not path.is_file():
        raise block.fault(f'the file "{block.value("INPUT")}" does not exist; put it next to {block.file.name}.')
    return path


def _data(block: _Block) -> list[tuple[int, str]]:
    if "INPUT" not in block.parameters:
        return block.data
    lines = enumerate(_input_file(block).read_text(encoding="latin-1").splitlines(), 1)
    return [(block.line, line.strip()) for _, line in lines if line.strip() and not line.startswith("**")]


def _numbers(block: _Block, number: int, words: list[str]) -> list[float]:
    try:
        return [float(re.sub("[dD]", "e", word)) if word.strip() else 0.0 for word in words]
    except ValueError:
        raise block.fault(f'"{",".join(words)}" has something else than numbers.', number) from None


def _integers(block: _Block, number: int, line: str) -> list[int]:
    try:
        return [int(word) for word in line.split(",") if word.strip()]
    except ValueError:
        raise block.fault(f'"{line}" has something else than whole numbers.', number) from None


def _nodes(block: _Block, scope: _Scope) -> None:
    if block.parameters.get("SYSTEM", "R").upper() != "R":
        raise block.fault("cylindrical or spherical coordinates are not supported; export the mesh in rectangular ones.")
    labels = []
    for number, line in _data(block):
        label, *words = line.split(",")
        xyz = np.zeros(3)
        values = _numbers(block, number, words[:3])
        xyz[: len(values)] = values
        (at,) = _integers(block, number, label) or (0,)
        if at in scope.nodes and not np.array_equal(scope.nodes[at], xyz):
            raise block.fault(f"node {at}{_of(scope)} is defined twice, in two places; remove one of them.", number)
        scope.nodes[at] = xyz
        labels.append(str(at))
    if "NSET" in block.parameters:
        scope.add("nsets", block.value("NSET"), block, "", labels)


def _elements(block: _Block, scope: _Scope) -> None:
    written = block.value("TYPE").upper()
    solid = _SOLID.match(written)
    count = int(solid[1]) if solid else 0
    if not (count in _KINDS or _NO_SOLID.match(written)):
        raise block.fault(f"the element type {written} is not supported; mesh the body with C3D8 or C3D4.")
    kind, labels, waiting = _KINDS.get(count, "other"), [], list[int]()
    for number, line in _data(block):
        waiting += _integers(block, number, line)
        if (len(waiting) < count + 1 if count else line.endswith(",")) or not waiting:
            continue
        if count and len(waiting) > count + 1:
            raise block.fault(f"element {waiting[0]} does not have the {count} nodes of the type {written}.", number)
        label, *nodes = waiting
        if label in scope.elements:
            raise block.fault(f"element {label}{_of(scope)} is defined twice; remove one of them.", number)
        scope.elements[label], waiting = (kind, nodes), []
        labels.append(str(label))
    if waiting:
        raise block.fault(f"element {waiting[0]} does not have the {count} nodes of the type {written}.", number)
    if "ELSET" in block.parameters:
        scope.add("elsets", block.value("ELSET"), block, "", labels)


def _set(block: _Block, scope: _Scope, keyword: str) -> None:
    items: list[str] = []
    for number, line in block.data:
        if "GENERATE" in block.parameters:
            first, last, *step = _integers(block, number, line) if line.count(",") else (0, -1)
            if last < first or (step and step[0] < 1):
                raise block.fault(f'"{line}" is not first, last, increment.', number)
            items += map(str, range(first, last + 1, *(step or [1])))
        else:
            items += [word.strip().strip('"') for word in line.split(",") if word.strip()]
    instance = block.parameters.get("INSTANCE", "")
    if keyword == "NSET" and "ELSET" in block.parameters:
        items.append("elset " + block.value("ELSET"))
    scope.add(f"{keyword.lower()}s", block.value(keyword), block, instance, items)


def _instance(block: _Block, parts: dict[str, _Scope]) -> _Scope:
    name, part = block.value("NAME"), block.value("PART")
    if part.upper() not in parts:
        raise block.fault(f'there is no part "{part}"; {nearest(part, [one.name for one in parts.values()])}')
    rows = [_numbers(block, number, line.split(",")) for number, line in block.data]
    shift = np.zeros(3)
    if rows:
        shift[: len(rows[0][:3])] = rows[0][:3]
    if len(rows) < 2:
        return _Scope(name, part=parts[part.upper()], moves=lambda points: points + shift)
    if len(rows[1]) != 7:
        raise block.fault("a rotation needs two points of its axis and an angle: seven numbers.", block.data[1][0])
    first, axis, angle = np.array(rows[1][:3]), np.subtract(rows[1][3:6], rows[1][:3]), np.radians(rows[1][6])
    if not axis.any():
        raise block.fault("the two points of the axis of rotation are the same.", block.data[1][0])
    axis = axis / np.linalg.norm(axis)
    cross = np.cross(axis, np.eye(3)).T
    turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return _Scope(name, part=parts[part.upper()], moves=lambda points: first + (points + shift - first) @ turn.T)


class _Sets:
    """The sets of a file as numbers of nodes and elements."""

    def __init__(self, mesh: MeshBuilder, scopes: dict[str, _Scope]) -> None:
        self.mesh, self.scopes = mesh, scopes

    def name_all(self, scope: _Scope) -> None:
        """Name the sets of a part, an instance, or what stands outside of these."""
        for one in (scope.part, scope):
            for name in () if one is None else one.nsets:
                self.mesh.name_nodes(name, self._members(scope, "nsets", name), scope.name)
            for name in () if one is None else one.elsets:
                self.mesh.name_cells(name, self._members(scope, "elsets", name), scope.name)
            for name, block in () if one is None else one.surfaces.items():
                self.mesh.name_nodes(name, self._surface(scope, block), scope.name)

    def _members(self, scope: _Scope, sets: str, name: str, within: tuple[str, ...] = ()) -> list[int]:
        entries = [
            entry
            for one in (scope.part, scope)
            for known, of_name in (() if one is None else getattr(one, sets).items())
            if known.upper() == name.upper()
            for entry in of_name
        ]
        members: dict[int, None] = {}
        for block, instance, items in entries:
            where = self._scope(block, instance) if instance else scope
            for item in items:
                members |= dict.fromkeys(self._item(block, where, sets, item, (*within, name.upper())))
        return list(members)

    def _item(self, block: _Block, scope: _Scope, sets: str, item: str, within: tuple[str, ...]) -> list[int]:
        if item.startswith("elset "):
            return [node for cell in self._item(block, scope, "elsets", item[6:], ()) for node in self.mesh.cells[cell][1]]
        if item.lstrip("-").isdigit():
            at = scope.node_at if sets == "nsets" else scope.element_at
            if int(item) not in at:
                what = "node" if sets == "nsets" else "element"
                raise block.fault(f"{what} {item}{_of(scope)} does not exist; correct the set.")
            return [at[int(item)]]
        names = [name for one in (scope.part, scope) if one is not None for name in getattr(one, sets)]
        if item.upper() in map(str.upper, names):
            if item.upper() in within:
                raise block.fault(f'the set "{item}" contains itself; correct it.')
            return self._members(scope, sets, item, within)
        if "." in item:
            instance, _, member = item.partition(".")
            return self._item(block, self._scope(block, instance), sets, member, ())
        raise block.fault(f'there is no set "{item}"{_of(scope)}; {nearest(item, names)}')

    def _scope(self, block: _Block, name: str) -> _Scope:
        if name.upper() not in self.scopes:
            raise block.fault(f'there is no instance "{name}"; {nearest(name, [one.name for one in self.scopes.values()])}')
        return self.scopes[name.upper()]

    def _surface(self, scope: _Scope, block: _Block) -> list[int]:
        """Nodes of a surface; of solid elements without the label of a face, those of their free faces."""
        nodes: list[int] = []
        if "COMBINE" in block.parameters:
            names = [word.strip().strip('"') for _, line in block.data for word in line.split(",") if word.strip()]
            wrong = [name for name in names if name not in scope.surfaces or scope.surfaces[name] is block]
            if wrong or not names:
                raise block.fault(f'there is no surface "{", ".join(wrong)}" to combine; {nearest(wrong[0], scope.surfaces)}')
            how = {"INTERSECTION": operator.and_, "DIFFERENCE": operator.sub}
            members = [set(self._surface(scope, scope.surfaces[name])) for name in names]
            return sorted(reduce(how.get(block.value("COMBINE").upper(), operator.or_), members))
        for number, line in block.data:
            item, face, *_ = [*(word.strip().strip('"') for word in line.split(",")), "", ""]
            if block.parameters.get("TYPE", "").upper() == "NODE":
                nodes += self._item(block, scope, "nsets", item, ())
                continue
            for cell in self._item(block, scope, "elsets", item, ()):
                faces = self._faces(cell)
                if faces and face:
                    side = int(face[1]) - 1 if re.fullmatch("[sS][1-6]", face) else -1
                    if not 0 <= side < len(faces):
                        raise block.fault(f'"{face}" is no face of element {item}; correct the surface.', number)
                    faces = faces[side : side + 1]
                elif faces:
                    faces = [corners for corners in faces if self._elements_at[frozenset(corners)] == 1]
                nodes += [node for corners in faces for node in corners] if self._faces(cell) else self.mesh.cells[cell][1]
        return nodes

    def _faces(self, cell: int) -> list[list[int]]:
        kind, nodes = self.mesh.cells[cell]
        return [[nodes[at] for at in face] for face in _FACES.get(SOLIDS.get(kind, 0), ())]

    @cached_property
    def _elements_at(self) -> Counter[frozenset[int]]:
        """Number of elements at each face, by its corners."""
        return Counter(frozenset(corners) for cell in range(len(self.mesh.cells)) for corners in self._faces(cell))
