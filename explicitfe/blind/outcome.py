"""What a report is worth, once the truth is known: one word a case."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

ALARMS = ("effect-found", "ambiguous", "unexplained")
SURE = 3.0  # sds by which the rms of noise alone may exceed its expectation
# words in the order of the tables
SINGLE = ("right", "confidently wrong", "ambiguous, true named", "ambiguous, true not named", "missed", "unexplained", "failed")
DOUBLE = (
    "both",
    "one, remainder says so",
    "one, said to be all",
    "ambiguous",
    "confidently wrong",
    "missed",
    "unexplained",
    "failed",
)
OUTSIDE = ("unexplained", "an effect that predicts at the floor", "confidently wrong", "ambiguous", "missed", "failed")
CONTROL = ("no-missing-effect", *ALARMS, "failed")
WORDS = {"control": CONTROL, "single": SINGLE, "double": DOUBLE, "outside": OUTSIDE}


def outcome(report: Mapping[str, Any], truth: Mapping[str, Any]) -> str:
    """One of the words of the case's kind. A report without a verdict is that of a crash."""
    verdict = report.get("verdict", "failed")
    if verdict == "failed":
        return "failed"
    kind = truth["kind"]
    if kind == "control":
        return verdict
    if verdict == "no-missing-effect":
        return "missed"
    if verdict == "unexplained":
        return verdict
    if kind == "outside":
        return _outside(report, truth)
    return (_single if kind == "single" else _double)(report, set(truth["effects"]))


def named(report: Mapping[str, Any]) -> set[str]:
    """All effects that a verdict names."""
    return set(report.get("effects", ())) | set(report.get("ambiguous_with", ()))


def _single(report: Mapping[str, Any], true: set[str]) -> str:
    if report["verdict"] == "ambiguous":
        return "ambiguous, true named" if true <= named(report) else "ambiguous, true not named"
    return "right" if set(report["effects"]) == true else "confidently wrong"


def _double(report: Mapping[str, Any], true: set[str]) -> str:
    found = set(report["effects"])
    if report["verdict"] == "ambiguous":
        return "ambiguous"
    if found == true:
        return "both"
    if not found < true:
        return "confidently wrong"
    return "one, said to be all" if report.get("remainder") == "at-floor" else "one, remainder says so"


def _outside(report: Mapping[str, Any], truth: Mapping[str, Any]) -> str:
    if report["verdict"] == "ambiguous":
        return "ambiguous"
    return "an effect that predicts at the floor" if predicts(report, truth) else "confidently wrong"


def predicts(report: Mapping[str, Any], truth: Mapping[str, Any]) -> bool:
    """Whether every held-out curve is predicted up to its true noise, and there is one."""
    curves = report.get("final", {}).get("error", {}).get("curves", {})
    held = {name: curve["rmse"] for name, curve in curves.items() if curve.get("split") == "holdout"}
    square = truth["noise"]["rho"] ** 2
    for name, rmse in held.items():
        # the sd of the mean square of n correlated normal numbers
        free = truth["rows"][name] * (1.0 - square) / (1.0 + square)
        if rmse > truth["noise"]["sd"] * math.sqrt(1.0 + SURE * math.sqrt(2.0 / free)):
            return False
    return bool(held)


def recovered(report: Mapping[str, Any], truth: Mapping[str, Any]) -> bool:
    """Whether the final model has the effects of the truth, so that its parameters mean the same."""
    if truth["kind"] == "outside" or truth.get("wrong"):
        return False
    verdict = report.get("verdict")
    if truth["kind"] == "control":
        return verdict == "no-missing-effect"
    return verdict == "effect-found" and set(report["effects"]) == set(truth["effects"])


def intervals(report: Mapping[str, Any], truth: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Parameters of a recovered model: name, true value, 95 % interval, whether it covers, width relative to the true value."""
    found = []
    for name, entry in report.get("final", {}).get("parameters", {}).items():
        if name in ("C10_Pa", "C20_Pa"):
            for value in entry.values():
                found.append(_interval(name, float(truth[name]), value))
            continue
        effect, _, parameter = name.partition(".")
        true = truth["effects"].get(effect, {}).get(parameter)
        if isinstance(true, list):
            true = true[0] if len(true) == 1 else None
        if true is not None:
            found.append(_interval(name, float(true), entry))
    return [row for row in found if row is not None]


def _interval(name: str, true: float, entry: Mapping[str, Any]) -> dict[str, Any] | None:
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
