"""Curves that are one test, one after the other, and what a tissue answers in it."""

from __future__ import annotations

import json
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict.tissue import Tissue
from explicitfe.platform.errors import InputError

# Cycles of one test may differ in these conditions: the force at the first row changes with what the tissue remembers.
CONDITIONS_OF_A_CYCLE = ("cycle", "preload_N", "first_force_N", "defect")


@dataclass(frozen=True)
class CurveAnswer:
    """What a tissue answers to one curve.

    Attributes
    ----------
    values : (k,) predicted column in SI, at the rows of the data.
    instants : number of states that were computed for it.
    iterations : of dynamic relaxation; 0 for a homogeneous state.
    seconds : time that it took.
    assumed : what was supposed about the test because the dataset does not state it, in words.
    variants : values of tissues that differ by little and were computed beside this one; None where that failed.
    """

    values: np.ndarray
    instants: int
    iterations: int
    seconds: float
    assumed: tuple[str, ...] = field(default=())
    variants: tuple[np.ndarray | None, ...] = field(default=())


def experiments(curves: Sequence[Curve]) -> list[tuple[Curve, ...]]:
    """Group curves into tests: cycles of one group, specimen and tool are one test, one after the other.

    What a tissue remembers goes on from cycle to cycle. A cycle begins one step between rows after the last one has ended.
    """
    tests: dict[Hashable, list[Curve]] = {}
    for curve in curves:
        key: Hashable = curve.id
        if curve.number("cycle") is not None:
            others = {name: value for name, value in curve.conditions.items() if name not in CONDITIONS_OF_A_CYCLE}
            key = (curve.constants, curve.group, repr(curve.specimen), repr(curve.tool), json.dumps(others, sort_keys=True))
        tests.setdefault(key, []).append(curve)
    return [tuple(sorted(test, key=lambda curve: curve.number("cycle") or 0.0)) for test in tests.values()]


def effects_of(curve: Curve, tissue: Tissue) -> tuple[Effect, ...]:
    """The tissue's effects as they stand in the test of a curve: with fibres turned, and the preload that was measured.

    Raises
    ------
    InputError : an effect needs a tool, or none of its keys stands for a test of this kind.
    """
    tool = curve.tool is not None
    for effect in tissue.effects.chosen:
        if effect.stands_in(tool=tool):
            continue
        if not effect.without_tool:
            raise InputError(f'curve "{curve.id}": {effect.about.title} needs a tool, and this is a homogeneous state.')
        keys, columns = " and ".join(effect.sought_in(tool=tool)), "displacement and force" if tool else "strain and stress"
        raise InputError(f'curve "{curve.id}": {effect.about.title} has no {keys}, and this is a test of {columns}; give it.')
    return tuple(effect.in_test(curve.conditions) for effect in tissue.effects.chosen)


def start_times(test: Sequence[Curve]) -> list[float]:
    """Time at which each curve of a test begins [s]."""
    starts = [0.0]
    for before, curve in pairwise(test):
        starts.append(starts[-1] + float(before.time_s[-1] + (curve.time_s[1] - curve.time_s[0])))
    return starts


def cycle_of(curve: Curve) -> float:
    """Number of a repeat or cycle; 1 where the dataset gives none."""
    number = curve.conditions.get("repeat", curve.conditions.get("cycle", 1))
    return float(number) if isinstance(number, int | float) else 1.0
