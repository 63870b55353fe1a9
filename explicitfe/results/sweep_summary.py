"""What a sweep came to, and which members it has: what ``explicitfe sweep`` prints with ``--json``."""

from __future__ import annotations

from typing_extensions import TypedDict


class ListedMember(TypedDict):
    """A member that is to be computed: its number, the name that follows from what it computes, and what it sets."""

    member: int
    name: str
    settings: list[str]


class SweepMembers(TypedDict):
    """The members of ``explicitfe sweep --list`` that have no row yet."""

    sweep: str
    members: list[ListedMember]


class SweepSummary(TypedDict):
    """What ``explicitfe sweep --json`` prints.

    ``computed`` of the ``members`` by this command; ``stored`` by all so far; ``statuses`` counts these. ``complete``: every
    member has a row. ``failures`` counts the messages of those that did not finish. ``worker_s`` is the time of all workers.
    """

    sweep: str
    scenario: str
    members: int
    stored: int
    computed: int
    complete: bool
    statuses: dict[str, int]
    failures: dict[str, int]
    workers: int
    wall_s: float
    worker_s: float
    members_per_minute: float
    files: list[str]


class SweepReport(TypedDict):
    """What ``explicitfe report`` wrote of a sweep.

    ``stored`` of the ``members`` have a row, and ``finished`` of these came to their end; the page draws ``outlines`` of them one
    by one, and ``scattered`` as dots.
    """

    report: str
    size_MB: float
    sweep: str
    members: int
    stored: int
    finished: int
    outlines: int
    scattered: int
