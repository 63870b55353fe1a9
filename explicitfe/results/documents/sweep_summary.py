"""Summaries of a sweep: the JSON output of ``explicitfe sweep`` and of ``explicitfe report`` for a sweep."""

from __future__ import annotations

from typing_extensions import TypedDict


class ListedMember(TypedDict):
    """A run without a row: ``member`` is its number, ``name`` a hash of its inputs, ``settings`` the values that it sets."""

    member: int
    name: str
    settings: list[str]


class SweepMembers(TypedDict):
    """``explicitfe sweep --list --json``: the runs that have no row yet."""

    sweep: str
    members: list[ListedMember]


class SweepSummary(TypedDict):
    """``explicitfe sweep --json``.

    ``members`` is the number of runs of the sweep; ``computed`` counts those of this command, ``stored`` all that have a row,
    ``statuses`` the stored ones by status. ``complete``: every run has a row. ``failures`` counts the messages of runs that did
    not finish. ``added_muscles`` are those that the runs set although the scenario does not list them. ``worker_s`` is the
    computing time of all workers, ``members_per_minute`` the throughput.
    """

    sweep: str
    scenario: str
    members: int
    stored: int
    computed: int
    complete: bool
    statuses: dict[str, int]
    failures: dict[str, int]
    added_muscles: list[str]
    workers: int
    wall_s: float
    worker_s: float
    members_per_minute: float
    files: list[str]


class SweepReport(TypedDict):
    """``explicitfe report --json`` for a sweep.

    Of the ``members`` runs, ``stored`` have a row and ``finished`` finished. The page shows ``outlines`` of them individually and
    ``scattered`` as points of a scatter plot.
    """

    report: str
    size_MB: float
    sweep: str
    members: int
    stored: int
    finished: int
    outlines: int
    scattered: int
