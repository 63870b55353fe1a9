"""What a result file holds: its parts as the reader gives them, and as ``explicitfe inspect --json`` answers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from typing_extensions import TypedDict

from explicitfe.results.documents.document import Computed
from explicitfe.results.documents.run_summary import (
    IndentationModelDescription,
    IndentationSummary,
    PointAtRest,
    TransientModelDescription,
    TransientSummary,
)
from explicitfe.results.files.layout import Quantity
from explicitfe.results.files.provenance import Provenance


class FieldInfo(NamedTuple):
    """A stored field: ``kind`` is ``"point"`` or ``"cell"``; ``quantity`` has unit, components and description."""

    kind: str
    quantity: Quantity


class RestartState(NamedTuple):
    """The state to go on from.

    Attributes
    ----------
    sequence : counts the states that the run stored.
    stored_at : when, unix time in s; None in files of format 2 and before.
    arrays : name -> array.
    """

    sequence: int
    stored_at: float | None
    arrays: dict[str, np.ndarray]


class StoredBone(NamedTuple):
    """The surface of a bone: ``points`` (k, 3) m, ``triangles`` (m, 3), counter-clockwise seen from outside the bone."""

    points: np.ndarray
    triangles: np.ndarray


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


class NoSummary(TypedDict, total=False):
    """What stands for the summary of a run that has not ended: nothing."""

    warnings: list[str]


class ResultContents(TypedDict):
    """What a result file holds: the answer of ``explicitfe inspect --json``.

    ``time_s`` has the first and the last stored time, ``every_s`` the mean time between samples, ``last`` the last row of the
    history; ``node_sets`` says how many nodes each set has; ``restart`` is None where nothing is left to go on with. ``summary``
    and ``model`` are as :class:`Result` gives them: those of a result of an earlier version may lack keys.
    """

    path: str
    status: str
    live: bool
    message: str
    summary: TransientSummary | IndentationSummary | NoSummary
    nodes: int
    elements: int
    steps: int
    time_s: list[float]
    every_s: float | None
    fields: list[StoredField]
    history: list[StoredQuantity]
    history_rows: int
    last: dict[str, Computed | list[Computed]]
    node_sets: dict[str, int]
    named_points: dict[str, PointAtRest]
    scenario_sha256: str
    model: TransientModelDescription | IndentationModelDescription
    provenance: Provenance
    restart: StoredRestart | None
