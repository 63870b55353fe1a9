"""Muscles of a run from its result file: names, and activation over time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Required

import numpy as np
from typing_extensions import TypedDict

from explicitfe.results.files import Result


class StatedMuscle(TypedDict, total=False):
    """A muscle in the model of a result file, with the keys of a scenario's [[muscle]] table; times in ms."""

    name: Required[str]
    force_N: Required[float]
    side: str
    distribution: str
    table: list[tuple[float, float]]
    start_ms: float
    rise_ms: float
    end_ms: float | None


def muscles_of(result: Result) -> list[StatedMuscle]:
    """The muscles of a run; an empty list where it has none."""
    return result.model.get("muscles", [])


def pull_in_words(muscle: StatedMuscle) -> str:
    """Such as "GGp 2 N (ends)": the muscle, its full force, and the distribution of the force."""
    return f"{muscle_name(muscle)} {muscle['force_N']:g} N ({muscle.get('distribution', 'ends')})"


def muscle_name(muscle: StatedMuscle) -> str:
    """The name of a muscle, with the side where only one pulls."""
    side = muscle.get("side", "both")
    return muscle["name"] if side == "both" else f"{muscle['name']} {side}"


def activation(muscle: StatedMuscle, end_ms: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a muscle's force over time from 0 to ``end_ms``: times in ms, and shares of its ``force_N``."""
    if muscle.get("table"):
        times, scales = [time for time, _ in muscle["table"]], [scale for _, scale in muscle["table"]]
    else:
        start = muscle.get("start_ms", 0.0)
        times, scales = [start, start + muscle.get("rise_ms", 0.0)], [0.0, 1.0]
        end = muscle.get("end_ms")
        if end is not None:
            times, scales = times + [end] * 2, scales + [1.0, 0.0]
    times, scales = [min(0.0, times[0]), *times, max(end_ms, times[-1])], [scales[0], *scales, scales[-1]]
    return np.array(times), np.array(scales)


def on_times(muscles: Iterable[StatedMuscle], end_ms: float) -> list[tuple[float, float]]:
    """Spans of time, ms, in which at least one muscle pulls."""
    spans: list[tuple[float, float]] = []
    for muscle in muscles:
        times, scales = activation(muscle, end_ms)
        pulls = (np.maximum(scales[:-1], scales[1:]) > 0.0) & (times[1:] > times[:-1]) & (times[:-1] < end_ms)
        if muscle["force_N"] > 0.0:
            ends = np.minimum(times[1:][pulls], end_ms)
            spans += [(float(a), float(b)) for a, b in zip(times[:-1][pulls], ends, strict=True)]
    merged: list[tuple[float, float]] = []
    for start, end in sorted(spans):
        if merged and start <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((start, end))
    return merged
