"""Answer of ``explicitfe compare`` for two results.

Differences are the second result minus the first. Shares are relative to the largest magnitude of the quantity in either
result, over all compared points and times.
"""

from __future__ import annotations

from pydantic import JsonValue

from explicitfe.results.documents.document import Computed, Document
from explicitfe.results.measure.document import MaterialPlace, MeasuredPart


class ComparedResult(MeasuredPart):
    """One of the results: file, title, status and size."""

    result: str
    title: str
    status: str
    nodes: int
    elements: int
    samples: int


class DifferingKey(MeasuredPart):
    """A key whose values differ; None if it is absent. A table that only one scenario has is one key."""

    key: str
    a: JsonValue
    b: JsonValue


class ComparedTimes(MeasuredPart):
    """The compared times: stored times of the first result that are within the time of the second.

    ``interpolated``: number of times at which the second was interpolated; ``left_out``: number of samples of the first outside
    the time of the second.
    """

    compared: int
    interpolated: int
    first_ms: float
    last_ms: float
    left_out: int


class ComparedPoints(MeasuredPart):
    """The points at which fields were compared.

    Attributes
    ----------
    same_mesh : whether the meshes are equal; if not, the second result is interpolated at the nodes and the element centres of
        the first, that is, at the same material points.
    nodes, elements : number of compared nodes and elements of the first result.
    left_out : number of nodes of the first result outside the mesh of the second at rest.
    """

    same_mesh: bool
    nodes: int
    elements: int
    left_out: int


class ComparedField(MeasuredPart):
    """A field that both results store.

    Attributes
    ----------
    kind : "point" or "cell".
    largest, rms : largest difference (for vectors, its length) and its root mean square over all points and times, in ``unit``.
    share : ``largest`` relative to the largest value; None if both fields are 0.
    at_ms, place : time and reference position of the largest difference; None if there is no difference.
    """

    name: str
    kind: str
    unit: str
    largest: Computed
    rms: Computed
    share: Computed | None
    at_ms: float | None
    place: MaterialPlace | None


class ComparedPoint(MeasuredPart):
    """The path of a named point that both results have.

    Attributes
    ----------
    largest_mm, share, at_ms : as for a field.
    forward_mm, up_mm, right_mm : the difference at the last time.
    """

    largest_mm: Computed
    share: Computed | None
    at_ms: float | None
    forward_mm: Computed
    up_mm: Computed
    right_mm: Computed


class ComparedHistory(MeasuredPart):
    """A column of the history that both results have; attributes as for :class:`ComparedField`."""

    name: str
    unit: str
    largest: Computed
    share: Computed | None
    at_ms: float | None


class DifferingMeasure(MeasuredPart):
    """A measure that differs at the last time, by its key in ``explicitfe measure --json``."""

    measure: str
    a: JsonValue
    b: JsonValue


class Comparison(Document, MeasuredPart):
    """Differences between two results.

    Attributes
    ----------
    identical : whether meshes, times, fields and histories are bitwise identical.
    tolerance : as given, or None; ``within_tolerance`` is whether no displacement differs by more, relative to the largest one.
    differing_keys : of the scenarios, except texts such as the title.
    differing_provenance : versions, commit and machine; not the start time.
    measures : empty for indentations, whose curve is in ``history``.
    """

    a: ComparedResult
    b: ComparedResult
    identical: bool
    tolerance: float | None
    within_tolerance: bool | None
    differing_keys: list[DifferingKey]
    differing_provenance: list[DifferingKey]
    times: ComparedTimes
    points: ComparedPoints
    fields: list[ComparedField]
    named_points: dict[str, ComparedPoint]
    history: list[ComparedHistory]
    measures: list[DifferingMeasure]
