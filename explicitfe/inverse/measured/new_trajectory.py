"""Make a trajectory dataset from recordings of sensors."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from explicitfe.inverse.measured.coils import Coils
from explicitfe.inverse.measured.curve import TIME
from explicitfe.inverse.measured.new_dataset import (
    CurveToWrite,
    DatasetDescription,
    NewDataset,
    check_free,
    thinned,
    write_folder,
)
from explicitfe.inverse.measured.registration import check_directions, determine_a_rotation, procrustes, turns_over
from explicitfe.inverse.measured.tables import RegistrationTable, TestKind
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.shipped import scenario_file, scenarios
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy.tongue import anatomy_of
from explicitfe.simulate.scenario.read import read_transient

SCENARIO_FILE = "scenario.toml"  # the copy of a bundled scenario
MM_PER_M, MS_PER_S = 1e3, 1e3
_SETTINGS = "# Settings of the scenario for this curve, such as loads, written as for --set: conditions.settings = [...]"


@dataclass(frozen=True, kw_only=True)
class TrajectoryDescription(DatasetDescription):
    """Properties of recordings that their tables do not state.

    Attributes
    ----------
    mapping : point of the model, or a position ``X,Y,Z`` in mm in the frame of the scenario -> sensor; without a scenario it must
        be empty. Sensors at positions are markers on a body, see :mod:`explicitfe.inverse.close_loop.trajectories.markers`.
    fixed : markers that sit on what does not move.
    scenario : the scenario to compare with: a file, or the name of a bundled one; None for data alone.
    noise_mm : standard deviation of a coordinate; None if unknown.
    interval_s : rows of the recordings to use, in their own time; None for all. The first of them is time 0 of the scenario.
    one_speaker : whether all recordings are of the same speaker.
    """

    test: TestKind = "trajectory"
    mapping: Mapping[str, str] = field(default_factory=dict)
    fixed: Sequence[str] = ()
    scenario: Path | None = None
    noise_mm: float | None = None
    interval_s: tuple[float, float] | None = None
    one_speaker: bool = False

    @cached_property
    def places_mm(self) -> dict[str, list[float]]:
        """Marker -> its position; empty if sensors are mapped to points of the model.

        Raises
        ------
        InputError : some are mapped to positions and others to points.
        """
        places = {}
        for point, sensor in self.mapping.items():
            try:
                place = [float(word) for word in point.split(",")]
            except ValueError:
                continue
            if len(place) != 3 or not np.isfinite(place).all():
                raise InputError(f"`mapping` {point}={sensor}: a position is X,Y,Z in mm, such as `mapping` 100,15,36={sensor}.")
            places[sensor] = place
        if places and len(places) < len(self.mapping):
            point = next(point for point, sensor in self.mapping.items() if sensor not in places)
            raise InputError(f"`mapping` {point}: other sensors are mapped to positions; give a position for each of them.")
        return places


def write_new_trajectory(out: Path, recordings: Sequence[Coils], description: TrajectoryDescription) -> NewDataset:
    """Write the folder of a trajectory dataset: dataset.toml, a CSV for each recording, and a copy of a bundled scenario.

    Parameters
    ----------
    out : a folder that does not exist or is empty.
    recordings : all with the mapped sensors.

    Raises
    ------
    InputError : the folder is not empty; a point, sensor or scenario does not exist; or a value is outside its range. Nothing is
        written.
    """
    check_free(out)
    notes: list[str] = []
    scenario = None if description.scenario is None else scenario_file(description.scenario)
    if scenario is None and description.mapping:
        raise InputError("`mapping` needs a scenario whose points are mapped; add `scenario`, such as `scenario` vowel-i.")
    turns = False
    for name in description.fixed:
        if name not in description.places_mm:
            raise InputError(f"`fixed` {name}: this marker has no position; add it, such as `mapping` 6,-10,-1={name}.")
    if scenario is not None:
        notes += _check_scenario(scenario, description, recordings)
    if scenario is not None and not description.places_mm:
        turns = _fits_rotation(scenario, description, recordings[0], notes)
    bundled = scenario is not None and scenario in scenarios().values()
    relative = None
    if scenario is not None:
        relative = SCENARIO_FILE if bundled else Path(os.path.relpath(scenario.resolve(), out.resolve())).as_posix()
    keys = ['start_s = "fit"', _SETTINGS] if description.places_mm else []
    keys += ['group = "speaker"'] if description.one_speaker and len(recordings) > 1 else []
    curves = [
        CurveToWrite(coils.path, *_table(coils, description, notes), keys, _origin(coils, description)) for coils in recordings
    ]
    files = {SCENARIO_FILE: scenario.read_bytes()} if scenario is not None and bundled else None
    written = write_folder(out, description, _tables(turns, relative, description), curves, scenario=relative, files=files)
    on = "at ({}) mm" if description.places_mm else "on {}"
    points = {sensor: on.format(point) for point, sensor in description.mapping.items()}
    sensors = list(dict.fromkeys(column.rpartition("_")[0][:-2] for column in curves[0].columns[1:]))
    return {
        "dataset": str(out),
        "test": description.test,
        "columns": {name: points.get(name, "not mapped to a point") for name in sensors},
        "curves": written,
        "notes": list(dict.fromkeys(notes)),
    }


def _check_scenario(path: Path, description: TrajectoryDescription, recordings: Sequence[Coils]) -> list[str]:
    """Check that the scenario is transient and has the mapped points; notes on recordings that are longer than it."""
    scenario = read_transient(path)
    if not description.mapping:
        raise InputError("`mapping` is missing; map at least one point of the scenario to a sensor, such as `mapping` tip=T1.")
    points = anatomy_of(scenario.model, path.parent).mesh.named_points
    for point in description.mapping:
        if point not in points and not description.places_mm:
            raise InputError(f"`mapping` {point}: the model of {path.stem} has no such point; {nearest(point, points)}")
    notes = []
    start_s, end_s = description.interval_s or (-np.inf, np.inf)
    for coils in recordings:
        inside = coils.time_s[(coils.time_s >= start_s) & (coils.time_s <= end_s)]
        lasts_s, simulated_s = float(np.ptp(inside)) if len(inside) else 0.0, scenario.analysis.duration_ms / MS_PER_S
        if lasts_s > simulated_s * (1.0 + 1e-9):
            notes.append(
                f"{coils.path}: the recording lasts {lasts_s:.4g} s and the scenario {simulated_s:.4g} s; select rows with "
                f"`interval_s`, or increase analysis.duration_ms of the scenario before close-loop."
            )
    return notes


def _fits_rotation(path: Path, description: TrajectoryDescription, coils: Coils, notes: list[str]) -> bool:
    """Whether the mean positions of the mapped sensors determine a rotation that keeps the directions of the recording."""
    points = anatomy_of(read_transient(path).model, path.parent).mesh.named_points
    where = np.stack([np.nanmean(coils.sensor(sensor), axis=0) for sensor in description.mapping.values()])
    if not determine_a_rotation(where):
        return False
    undeformed = np.concatenate([points[point].position for point in description.mapping])
    if coils.planar:
        undeformed = undeformed * [1.0, 0.0, 1.0]
    fitted = procrustes(RegistrationTable(rotation="fit", translation="fit"), undeformed, where)
    check_directions(coils.path, fitted, undeformed, where, where, coils.axes, coils.planar)
    if turns_over(fitted, coils.axes, coils.planar):
        notes.append(
            f"a fitted rotation would turn the recording by {fitted.turn_deg:.0f}°, because the sensors lie nearly on a line; "
            f'only the translation is fitted. To fit the rotation too, add rotation = "fit" to [registration].'
        )
        return False
    return True


def _origin(coils: Coils, description: TrajectoryDescription) -> list[str]:
    """Comments on a recording: file, sampling rate, sensors, and rows with missing values."""
    start_s, end_s = description.interval_s or (-np.inf, np.inf)
    inside = (coils.time_s >= start_s) & (coils.time_s <= end_s)
    missing = {name: int((~np.isfinite(place[inside]).all(axis=1)).sum()) for name, place in coils.positions.items()}
    rate_hz = 1.0 / float(np.median(np.diff(coils.time_s)))
    lines = [
        f"Source: {coils.path.name}, {rate_hz:.5g} Hz, {len(coils.time_s)} rows, {int(inside.sum())} of them selected.",
        f"Sensors in the source: {', '.join(coils.positions)}.",
    ]
    if any(missing.values()):
        counts = ", ".join(f"{name} {count}" for name, count in missing.items() if count)
        omitted = "" if description.places_mm else " Rows without a value of a mapped sensor are omitted."
        lines.append(f"Selected rows with missing values: {counts}.{omitted}")
    else:
        lines.append("Selected rows with missing values: none.")
    return ["# " + "".join(letter if letter.isprintable() else " " for letter in line) for line in lines]


def _table(coils: Coils, description: TrajectoryDescription, notes: list[str]) -> tuple[list[str], np.ndarray]:
    """Column names and rows of a recording: mapped sensors, and others without a missing value."""
    start_s, end_s = description.interval_s or (-np.inf, np.inf)
    inside = (coils.time_s >= start_s) & (coils.time_s <= end_s)
    mapped = [name for name in description.mapping.values() if coils.sensor(name) is not None]
    whole = [name for name, place in coils.positions.items() if np.isfinite(place[inside]).all()]
    kept = [name for name in coils.positions if name in mapped or (name in whole and inside.any())]
    omitted = [name for name in coils.positions if name not in kept]
    if omitted:
        notes.append(f"{coils.path}: sensors with missing values are omitted: {', '.join(omitted)}.")
    if not kept:
        raise InputError(f"{coils.path}: every sensor has missing values; select complete rows with `interval_s`.")
    chosen = coils.select(kept, start_s, end_s, complete=not description.places_mm)
    notes += chosen.notes
    if coils.axes == "anatomical":
        notes.append("coordinates are converted to the axes of the model: x backwards, y to the speaker's right, z up.")
    if coils.planar:
        notes.append("the recording has two coordinates; the lateral one (y) is set to 0 and is not compared.")
    columns = [
        chosen.time_s - chosen.time_s[0],
        *(MM_PER_M * place[:, k] for place in chosen.positions.values() for k in range(3)),
    ]
    head = [TIME, *(f"{name}_{axis}_mm" for name in chosen.positions for axis in "xyz")]
    return head, thinned(coils.path, np.column_stack(columns) + 0.0, notes)  # no -0


def _tables(turns: bool, scenario: str | None, description: TrajectoryDescription) -> list[str]:
    """Lines of dataset.toml on sensors, registration and noise."""
    lines = []
    if description.places_mm:
        lines.append('# Constants of the scenario that are not known: fit = ["stiffness"]')
    for point, sensor in description.mapping.items():
        place = description.places_mm.get(sensor)
        where = f"model_point = {toml_value(point)}" if place is None else f"at_mm = {toml_value(place)}"
        lines += [
            "",
            "[[sensor]]",
            f"name = {toml_value(sensor)}",
            where,
            *(["fixed = true"] if sensor in description.fixed else []),
        ]
    if scenario is not None and not description.places_mm:
        lines += ["", "[registration]", *(['rotation = "fit"'] if turns else []), 'translation = "fit"']
    if description.noise_mm is not None:
        lines += ["", "[noise]", f"displacement_sd_mm = {toml_value(description.noise_mm)}"]
    return lines
