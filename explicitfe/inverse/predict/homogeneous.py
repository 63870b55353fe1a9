"""A test of a homogeneous state: stress by the law itself, in increments that are halved until they change little."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.fem.effects import Effect, MaterialEffect
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
# In a rig that gives way the search for the strain ends at this tolerance, or is given up after so many corrections.
STRAIN_TOLERANCE = 1e-9
MOST_CORRECTIONS_OF_STRAIN = 100
# The stiffness is a central difference over this change of the strain.
STIFFNESS_STRAIN_CHANGE = 1e-5
# No correction makes the stretch smaller than this share of the imposed one.
LEAST_STRETCH_SHARE = 0.5


def predict_homogeneous(test: Sequence[Curve], law: Yeoh, effects: Sequence[Effect]) -> list[CurveAnswer]:
    """What a tissue answers to the curves of a test without a tool.

    Raises
    ------
    RunError : no state is found at an instant.
    """
    begin = time.perf_counter()
    readings, rig = readings_of(effects), Rig()
    for effect in effects:
        law, rig = effect.in_law(law), effect.on_rig(rig)
    driven = [_with_corners(curve) for curve in test]
    time_s = np.concatenate([curve.time_s + start for curve, start in zip(driven, start_times(test), strict=True)])
    programme = np.concatenate([true_programme(programme_of(curve), curve, readings, by_force=False) for curve in driven])
    stress, count = _stress(_RiggedSpecimen(test[0].kind, law, with_leaves(effects), rig.compliance_per_Pa), time_s, programme)
    answers = []
    seconds = (time.perf_counter() - begin) / len(test)
    true = np.split(stress, np.cumsum([len(rows.time_s) for rows in driven])[:-1])
    for curve, rows, read in zip(test, driven, reading(true, driven, readings, by_force=False), strict=True):
        answers.append(CurveAnswer(read[np.searchsorted(rows.time_s, curve.time_s)], count, 0, seconds))
    return answers


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


@dataclass(frozen=True)
class _RiggedSpecimen:
    """A homogeneous specimen in its rig.

    Attributes
    ----------
    kind : uniaxial or shear.
    law, effects : the tissue.
    compliance_per_Pa : strain that the machine reads and the specimen does not have, per nominal stress [1/Pa].
    """

    kind: str
    law: Yeoh
    effects: Sequence[MaterialEffect]
    compliance_per_Pa: float

    def answer(self, time_s: np.ndarray, imposed: np.ndarray) -> np.ndarray:
        """Stress (n,) Pa along a programme that begins at rest.

        Raises
        ------
        RunError : no state is found at an instant.
        """
        if self.compliance_per_Pa == 0.0:
            return self._tissue(self.effects, time_s, imposed)
        # All instants are corrected together, with the stiffness of the tissue in a sudden small change.
        true, stiffness = imposed, self._stiffness(imposed)
        for _ in range(MOST_CORRECTIONS_OF_STRAIN):
            stress = self._tissue(self.effects, time_s, true)
            change = (imposed - self.compliance_per_Pa * stress - true) / (1.0 + self.compliance_per_Pa * stiffness)
            if np.abs(change).max() <= STRAIN_TOLERANCE:
                return stress
            true = true + change
            if self.kind == "uniaxial":
                true = np.maximum(true, LEAST_STRETCH_SHARE * imposed)
        raise RunError("the strain of a specimen in a rig that gives way is not found; take a smaller compliance.")

    def _tissue(self, effects: Sequence[MaterialEffect], time_s: np.ndarray, strain: np.ndarray) -> np.ndarray:
        test = point.shear if self.kind == "shear" else point.uniaxial
        return test(self.law, effects, time_s, strain)

    def _stiffness(self, strain: np.ndarray) -> np.ndarray:
        """Slope (n,) Pa of the stress in a sudden change, in which nothing is remembered."""
        sudden = [effect for effect in self.effects if not effect.memory]
        both = np.concatenate([strain - STIFFNESS_STRAIN_CHANGE, strain + STIFFNESS_STRAIN_CHANGE])
        low, high = np.split(self._tissue(sudden, np.zeros(len(both)), both), 2)
        return (high - low) / (2.0 * STIFFNESS_STRAIN_CHANGE)


def _stress(specimen: _RiggedSpecimen, time_s: np.ndarray, programme: np.ndarray) -> tuple[np.ndarray, int]:
    """Stress [Pa] at the rows, with increments halved until that changes little; the number of instants."""

    def in_parts(parts: int) -> np.ndarray:
        times = np.interp(np.arange((len(time_s) - 1) * parts + 1) / parts, np.arange(len(time_s)), time_s)
        imposed = np.interp(times, time_s, programme)
        times, imposed = _from_rest(specimen.kind, times, imposed)
        stress = specimen.answer(times, imposed)
        return stress[len(times) - 1 - (len(time_s) - 1) * parts :: parts]

    if not any(effect.memory for effect in specimen.effects):
        return in_parts(1), len(time_s)
    parts, now = 1, in_parts(1)
    for _ in range(MOST_HALVINGS_OF_INCREMENTS):
        before, parts = now, 2 * parts
        now = in_parts(parts)
        if np.abs(now - before).max() <= INCREMENT_ERROR_PEAK_SHARE * np.abs(now).max():
            break
    # The error is of second order in the increment, so that the last halving tells what is left of it (Richardson 1911).
    return now + (now - before) / 3.0, (len(time_s) - 1) * parts + 1


def _from_rest(kind: str, time_s: np.ndarray, programme: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The programme from the undeformed state on: where the first row is strained already, that strain comes at once."""
    undeformed = 0.0 if kind == "shear" else 1.0
    if programme[0] == undeformed:
        return time_s, programme
    return np.concatenate([time_s[:1], time_s]), np.concatenate([[undeformed], programme])
