"""The answer of ``explicitfe doctor`` on an installation and its machine."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

State = Literal["good", "attention", "absent"]
"""Absent: needed by some commands only; attention: limits some runs."""


class Finding(TypedDict):
    """One check: its state, its value, and advice, which may be empty."""

    name: str
    state: State
    value: str
    advice: str


class Examination(TypedDict):
    """All checks, and the number of those that need attention."""

    findings: list[Finding]
    attention: int
