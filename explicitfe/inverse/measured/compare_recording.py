"""Compare a result with recorded sensors: registration, alignment in time, distances and correlations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import interp1d
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from explicitfe.inverse.measured.coils import Coils, read_coils
from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS
from explicitfe.inverse.measured.registration import (
    Registration,
    are_nearly_on_a_line,
    check_directions,
    determine_a_rotation,
    procrustes,
    procrustes_in_plane,
    rotation_between,
    turns_over,
)
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.shipped import export_file
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.compare import describe_result, path_of_point
from explicitfe.results.measure.recording import ComparedAxis, ComparedSensor, FittedRegistration, RecordingComparison, RegisterBy
from explicitfe.results.measure.sections import X, Y, Z

# Without --reference-s a speaker is taken to rest for this time from the start of the comparison.
REST_S = 0.02
# A fitted offset keeps at least this share of the shorter of the two records in the comparison.
LEAST_OVERLAP_SHARE = 0.9
# Offsets are searched in steps of the sampling interval, but of at least this length, and at most this many.
SMALLEST_OFFSET_STEP_S, MOST_OFFSETS = 2e-3, 5000
MM_PER_M, MS_PER_S = 1e3, 1e3
MIDSAGITTAL = np.array([1.0, 0.0, 1.0])  # planar recordings have no lateral coordinate
# In the reference interval the sensors move by less than this; coordinates of an articulograph have errors of 0.3 to 0.5 mm.
RESTING_M = 5e-4
LEAST_MOVEMENT_SHARE = 0.2  # of the recording relative to that of the model
STILL_M = 1e-9  # a coordinate that changes by less does not move
SAME_TIME_S = 1e-9


@dataclass(frozen=True, eq=False)
class Tracks:
    """Paths of points in the frame of the model, for pictures: time (k,) s, and point -> (k, 3) m."""

    time_s: np.ndarray
    model: dict[str, np.ndarray]
    recorded: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class _Aligned:
    """The recording in the frame and at the times of the model, for one offset; ``shift_s`` is the offset."""

    shift_s: float
    time_s: np.ndarray  # (k,) of the model
    model: np.ndarray  # (k, s, 3) m
    recorded: np.ndarray  # (k, s, 3) m
    registration: Registration
    residual_m: float | None

    @property
    def rms_m(self) -> float:
        return _rms(self.recorded - self.model)


def compare_recording(
    path: Path | str,
    recording: Coils | Path | str,
    mapping: Mapping[str, str],
    *,
    register: RegisterBy = "rest",
    reference_s: tuple[float, float] | None = None,
    offset_s: float | Literal["fit"] | None = None,
    head: Sequence[str] = (),
) -> tuple[RecordingComparison, Tracks]:
    """Compare named points of a result with recorded sensors.

    The model is interpolated linearly to the times of the recording.

    Parameters
    ----------
    path : the result of a transient run.
    recording : a file, or what :func:`explicitfe.inverse.measured.coils.read_coils` returns.
    mapping : named point of the model -> sensor.
    register : what the rigid registration is fitted to. "rest": the mean sensor positions during ``reference_s`` and the
        points of the model in its first sample. "movement": all compared positions. "none": the recording is in the model frame.
    reference_s : interval of the recording, in its own time, in which the speaker rests; None: first 20 ms after the offset.
    offset_s : time of the recording at which the simulation starts; its first row if None. "fit" minimizes the distance.
    head : sensors on a rigid part (upper incisors, nose, palate; or the jaw), whose motion is removed first.

    Returns
    -------
    The comparison, and the compared paths for pictures.

    Raises
    ------
    InputError : a point or a sensor does not exist, the two have fewer than three rows in common, or the result is no transient
        run.
    """
    if not isinstance(mapping, Mapping) or not all(isinstance(name, str) for pair in mapping.items() for name in pair):
        raise InputError("`mapping` must name a sensor for each point, such as {'tip': 'T1'}.")
    if not mapping:
        raise InputError("`mapping` is missing; map at least one point to a sensor, such as `mapping` tip=T1.")
    coils = recording if isinstance(recording, Coils) else read_coils(export_file(recording))
    for name in head:
        coils.sensor(name)
    chosen = coils.select(dict.fromkeys((*mapping.values(), *head)))
    steady = _without_head_motion(chosen, head, reference_s)
    with open_result(path) as result:
        names = list(mapping)
        rest_m, paths = _model_paths(result, names)
        if coils.planar:
            rest_m, paths = rest_m * MIDSAGITTAL, paths * MIDSAGITTAL
        times_s = np.asarray(result.times)
        described = describe_result(result)
    recorded = np.stack([steady.positions[sensor] for sensor in mapping.values()], axis=1)

    def align(shift_s: float) -> _Aligned:
        return _align(steady, recorded, times_s, rest_m, paths, shift_s, register, reference_s)

    fitted = offset_s == "fit"
    start_s = float(steady.time_s[0] if offset_s in (None, "fit") else offset_s)
    best = _best_offset(coils.path, align, steady.time_s, times_s) if fitted else align(start_s)
    movement = best.recorded - best.recorded.mean(axis=0)
    model_movement = best.model - best.model.mean(axis=0)
    table = best.registration
    sentence = _registration_sentence(register, reference_s, recorded, table)
    warnings = [*steady.notes, *_doubts(steady, recorded, best, register, reference_s)]
    comparison = RecordingComparison(
        result=described,
        recording=str(coils.path),
        registration=FittedRegistration(
            method=register,
            what=sentence,
            rotation=table.rotation.tolist(),
            rotation_deg=float(np.degrees(Rotation.from_matrix(table.rotation).magnitude())),
            translation_mm=(MM_PER_M * table.translation).tolist(),
            residual_mm=None if best.residual_m is None else MM_PER_M * best.residual_m,
            head_sensors=list(head),
        ),
        offset_s=best.shift_s,
        offset_fitted=fitted,
        rows=len(best.time_s),
        first_ms=MS_PER_S * float(best.time_s[0]),
        last_ms=MS_PER_S * float(best.time_s[-1]),
        rms_mm=MM_PER_M * best.rms_m,
        centred_rms_mm=MM_PER_M * _rms(movement - model_movement),
        movement_rms_mm=MM_PER_M * _rms(movement),
        points={
            name: _sensor(sensor, best.time_s, best.model[:, k], best.recorded[:, k], steady.planar)
            for k, (name, sensor) in enumerate(mapping.items())
        },
        warnings=warnings,
    )
    tracks = [{name: places[:, k] for k, name in enumerate(names)} for places in (best.model, best.recorded)]
    return comparison, Tracks(best.time_s, *tracks)


def _model_paths(result: Result, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Positions of named points in the first sample (s, 3) and at all stored times (t, s, 3) [m]."""
    if kind_of(result.model) != "transient":
        raise InputError(f"{result.path}: this is an indentation; compare the result of a transient run with a recording.")
    known = result.mesh.named_points
    for name in names:
        if name not in known:
            raise InputError(f'{result.path}: the model has no point "{name}"; {nearest(name, known)}')
    if len(result.times) < 2:
        raise InputError(f"{result.path}: only {len(result.times)} sample is stored; compare a transient run with at least two.")
    paths = np.stack([known[name].position[0] + path_of_point(result, name) for name in names], axis=1)
    return paths[0], paths


