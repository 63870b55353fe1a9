"""What ``explicitfe inspect`` says of a mesh file."""

from __future__ import annotations

from typing_extensions import TypedDict


class MeshArray(TypedDict):
    """An array with one number per node or element: its range, and how often it has each of its values, if these are few."""

    name: str
    of: str
    lowest: float
    highest: float
    counts: dict[str, int]


class MeshContents(TypedDict):
    """A mesh file, without nodes of no element. Lengths and volumes are in its unit; hexahedra are those made of its elements.

    ``fault`` is the sentence with which ``check`` and ``run`` refuse it; empty where they do not.
    """

    mesh: str
    nodes: int
    cells: dict[str, int]
    hexahedra: int
    lowest: list[float]
    highest: list[float]
    volume: float
    smallest_scaled_jacobian: float
    fault: str
    node_sets: dict[str, int]
    element_sets: dict[str, int]
    arrays: list[MeshArray]
