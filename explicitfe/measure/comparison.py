"""What ``explicitfe compare`` answers: how two results differ.

A difference is that of the second result less the first. Shares are of the largest magnitude that either result has of the same
quantity, where and when both were compared.
"""

from __future__ import annotations

from pydantic import JsonValue

from explicitfe.measure.document import MaterialPlace, MeasuredPart
from explicitfe.results.document import Computed, Document


class ComparedResult(MeasuredPart):
    """One of the two: its file, how it ended, and what it holds."""

    result: str
    title: str
    status: str
    nodes: int
    elements: int
    samples: int


class DifferingKey(MeasuredPart):
    """A key that has not the same value in both; None where it is not given."""

    key: str
    a: JsonValue
    b: JsonValue


class ComparedTimes(MeasuredPart):
    """The times that were compared: those that the first result stores and that lie within those of the second.

    ``interpolated``: at how many of them the second was taken between two of its samples; ``left_out``: samples of the first
    outside them.
    """

    compared: int
    interpolated: int
    first_ms: float
    last_ms: float
    left_out: int


class ComparedPoints(MeasuredPart):
    """Where fields were compared.

    Attributes
    ----------
    same_mesh : node by node and element by element; if not, the second result is interpolated at the nodes and the centres of
        the elements of the first, as points of the material.
    nodes, elements : of the first result that were compared.
    left_out : nodes of the first result that lie outside the second one's mesh at rest.
    """

    same_mesh: bool
    nodes: int
    elements: int
    left_out: int


class ComparedField(MeasuredPart):
    """A field that both store.

    Attributes
    ----------
    kind : "point" or "cell".
    largest, rms : the largest difference, of vectors the length of the difference, and its root mean square over all points and
        times, in ``unit``.
    share : ``largest`` as a share; None where both fields are 0.
    at_ms, place : when and where, in the reference shape, the difference is largest; None where there is none.
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
    """A named point that both have: its path.

    Attributes
    ----------
    largest_mm, share, at_ms : as of a field.
    forward_mm, up_mm, right_mm : the difference at the last time.
    """

    largest_mm: Computed
    share: Computed | None
    at_ms: float | None
    forward_mm: Computed
    up_mm: Computed
    right_mm: Computed


class ComparedHistory(MeasuredPart):
    """A column of the history that both have; as :class:`ComparedField`."""

    name: str
    unit: str
    largest: Computed
    share: Computed | None
    at_ms: float | None


class DifferingMeasure(MeasuredPart):
    """A measure at the last time that is not the same, by its keys in ``explicitfe measure --json``."""

    measure: str
    a: JsonValue
    b: JsonValue


class Comparison(Document, MeasuredPart):
    """How two results differ.

    Attributes
    ----------
    identical : whether meshes, times, fields and histories are the same to the last bit.
    tolerance : as it was given; None: none was. ``within_tolerance`` says whether no displacement differs by a larger share.
    differing_keys : of the scenarios, words such as the title left out.
    differing_provenance : versions, commit and machine; not the start time.
    measures : empty for indentations, whose curve stands in ``history``.
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