def _align(
    coils: Coils,
    recorded: np.ndarray,
    times_s: np.ndarray,
    rest_m: np.ndarray,
    paths: np.ndarray,
    shift_s: float,
    register: RegisterBy,
    reference_s: tuple[float, float] | None,
) -> _Aligned:
    """Register the recording, and interpolate the model to its times, for one offset."""
    inside = _rows_between(coils.time_s, shift_s + times_s[0], shift_s + times_s[-1])
    now_s = np.clip(coils.time_s[inside] - shift_s, times_s[0], times_s[-1])  # rounding may lead slightly outside
    if len(now_s) < SMALLEST_CURVE_ROWS:
        raise InputError(
            f"{coils.path}: {len(now_s)} rows lie within the simulation ({times_s[-1]:g} s) if it starts at {shift_s:g} s "
            f"of the recording ({coils.time_s[0]:g} to {coils.time_s[-1]:g} s); change `offset_s`."
        )
    model = interp1d(times_s, paths, axis=0)(now_s)
    compared = recorded[inside]
    identity = Registration(np.eye(3), np.zeros(3))
    if register == "none":
        return _Aligned(shift_s, now_s, model, compared, identity, None)
    if register == "rest":
        start_s, end_s = reference_s or (shift_s, shift_s + REST_S)
        target, seen = rest_m, recorded[_reference_rows(coils, start_s, end_s)].mean(axis=0)
    else:
        target, seen = model.reshape(-1, 3), compared.reshape(-1, 3)
    registration = _fit_registration(coils, recorded, _fitted_parts(recorded), target, seen)
    residual_m = _rms(registration.to_model(seen) - target)
    return _Aligned(shift_s, now_s, model, registration.to_model(compared), registration, residual_m)


