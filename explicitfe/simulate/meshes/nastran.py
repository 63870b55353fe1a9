"""Nastran's bulk data: nodes, solid elements and shells, in small, large and free fields (MSC Nastran quick reference guide)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.simulate.meshes.content import SOLIDS, FileMesh, MeshBuilder

# Card -> its elements by the number of their nodes.
_KINDS = {
    "CTETRA": {4: "tetra", 10: "tetra10"}, "CPENTA": {6: "wedge", 15: "wedge15"}, "CHEXA": {8: "hexahedron", 20: "hexahedron20"},
    "CPYRAM": {5: "pyramid", 13: "pyramid13"}, "CTRIA3": {3: "triangle"}, "CQUAD4": {4: "quad"},
}  # fmt: skip
_SOLID_CARD = re.compile(r"C(TETRA|PENTA|HEX|PYR|SOLID)")
# Nastran's order of the nodes of second order, in that of SOLID_EDGES: upright edges come before those of the upper face.
_ORDERS = {"wedge15": [*range(9), *range(12, 15), *range(9, 12)], "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)]}


def read_nastran(path: str) -> FileMesh:
    """The mesh of a file; ``cell_data["nastran:ref"]`` are the properties of its elements.

    Raises
    ------
    InputError : nodes in a coordinate system of their own, or a line that cannot be read or is not supported; with its number.
    """
    points: dict[int, list[float]] = {}
    cells: list[tuple[str, int, list[int]]] = []
    for line, name, fields in _cards(Path(path)):
        where = f"{Path(path).name}, line {line}, {name}"
        if name in ("GRID", "GRDSET") and fields[1] not in ("", "0"):
            raise InputError(
                f"{where}: the nodes are in the coordinate system {fields[1]}, which is not supported; export them in the "
                "basic system (CP = 0)."
            )
        if name == "INCLUDE" or (_SOLID_CARD.match(name) and name not in _KINDS):
            raise InputError(f"{where}: this card is not supported; export the mesh as one file of {', '.join(_KINDS)}.")
        try:
            if name == "GRID":
                points[int(fields[0])] = [_number(word) for word in fields[2:5]]
            elif name in _KINDS:
                nodes = [int(word) for word in fields[2 : 2 + max(_KINDS[name])] if word]
                cells.append((_KINDS[name][len(nodes)], int(fields[1] or 0), nodes))
        except (ValueError, KeyError):
            raise InputError(f"{where}: this card has too few numbers, or wrong ones; export the file again.") from None
    mesh = MeshBuilder()
    at = dict(zip(points, mesh.add_points(np.array([*points.values()]).reshape(-1, 3), [*points]), strict=True))
    for kind, _, nodes in cells:
        missing = [node for node in nodes if node not in at]
        if missing:
            raise InputError(f"an element names node {missing[0]}, which the file does not have.")
        order = _ORDERS.get(kind, range(len(nodes)))
        mesh.add_cell(kind, [at[nodes[k]] for k in order])
    content = mesh.finish()
    content.cell_data["nastran:ref"] = np.array([property_ for kind, property_, _ in cells if kind in SOLIDS])
    return content


def _cards(path: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Line, name and fields of each card, with those of the lines that continue it; lines before the bulk data are cards too."""
    text = path.read_text(encoding="utf-8", errors="replace").upper().partition("\nENDDATA")[0]
    card: tuple[int, str, list[str]] = (0, "", [])
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.partition("$")[0].expandtabs(8).rstrip()
        if not line:
            continue
        head = line.partition(",")[0][:8].strip()
        width = 16 if "*" in head else 8
        words = line.split(",")[1:] if "," in line else [line[k : k + width] for k in range(8, 72, width)]
        fields = [*(word.strip() for word in words), *[""] * 8][: 64 // width]
        if head[:1] in ("", "+", "*"):
            card[2].extend(fields)
        else:
            yield card
            card = (number, head.rstrip("* "), fields)
    yield card


def _number(word: str) -> float:
    """Nastran's 1.5-3 is 0.0015, and an empty field 0."""
    return float(re.sub(r"(?<=[\d.])E?([+-])", r"E\1", word.replace("D", "E")) or 0.0)
