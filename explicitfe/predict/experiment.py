"""Curves that are one test, one after the other, and what a tissue answers in it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from explicitfe.effects import Effect
from explicitfe.effects.material.fibres import Fibres
from explicitfe.effects.tool.preload import Preload
from explicitfe.measured.curve import Curve
from explicitfe.predict.tissue import Tissue

ALONG, ACROSS = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)  # fibres, where the load is along z


DIRECTIONS = {"fibre": ALONG, "cross-fibre": ACROSS}


@dataclass(frozen=True)
class CurveAnswer:
    """What a model answers to one curve.

    Attributes
    ----------
    values : (k,) predicted column in SI, at the rows of the data.
    instants : number of states that were computed for it.
    iterations : of dynamic relaxation; 0 for a homogeneous state.
    seconds : that it took.
    assumed : what was supposed of the test, in words.
    """

    values: np.ndarray
    instants: int
    iterations: int
    seconds: float
    assumed: tuple[str, ...] = field(default=())


def experiments(curves: Sequence[Curve]) -> list[tuple[Curve, ...]]:
    """Curves that are one test each; cycles of one group, specimen and tool are one test, one after the other.

    What a tissue remembers goes on from cycle to cycle; each begins a row's step after the last one ended.
    """
    tests: dict[Any, list[Curve]] = {}
    for curve in curves:
        cycle = curve.conditions.get("cycle")
        key: Any = curve.id
        if isinstance(cycle, int | float) and not isinstance(cycle, bool):
            other = {k: v for k, v in curve.conditions.items() if k not in ("cycle", "preload_N", "first_force_N", "defect")}
            key = (curve.constants, curve.group, repr(curve.specimen), repr(curve.tool), json.dumps(other, sort_keys=True))
        tests.setdefault(key, []).append(curve)
    return [tuple(sorted(test, key=lambda c: c.conditions.get("cycle", 0))) for test in tests.values()]


def effects_of(curve: Curve, model: Tissue) -> tuple[Effect, ...]:
    """The model's effects as they stand in the test of a curve: fibres turned, the preload that was measured."""
    found: list[Effect] = []
    for effect in model.effects.chosen:
        if isinstance(effect, Fibres) and curve.conditions.get("direction") in DIRECTIONS:
            effect = effect.model_copy(update={"direction": DIRECTIONS[curve.conditions["direction"]]})
        if isinstance(effect, Preload) and "preload_N" in curve.conditions:
            effect = effect.model_copy(update={"force_N": max(float(curve.conditions["preload_N"]), 0.0)})
        found.append(effect)
    return tuple(found)


def start_times(test: Sequence[Curve]) -> list[float]:
    """Time at which each curve of a test begins, s."""
    starts = [0.0]
    for before, curve in pairwise(test):
        starts.append(starts[-1] + float(before.time_s[-1] + (curve.time_s[1] - curve.time_s[0])))
    return starts


def cycle_of(curve: Curve) -> float:
    """Number of a repeat or cycle; 1 where the dataset gives none."""
    number = curve.conditions.get("repeat", curve.conditions.get("cycle", 1))
    return float(number) if isinstance(number, int | float) else 1.0
