"""How good a report is, once the truth is known: one word for each case."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from typing_extensions import TypedDict

from studies.blind.mechanism import mechanisms
from studies.blind.report import ToolReport
from studies.blind.truth import Truth

ALARMS = ("effect-found", "ambiguous", "unexplained")
# By so many standard deviations the mean square of noise alone may exceed its expectation.
LARGEST_RMS_EXCESS_SDS = 3.0
LIMITED = "limited-by-numerics"  # The tool says that its numerics are no better than what is left: no alarm, and no answer.
# The words, in the order of the tables.
SINGLE = (
    "right",
    "confidently wrong",
    "ambiguous, true named",
    "ambiguous, true not named",
    "missed",
    "unexplained",
    LIMITED,
    "failed",
)
DOUBLE = (
    "both",
    "one, remainder says so",
    "one, said to be all",
    "ambiguous",
    "confidently wrong",
    "missed",
    "unexplained",
    LIMITED,
    "failed",
)
OUTSIDE = (
    "named",
    "unexplained",
    "an effect that predicts at the floor",
    "confidently wrong",
    "ambiguous",
    "missed",
    LIMITED,
    "failed",
)
SILENT = ("no-missing-effect", LIMITED)
CONTROL = (*SILENT, *ALARMS, "failed")
WORDS = {"control": CONTROL, "single": SINGLE, "double": DOUBLE, "outside": OUTSIDE}


class Coverage(TypedDict):
    """The 95 % interval of a parameter of a recovered model, and its width relative to the true value."""

    name: str
    true: float
    low: float
    high: float
    covers: bool
    width: float | None


def outcome(report: ToolReport, truth: Truth) -> str:
    """One of the words of the case's kind. A report without a verdict comes from a crash."""
    verdict = report.get("verdict", "failed")
    if verdict == "failed":
        return "failed"
    kind = truth["kind"]
    if kind == "control":
        return verdict
    if verdict == "no-missing-effect":
        return "missed"
    if verdict in ("unexplained", LIMITED):
        return verdict
    if kind == "outside":
        return _outside(report, truth)
    return (_single if kind == "single" else _double)(report, mechanisms(truth["effects"]))


def named_effects(report: ToolReport) -> set[str]:
    """The mechanisms of all effects that a verdict names."""
    return mechanisms(report.get("effects", ())) | mechanisms(report.get("ambiguous_with", ()))


def _single(report: ToolReport, true: set[str]) -> str:
    if report["verdict"] == "ambiguous":
        return "ambiguous, true named" if true <= named_effects(report) else "ambiguous, true not named"
    return "right" if mechanisms(report["effects"]) == true else "confidently wrong"


def _double(report: ToolReport, true: set[str]) -> str:
    named = mechanisms(report["effects"])
    if report["verdict"] == "ambiguous":
        return "ambiguous"
    if named == true:
        return "both"
    if not named < true:
        return "confidently wrong"
    return "one, said to be all" if report.get("remainder") == "at-floor" else "one, remainder says so"


def _outside(report: ToolReport, truth: Truth) -> str:
    if report["verdict"] == "ambiguous":
        return "ambiguous"
    if set(report["effects"]) == {truth.get("sub")}:  # The library has learnt what was outside of it.
        return "named"
    return "an effect that predicts at the floor" if predicts_held_out(report, truth) else "confidently wrong"


def predicts_held_out(report: ToolReport, truth: Truth) -> bool:
    """Whether every held-out curve is predicted up to its true noise, and there is one."""
    curves = report.get("final", {}).get("error", {}).get("curves", {})
    held = {name: curve["rmse"] for name, curve in curves.items() if curve.get("split") == "holdout"}
    square = truth["noise"]["rho"] ** 2
    for name, rmse in held.items():
        # n correlated normal numbers have a mean square that scatters as that of fewer independent ones.
        free = truth["rows"][name] * (1.0 - square) / (1.0 + square)
        if rmse > truth["noise"]["sd"] * math.sqrt(1.0 + LARGEST_RMS_EXCESS_SDS * math.sqrt(2.0 / free)):
            return False
    return bool(held)


def recovers_truth(report: ToolReport, truth: Truth) -> bool:
    """Whether the final model has the effects of the truth, so that its parameters mean the same."""
    if truth["kind"] == "outside" or truth.get("wrong"):
        return False
    verdict = report.get("verdict")
    if truth["kind"] == "control":
        return verdict == "no-missing-effect"
    return verdict == "effect-found" and set(report["effects"]) == set(truth["effects"])


def intervals(report: ToolReport, truth: Truth) -> list[Coverage]:
    """Whether the intervals of a recovered model cover the true values of its parameters."""
    rows: list[Coverage | None] = []
    for name, entry in report.get("final", {}).get("parameters", {}).items():
        if name in ("C10_Pa", "C20_Pa"):
            for value in entry.values():
                rows.append(_coverage(name, truth["C10_Pa"] if name == "C10_Pa" else truth["C20_Pa"], value))
            continue
        effect, _, parameter = name.partition(".")
        true = truth["effects"].get(effect, {}).get(parameter)
        if isinstance(true, list):
            true = true[0] if len(true) == 1 else None
        if true is not None:
            rows.append(_coverage(name, float(true), entry))
    return [row for row in rows if row is not None]


def _coverage(name: str, true: float, entry: Mapping[str, Any]) -> Coverage | None:
    interval = entry.get("ci95")
    if interval is None or None in interval:
        return None
    low, high = (float(end[0] if isinstance(end, list) else end) for end in interval)
    slack = 1e-9 * max(abs(true), abs(high))
    return {
        "name": name,
        "true": true,
        "low": low,
        "high": high,
        "covers": low - slack <= true <= high + slack,
        "width": (high - low) / abs(true) if true != 0.0 else None,
    }
