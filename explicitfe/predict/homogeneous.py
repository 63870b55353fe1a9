"""A test of a homogeneous state: stress by the law itself, in increments that are halved until they change little."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from explicitfe.effects import Effect, MaterialEffect
from explicitfe.effects.effect import readings_of, with_leaves
from explicitfe.errors import InputError
from explicitfe.materials.yeoh import Yeoh
from explicitfe.measured.curve import Curve, programme_of
from explicitfe.predict.experiment import CurveAnswer, cycle_of, start_times
from explicitfe.solve import point

# A column of stretches that follows its nominal programme within this is the programme, and no measurement.
NOMINAL_STRETCH_DEVIATION = 1e-5
# Increments are fine enough when halving them changes the stress by less than this share of its peak.
INCREMENT_ERROR_PEAK_SHARE = 2e-3
# Increments are halved no more often than this: then they are 32 times finer than the rows.
MOST_HALVINGS_OF_INCREMENTS = 5


def predict_homogeneous(test: Sequence[Curve], law: Yeoh, effects: Sequence[Effect]) -> list[CurveAnswer]:
    """What a tissue answers to the curves of a test without a tool.

    Raises
    ------
    InputError : an effect needs a tool.
    """
    begin = time.perf_counter()
    for effect in effects:
        if not effect.without_tool:
            raise InputError(f'curve "{test[0].id}": {effect.about.title} needs a tool, and this is a homogeneous state.')
        law = effect.in_law(law)
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(test, start_times(test), strict=True)])
    programme = np.concatenate([programme_of(curve) for curve in test])
    rows = np.searchsorted(time_s, time_s)
    if len(test) == 1:
        time_s, programme = _with_corner(test[0])
        rows = np.searchsorted(time_s, test[0].time_s)
    stress, count = _stress(test[0].kind, law, with_leaves(effects), time_s, programme)
    remaining = stress[rows]
    answers = []
    seconds = (time.perf_counter() - begin) / len(test)
    for curve in test:
        values, remaining = remaining[: len(curve.time_s)], remaining[len(curve.time_s) :]
        for effect in readings_of(effects):
            values = effect.read_force(values, curve.time_s, cycle_of(curve))
        answers.append(CurveAnswer(values, count, 0, seconds))
    return answers


def _with_corner(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Times and programme of the rows, with the corner between ramp and hold where the stretch is nominal and not measured."""
    t, stretch = curve.time_s, programme_of(curve)
    rate, largest = curve.number("rate_per_s"), curve.number("max_strain")
    if curve.kind != "uniaxial" or not rate or not largest:
        return t, stretch
    sign = -1.0 if stretch[np.argmax(np.abs(stretch - 1.0))] < 1.0 else 1.0
    corner = largest / rate
    nominal = 1.0 + sign * np.minimum(rate * t, largest)
    measured = np.abs(stretch - nominal).max() > NOMINAL_STRETCH_DEVIATION
    if measured or not t[0] < corner < t[-1] or np.abs(t - corner).min() < 1e-9 * corner:
        return t, stretch
    row = int(np.searchsorted(t, corner))
    return np.insert(t, row, corner), np.insert(stretch, row, 1.0 + sign * largest)


def _stress(
    kind: str, law: Yeoh, effects: Sequence[MaterialEffect], time_s: np.ndarray, programme: np.ndarray
) -> tuple[np.ndarray, int]:
    """Stress [Pa] at the rows, with increments halved until that changes little; the number of instants."""

    def in_parts(parts: int) -> np.ndarray:
        times = np.interp(np.arange((len(time_s) - 1) * parts + 1) / parts, np.arange(len(time_s)), time_s)
        imposed = np.interp(times, time_s, programme)
        times, imposed = _from_rest(kind, times, imposed)
        stress = point.shear(law, effects, times, imposed) if kind == "shear" else point.uniaxial(law, effects, times, imposed)
        return stress[len(times) - 1 - (len(time_s) - 1) * parts :: parts]

    if not any(effect.memory for effect in effects):
        return in_parts(1), len(time_s)
    parts, now = 1, in_parts(1)
    for _ in range(MOST_HALVINGS_OF_INCREMENTS):
        before, parts = now, 2 * parts
        now = in_parts(parts)
        if np.abs(now - before).max() <= INCREMENT_ERROR_PEAK_SHARE * np.abs(now).max():
            break
    return now, (len(time_s) - 1) * parts + 1


def _from_rest(kind: str, time_s: np.ndarray, programme: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The programme from the undeformed state on: where the first row is strained already, that strain comes at once."""
    undeformed = 0.0 if kind == "shear" else 1.0
    if programme[0] == undeformed:
        return time_s, programme
    return np.concatenate([time_s[:1], time_s]), np.concatenate([[undeformed], programme])
