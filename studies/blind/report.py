"""What the scorer reads of a report of ``close-loop``; every key may be missing, as a case can crash."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from typing_extensions import TypedDict

from studies.blind.truth import Truth


class ReportedCurve(TypedDict, total=False):
    """How well one curve is predicted; ``rmse`` in the unit of its rows."""

    split: str
    rmse: float


class ReportedHoldout(TypedDict, total=False):
    """The error of all curves that were held out, as a share of their peak."""

    nrmse: float | None


class ReportedErrors(TypedDict, total=False):
    """The errors of a fit."""

    curves: Mapping[str, ReportedCurve]
    holdout: ReportedHoldout | None


class ReportedFit(TypedDict, total=False):
    """A fitted model: its errors, and its parameters. An entry has ``ci95``; a constant has an entry for each specimen."""

    error: ReportedErrors
    parameters: Mapping[str, Any]


class ToolReport(TypedDict, total=False):
    """The verdict and the models before and after; ``problem`` says why there is none; ``sure`` is the
    probability that the verdict is right."""

    verdict: str
    remainder: str
    effects: list[str]
    ambiguous_with: list[str]
    problem: str
    sure: float | None
    baseline: ReportedFit
    final: ReportedFit
    provenance: Mapping[str, Any]


class ScoredCase(TypedDict):
    """A case: its truth, its report, the word for what the report is worth, and the time that it took."""

    case: str
    truth: Truth
    report: ToolReport
    outcome: str
    wall_s: float | None
