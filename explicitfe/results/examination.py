"""What ``explicitfe doctor`` says of an installation and its machine."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

State = Literal["good", "attention", "absent"]
"""Absent is what only some commands need; attention is what will be noticed."""


class Finding(TypedDict):
    """One thing that was looked at: its state, what it is, and what to do, empty where there is nothing to do."""

    name: str
    state: State
    value: str
    advice: str


class Examination(TypedDict):
    """All that was looked at, and how many things ask for attention."""

    findings: list[Finding]
    attention: int