def _fit_registration(
    coils: Coils, recorded: np.ndarray, table: RegistrationTable, target: np.ndarray, seen: np.ndarray
) -> Registration:
    """Fit the registration, with a rotation about the lateral axis only if a free one contradicts the axes of the recording."""
    free = procrustes(table, target, seen)
    if table.rotation != "fit":
        return free
    check_directions(coils.path, free, target, seen, recorded.mean(axis=0), coils.axes, coils.planar)
    if not (coils.planar or turns_over(free, coils.axes, coils.planar)):
        return free
    directions = [False] if coils.axes == "anatomical" else [False, True]
    fits = [procrustes_in_plane(target, seen, reversed_x) for reversed_x in directions]
    best = min(fits, key=lambda fit: (turns_over(fit, "cartesian", planar=True), _rms(fit.to_model(seen) - target)))
    if turns_over(best, "cartesian", planar=True):
        raise InputError(
            f"{coils.path}: the recording fits the model only if it is turned by {best.turn_deg:.0f}° about the lateral axis; "
            f"correct the signs of the axes, or `mapping`."
        )
    return best


def _doubts(
    coils: Coils, recorded: np.ndarray, best: _Aligned, register: RegisterBy, reference_s: tuple[float, float] | None
) -> list[str]:
    """Sentences on what makes the registration or the comparison doubtful."""
    doubts = []
    where = recorded.mean(axis=0)
    if register != "none":
        if not determine_a_rotation(where):
            doubts.append("registration by translation only: a rotation needs three sensors that do not lie on a line.")
        elif best.registration.is_planar and not coils.planar:
            doubts.append(
                "the sensors lie nearly on a line, and a free rotation would contradict the directions that the recording names; "
                "the rotation is about the lateral axis only."
            )
        elif not best.registration.is_planar and coils.axes == "cartesian" and are_nearly_on_a_line(where):
            doubts.append(
                "the sensors lie nearly on a line: the rotation about it is uncertain; name the directions with `axes`."
            )
    if register == "rest":
        start_s, end_s = reference_s or (best.shift_s, best.shift_s + REST_S)
        rows = _reference_rows(coils, start_s, end_s)
        moved_m = _trend(coils.time_s[rows], recorded[rows].mean(axis=1))
        if moved_m > RESTING_M:
            doubts.append(
                f"the sensors move by {MM_PER_M * moved_m:.1f} mm from {start_s:.4g} to {end_s:.4g} s, where the speaker is "
                f"taken to rest; give another `reference_s`, or `register` movement."
            )
    movement_m, model_m = (_rms(places - places.mean(axis=0)) for places in (best.recorded, best.model))
    if movement_m < LEAST_MOVEMENT_SHARE * model_m:
        doubts.append(
            f"in the compared interval the sensors vary by {MM_PER_M * movement_m:.2f} mm rms and the model by "
            f"{MM_PER_M * model_m:.2f} mm; select a movement of the recording with `offset_s`, a time or fit."
        )
    return doubts


def _trend(time_s: np.ndarray, path: np.ndarray) -> float:
    """Length in m of the linear trend of a path (k, 3) over its duration; it is affected by noise less than the end points."""
    if len(time_s) < SMALLEST_CURVE_ROWS:
        return 0.0
    return float(np.linalg.norm(np.polyfit(time_s - time_s[0], path, 1)[0]) * np.ptp(time_s))


def _rows_between(time_s: np.ndarray, start_s: float, end_s: float) -> slice:
    """Rows of an interval, up to rounding."""
    return slice(*np.searchsorted(time_s, [start_s - SAME_TIME_S, end_s + SAME_TIME_S]))


def _reference_rows(coils: Coils, start_s: float, end_s: float) -> slice:
    rows = _rows_between(coils.time_s, start_s, end_s)
    if rows.start == rows.stop:
        raise InputError(f"{coils.path}: no row lies between {start_s:g} and {end_s:g} s; give another `reference_s`.")
    return rows


def _fitted_parts(recorded: np.ndarray) -> RegistrationTable:
    """Translation and, where the mean positions of the sensors determine one, rotation."""
    turns = determine_a_rotation(recorded.mean(axis=0))
    return RegistrationTable(translation="fit", **({"rotation": "fit"} if turns else {}))


