"""A test of a homogeneous state: stress by the law itself, in increments that are halved until they change little."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.effects.effect import Rig, readings_of, with_leaves
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.experiment import CurveAnswer, start_times
from explicitfe.inverse.predict.reading import reading, true_programme
from explicitfe.platform.errors import RunError

# So many rows within this strain of a line are a straight part of a programme.
ROWS_OF_STRAIGHT_PART = 4
STRAIGHT_STRAIN_DEVIATION = 1e-5
# Increments are fine enough when halving them changes the stress by less than this share of its peak.
INCREMENT_ERROR_PEAK_SHARE = 2e-3
# Increments are halved no more often than this: then they are 32 times finer than the rows.
MOST_HALVINGS_OF_INCREMENTS = 5
LOADS = {"uniaxial": point.UNIAXIAL, "shear": point.SHEAR}


class HomogeneousTest:
    """A test without a tool and the tissue in it.

    Parameters
    ----------
    curves : one after the other.
    law, effects : the tissue.

    Attributes
    ----------
    kind : uniaxial or shear.
    material : the law with effects in its constants, and the effects that are computed beside it.
    compliance_per_Pa : strain that the machine reads and the specimen does not have, per nominal stress [1/Pa].
    driven : the curves with rows for their corners.
    time_s, programme : (n,) all rows of these one after the other, and what is really imposed there.
    """

    def __init__(self, curves: Sequence[Curve], law: Yeoh, effects: Sequence[Effect]) -> None:
        self.curves, self.kind, self.readings, rig = tuple(curves), curves[0].kind, readings_of(effects), Rig()
        for effect in effects:
            law, rig = effect.in_law(law), effect.on_rig(rig)
        self.material, self.compliance_per_Pa = (law, with_leaves(effects)), rig.compliance_per_Pa
        self.driven, self.time_s, self.programme = _rows_of(self.curves)
        if self.readings:
            true = [true_programme(programme_of(one), one, self.readings, by_force=False) for one in self.driven]
            self.programme = np.concatenate(true)

    def in_parts(self, parts: int) -> tuple[np.ndarray, np.ndarray]:
        """Instants and strain with each increment in so many parts, from the undeformed state on: a strain in the first row comes
        at once."""
        undeformed = 0.0 if self.kind == "shear" else 1.0
        times = _instants(self.curves, parts)
        imposed = np.interp(times, self.time_s, self.programme)
        if imposed[0] == undeformed:
            return times, imposed
        return np.concatenate([times[:1], times]), np.concatenate([[undeformed], imposed])

    def read(self, stress: np.ndarray) -> list[np.ndarray]:
        """What the machine reads at the measured rows of each curve where the stress (n,) is there at all rows."""
        true = np.split(stress, np.cumsum([len(one.time_s) for one in self.driven])[:-1])
        read = reading(true, self.driven, self.readings, by_force=False)
        rows = [np.searchsorted(finer.time_s, curve.time_s) for curve, finer in zip(self.curves, self.driven, strict=True)]
        return [values[own] for values, own in zip(read, rows, strict=True)]


@lru_cache(maxsize=1000)
def _rows_of(test: tuple[Curve, ...]) -> tuple[tuple[Curve, ...], np.ndarray, np.ndarray]:
    """The curves of a test with rows for their corners, and times (n,) s and programme (n,) of all rows."""
    driven = tuple(_with_corners(curve) for curve in test)
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(driven, start_times(test), strict=True)])
    return driven, time_s, np.concatenate([programme_of(curve) for curve in driven])


@lru_cache(maxsize=1000)
def _instants(test: tuple[Curve, ...], parts: int) -> np.ndarray:
    """Times (m,) s of all rows of a test, with each increment in so many parts."""
    _, time_s, _ = _rows_of(test)
    return np.interp(np.arange((len(time_s) - 1) * parts + 1) / parts, np.arange(len(time_s)), time_s)


def predict_homogeneous(tests: Sequence[HomogeneousTest]) -> list[list[CurveAnswer] | RunError]:
    """What a tissue answers to the curves of each test, or why no state is found at an instant.

    Parameters
    ----------
    tests : of one kind, with effects of the same kinds; one compiled call computes them all, and one more for each halving of
        their increments.
    """
    begin = time.perf_counter()
    now = _in_parts(tests, 1)
    instants = [len(test.programme) for test in tests]
    answers, remembers = now.copy(), any(effect.memory for effect in tests[0].material[1])
    pending = [k for k, stress in enumerate(now) if remembers and not isinstance(stress, RunError)]
    for parts in 2 ** np.arange(1, MOST_HALVINGS_OF_INCREMENTS + 1):
        if not pending:
            break
        for k, stress in zip(pending.copy(), _in_parts([tests[k] for k in pending], int(parts)), strict=True):
            before, now[k], answers[k] = now[k], stress, stress
            if isinstance(stress, RunError):
                pending.remove(k)
                continue
            # The error is of second order in the increment, so that the last halving tells what is left of it (Richardson 1911).
            answers[k], instants[k] = stress + (stress - before) / 3.0, (len(stress) - 1) * int(parts) + 1
            if np.abs(stress - before).max() <= INCREMENT_ERROR_PEAK_SHARE * np.abs(stress).max():
                pending.remove(k)
    seconds = (time.perf_counter() - begin) / sum(len(test.curves) for test in tests)
    return [
        stress if isinstance(stress, RunError) else [CurveAnswer(values, count, 0, seconds) for values in test.read(stress)]
        for test, stress, count in zip(tests, answers, instants, strict=True)
    ]


def _in_parts(tests: Sequence[HomogeneousTest], parts: int) -> list[np.ndarray | RunError]:
    """Stress [Pa] at the rows of each test with each increment in so many parts, or why there is none."""
    histories = [point.History(*test.material, *test.in_parts(parts), test.compliance_per_Pa) for test in tests]
    stresses = LOADS[tests[0].kind].stresses(histories)
    first = [len(one.time_s) - 1 - parts * (len(test.programme) - 1) for test, one in zip(tests, histories, strict=True)]
    return [y if isinstance(y, RunError) else y[start::parts] for y, start in zip(stresses, first, strict=True)]


def _with_corners(curve: Curve) -> Curve:
    """The curve with a row for each corner of its programme that lies between two rows.

    A corner is where two straight parts of the programme meet, each through ``ROWS_OF_STRAIGHT_PART`` rows. A measured column is
    nowhere so straight.
    """
    t, programme = curve.time_s, programme_of(curve)
    times, values = _corners(t, programme)
    if not len(times):
        return curve
    rows = np.searchsorted(t, times)
    columns = {name: np.insert(column, rows, np.interp(times, t, column)) for name, column in curve.columns.items()}
    columns[curve.imposed] = np.insert(programme, rows, values)
    return replace(curve, time_s=np.insert(t, rows, times), columns=columns)


def _corners(t: np.ndarray, programme: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) and values (m,) of corners between rows, of the programme at times t."""
    n = ROWS_OF_STRAIGHT_PART
    if len(t) < 2 * n:
        return np.zeros(0), np.zeros(0)
    # Of each window of n rows: slope, and the largest distance of a row from the line through the first and the last one.
    windows, rows = (np.lib.stride_tricks.sliding_window_view(column, n) for column in (t, programme))
    slope = (rows[:, -1] - rows[:, 0]) / (windows[:, -1] - windows[:, 0])
    bend = np.abs(rows - rows[:, :1] - slope[:, None] * (windows - windows[:, :1])).max(axis=1)
    before, after = np.arange(len(slope) - n), np.arange(n, len(slope))  # windows that end and begin at neighbouring rows
    first, last = before + n - 1, after  # the two rows
    turn = slope[after] - slope[before]
    step, rise = t[last] - t[first], programme[last] - programme[first]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (slope[after] * step - rise) / (turn * step)  # of the step at which the lines meet
    beside = np.abs(share * (slope[before] * step - rise))  # distance of the corner from the chord
    straight = np.maximum(bend[before], bend[after]) <= STRAIGHT_STRAIN_DEVIATION
    corner = straight & (share > 0.0) & (share < 1.0) & (beside > STRAIGHT_STRAIN_DEVIATION)
    at = first[corner]
    ahead = (share * step)[corner]
    return t[at] + ahead, programme[at] + slope[before][corner] * ahead
