"""What a result file holds, as ``explicitfe inspect --json`` answers it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict

from explicitfe.results.layout import Quantity
from explicitfe.results.provenance import Provenance
from explicitfe.results.run_summary import PointAtRest


class StoredQuantity(TypedDict):
    """A stored quantity as ``inspect`` names it."""

    name: str
    unit: str
    components: int
    description: str


class StoredField(StoredQuantity):
    """A stored field: ``kind`` is ``"point"`` or ``"cell"``."""

    kind: str


class StoredRestart(TypedDict):
    """From where a run can go on: after how many samples, stored when (ISO 8601), and the command that does it."""

    samples: int
    stored_utc: str | None
    command: str


class ResultContents(TypedDict):
    """What a result file holds: the answer of ``explicitfe inspect --json``.

    ``time_s`` has the first and the last stored time, ``every_s`` the mean time between samples, ``last`` the last row of the
    history; ``node_sets`` says how many nodes each set has; ``restart`` is None where nothing is left to go on with. ``summary``
    and ``model`` are as :class:`Result` gives them.
    """

    path: str
    status: str
    live: bool
    message: str
    summary: Mapping[str, Any]
    nodes: int
    elements: int
    steps: int
    time_s: list[float]
    every_s: float | None
    fields: list[StoredField]
    history: list[StoredQuantity]
    history_rows: int
    last: dict[str, float | list[float]]
    node_sets: dict[str, int]
    named_points: dict[str, PointAtRest]
    scenario_sha256: str
    model: Mapping[str, Any]
    provenance: Provenance
    restart: StoredRestart | None


def stored_quantity(name: str, quantity: Quantity) -> StoredQuantity:
    """A quantity of the history."""
    return {
        "name": name,
        "unit": quantity.unit,
        "components": quantity.components,
        "description": quantity.description,
    }


def stored_field(name: str, kind: str, quantity: Quantity) -> StoredField:
    """A field of points or cells."""
    return {**stored_quantity(name, quantity), "kind": kind}