def _best_offset(path: Path, align: Callable[[float], _Aligned], recorded_s: np.ndarray, times_s: np.ndarray) -> _Aligned:
    """The offset with the smallest distance: the best of a grid, refined between its neighbours."""
    shorter_s = min(np.ptp(recorded_s), np.ptp(times_s))
    low = recorded_s[0] - times_s[-1] + LEAST_OVERLAP_SHARE * shorter_s
    high = recorded_s[-1] - times_s[0] - LEAST_OVERLAP_SHARE * shorter_s
    step = max(float(np.median(np.diff(recorded_s))), SMALLEST_OFFSET_STEP_S)
    if high - low > MOST_OFFSETS * step:
        raise InputError(
            f"{path}: the recording lasts {np.ptp(recorded_s):.4g} s, and `offset_s` fit searches at most "
            f"{MOST_OFFSETS * step:.4g} s; give an offset, or a part of the recording."
        )
    grid = np.arange(low, high + 0.5 * step, step)

    def distance(shift_s: float) -> float:
        try:
            return align(float(shift_s)).rms_m
        except InputError:
            return np.inf

    distances = [distance(shift_s) for shift_s in grid]
    best = grid[int(np.argmin(distances))]
    refined = minimize_scalar(distance, bounds=(best - step, best + step), method="bounded")
    return align(float(refined.x if refined.fun <= min(distances) else best))


def _without_head_motion(coils: Coils, head: Sequence[str], reference_s: tuple[float, float] | None) -> Coils:
    """Express all sensors relative to those on the head, as these are in the reference interval."""
    if not head:
        return coils
    places = np.stack([coils.positions[name] for name in head], axis=1)
    start_s, end_s = reference_s or (coils.time_s[0], coils.time_s[0] + REST_S)
    target = places[_reference_rows(coils, start_s, end_s)].mean(axis=0)
    centre, now = target.mean(axis=0), places.mean(axis=1)
    if determine_a_rotation(target):
        turns = rotation_between(places - now[:, None], np.broadcast_to(target - centre, places.shape))
    else:
        turns = np.broadcast_to(np.eye(3), (len(now), 3, 3))
        only = f"{coils.path}: the motion of {', '.join(head)} is removed as a translation; a rotation needs three sensors."
        coils = replace(coils, notes=[*coils.notes, only])
    positions = {
        name: np.einsum("kij,kj->ki", turns, place - now) + centre for name, place in coils.positions.items() if name not in head
    }
    return replace(coils, positions=positions | {name: coils.positions[name] for name in head})


def _registration_sentence(
    register: RegisterBy, reference_s: tuple[float, float] | None, recorded: np.ndarray, fitted: Registration
) -> str:
    """What was fitted, and to what."""
    parts = "translation"
    if determine_a_rotation(recorded.mean(axis=0)):
        parts = f"rotation {'about the lateral axis ' if fitted.is_planar else ''}and translation"
    interval = f"{reference_s[0]:g} to {reference_s[1]:g} s" if reference_s else f"first {MS_PER_S * REST_S:g} ms"
    sentences = {
        "rest": f"{parts} fitted to the positions at rest (recording: {interval}; model: first sample)",
        "movement": f"{parts} fitted to all compared positions",
        "none": "none: the recording is in the frame of the model",
    }
    return sentences[register]


def _sensor(sensor: str, time_s: np.ndarray, model: np.ndarray, recorded: np.ndarray, planar: bool) -> ComparedSensor:
    difference = recorded - model
    distance = np.linalg.norm(difference, axis=1)
    worst = int(distance.argmax())

    def axis(number: int, sign: float = 1.0) -> ComparedAxis:
        return _axis(sign * model[:, number], sign * recorded[:, number])

    return ComparedSensor(
        sensor=sensor,
        rms_mm=MM_PER_M * float(np.sqrt(np.mean(distance**2))),
        largest_mm=MM_PER_M * float(distance[worst]),
        largest_at_ms=MS_PER_S * float(time_s[worst]),
        centred_rms_mm=MM_PER_M * _rms(difference - difference.mean(axis=0)),
        forward=axis(X, -1.0),
        up=axis(Z),
        right=None if planar else axis(Y),
    )


def _axis(model: np.ndarray, recorded: np.ndarray) -> ComparedAxis:
    moves = np.ptp(model) > STILL_M and np.ptp(recorded) > STILL_M
    return ComparedAxis(
        rms_mm=MM_PER_M * float(np.sqrt(np.mean((recorded - model) ** 2))),
        correlation=float(np.corrcoef(model, recorded)[0, 1]) if moves else None,
        model_range_mm=MM_PER_M * float(np.ptp(model)),
        recorded_range_mm=MM_PER_M * float(np.ptp(recorded)),
    )


def _rms(vectors: np.ndarray) -> float:
    """Root mean square length of vectors (..., 3)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
