"""A test of a homogeneous state: stress by the law itself, in increments that are halved until they change little."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from explicitfe.effects import Effect, MaterialEffect
from explicitfe.effects.material.compressible import Compressible
from explicitfe.effects.reading.cycle_drift import CycleDrift
from explicitfe.errors import InputError
from explicitfe.materials.yeoh import Yeoh
from explicitfe.measured.curve import Curve, programme_of
from explicitfe.predict.experiment import CurveAnswer, cycle_of, start_times
from explicitfe.solve import point

NOMINAL = 1e-5  # of stretch: a column that follows its programme so closely is the programme


CLOSE = 2e-3  # of a curve's peak: what halving the increments may change


HALVINGS = 5


def predict_homogeneous(test: Sequence[Curve], law: Yeoh, effects: Sequence[Effect]) -> list[CurveAnswer]:
    begin = time.perf_counter()
    material: list[MaterialEffect] = []
    readings: list[CycleDrift] = []
    for effect in effects:
        if isinstance(effect, MaterialEffect):
            material.append(effect)
        elif isinstance(effect, Compressible):
            law = law.model_copy(update={"poisson": effect.poisson})
        elif isinstance(effect, CycleDrift):
            readings.append(effect)
        else:
            raise InputError(f'curve "{test[0].id}": {effect.about.title} needs a tool, and this is a homogeneous state.')
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(test, start_times(test), strict=True)])
    way = np.concatenate([programme_of(curve) for curve in test])
    row = np.searchsorted(time_s, time_s)
    if len(test) == 1:
        time_s, way = _with_corner(test[0])
        row = np.searchsorted(time_s, test[0].time_s)
    stress, count = _followed(test[0].kind, law, material, time_s, way)
    answers = stress[row]
    found = []
    seconds = (time.perf_counter() - begin) / len(test)
    for curve in test:
        values, answers = answers[: len(curve.time_s)], answers[len(curve.time_s) :]
        for effect in readings:
            values = effect.read_force(values, curve.time_s, cycle_of(curve))
        found.append(CurveAnswer(values, count, 0, seconds))
    return found


def _with_corner(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Rows with the corner between ramp and hold, where the stretch is a programme and no measurement."""
    t, x = curve.time_s, programme_of(curve)
    rate, most = curve.conditions.get("rate_per_s"), curve.conditions.get("max_strain")
    if curve.kind != "uniaxial" or not rate or not most:
        return t, x
    sign = -1.0 if x[np.argmax(np.abs(x - 1.0))] < 1.0 else 1.0
    corner = most / rate
    programme = 1.0 + sign * np.minimum(rate * t, most)
    if np.abs(x - programme).max() > NOMINAL or not t[0] < corner < t[-1] or np.abs(t - corner).min() < 1e-9 * corner:
        return t, x
    at = int(np.searchsorted(t, corner))
    return np.insert(t, at, corner), np.insert(x, at, 1.0 + sign * most)


def _followed(
    kind: str, law: Yeoh, effects: Sequence[MaterialEffect], time_s: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, int]:
    """Stress [Pa] at the rows, with increments halved until that changes little; the number of instants."""

    def at(parts: int) -> np.ndarray:
        times = np.interp(np.arange((len(time_s) - 1) * parts + 1) / parts, np.arange(len(time_s)), time_s)
        ways = np.interp(times, time_s, way)
        times, ways = _rest(kind, times, ways)
        stress = point.shear(law, effects, times, ways) if kind == "shear" else point.uniaxial(law, effects, times, ways)
        return stress[len(times) - 1 - (len(time_s) - 1) * parts :: parts]

    if not any(effect.memory for effect in effects):
        return at(1), len(time_s)
    parts, now = 1, at(1)
    for _ in range(HALVINGS):
        before, parts = now, 2 * parts
        now = at(parts)
        if np.abs(now - before).max() <= CLOSE * np.abs(now).max():
            break
    return now, (len(time_s) - 1) * parts + 1


def _rest(kind: str, time_s: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The path from rest on: where the first row is strained already, that happens at once."""
    rest = 0.0 if kind == "shear" else 1.0
    if way[0] == rest:
        return time_s, way
    return np.concatenate([time_s[:1], time_s]), np.concatenate([[rest], way])
