"""Recordings of sensors (coils of an articulograph, markers): axes, rows, and the mapping of sensors to points of a model."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from explicitfe.inverse.measured.c3d_file import read_c3d
from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS, later_rows
from explicitfe.inverse.measured.marker_doubts import doubts, without_lost_markers
from explicitfe.inverse.measured.marker_file import Markers, content_of, read_mview, read_pos
from explicitfe.inverse.measured.marker_header import ANATOMICAL_AXES, AXES
from explicitfe.inverse.measured.marker_table import read_marker_table, some_names
from explicitfe.platform.errors import InputError, nearest, shortened

M_PER_MM = 1e-3

AxesKind = Literal["anatomical", "cartesian"]


@dataclass(frozen=True, eq=False)
class Coils:
    """Positions of sensors over time.

    Attributes
    ----------
    time_s : (k,), strictly increasing; it need not begin at 0.
    positions : name of a sensor -> (k, 3) m, nan where a value is missing.
    axes : "anatomical" if the columns name directions, so that the axes are those of the model; "cartesian" if they are x, y, z.
    planar : whether only two coordinates were recorded; the lateral one is then 0.
    notes : sentences on columns and rows that were omitted or interpreted.
    """

    path: Path
    time_s: np.ndarray
    positions: dict[str, np.ndarray]
    axes: AxesKind
    planar: bool
    notes: list[str] = field(default_factory=list)

    def select(self, sensors: Iterable[str], start_s: float = -np.inf, end_s: float = np.inf, *, complete: bool = True) -> Coils:
        """Keep some sensors, the rows of an interval of time, and if ``complete`` of those the rows without a missing value.

        Raises
        ------
        InputError : there is no such sensor, or fewer than three rows are left.
        """
        positions = {name: self.sensor(name) for name in sensors}
        inside = (self.time_s >= start_s) & (self.time_s <= end_s)
        whole = np.all([np.isfinite(place).all(axis=1) for place in positions.values()], axis=0)
        rows = inside & whole if complete else inside
        if rows.sum() < SMALLEST_CURVE_ROWS:
            start_s, end_s = max(start_s, self.time_s[0]), min(end_s, self.time_s[-1])
            raise InputError(
                f"{self.path}: {rows.sum()} rows between {start_s:g} and {end_s:g} s have a value for each of "
                f"{', '.join(positions)}; at least {SMALLEST_CURVE_ROWS} are needed."
            )
        notes = [*self.notes, *doubts(self.path, self.time_s[inside], {name: place[inside] for name, place in positions.items()})]
        missing = int((inside & ~rows).sum())
        if missing:
            notes.append(f"{self.path}: {missing} rows with a missing value are omitted.")
        return replace(
            self, time_s=self.time_s[rows], positions={name: place[rows] for name, place in positions.items()}, notes=notes
        )

    def sensor(self, name: str) -> np.ndarray:
        """Positions (k, 3) m of a sensor.

        Raises
        ------
        InputError : there is none of that name.
        """
        if name not in self.positions:
            raise InputError(f'{self.path}: there is no sensor "{shortened(name)}"; {nearest(name, self.positions)}')
        return self.positions[name]


def read_coils(path: Path, *, unit: str | None = None, rate_hz: float | None = None, axes: str | None = None) -> Coils:
    """Read a recording: C3D, ``.pos`` of an articulograph, ``.mat`` of mview, or a text table.

    The format is recognised by the content of the file. Columns of a table are ``SENSOR_AXIS`` with the unit in the name, such as
    ``T1_x_mm`` or ``TT_up (m)``, or have the sensor above the axis; TRC, STO, and exports of Motive, Qualisys, NDI Wave,
    DeepLabCut and SLEAP are among them (:mod:`explicitfe.inverse.measured.marker_table`). The axis is x, y or z, or a direction:
    forward, front, back, left, right, up, down. A time column is named ``time_s``, ``time_ms`` or similar. Other columns are
    ignored. A sensor at exactly (0, 0, 0) is missing.

    Parameters
    ----------
    unit : of coordinates whose columns do not name one: "mm", "cm", "m", "µm" or "in", also with a factor such as "0.2mm";
        it replaces the unit that a file of a known program states.
    rate_hz : sampling rate of a recording without a time column; it replaces the rate or the times in the file.
    axes : directions of x, y and z in a recording with these axes, such as "front,left,up".

    Raises
    ------
    InputError : the file cannot be read, or axes, units or times are missing or wrong.
    """
    if rate_hz is not None and not 0.0 < rate_hz < np.inf:
        raise InputError(f"`rate_hz` {rate_hz:g} is not possible; give the sampling rate, a number above 0.")
    markers = _reader(path)(path, unit=unit, rate_hz=rate_hz)
    notes = markers.notes
    axes_named = _axes_named(path, (axis for coordinates in markers.coordinates_mm.values() for axis in coordinates))
    planar = {len(coordinates) == 2 for coordinates in markers.coordinates_mm.values()}
    if len(planar) > 1:
        raise InputError(f"{path}: some sensors have two coordinates and others three; give the same axes for all.")
    later = later_rows(path, markers.time_s)
    if not later.all():
        notes.append(f"{path}: {(~later).sum()} rows whose time does not increase are omitted.")
    if later.sum() < SMALLEST_CURVE_ROWS:
        raise InputError(f"{path}: {later.sum()} rows have increasing times; at least {SMALLEST_CURVE_ROWS} are needed.")
    places = {name: _positions(path, name, axes, notes)[later] for name, axes in markers.coordinates_mm.items()}
    seen = without_lost_markers(path, markers.time_s[later], places, planar == {True}, notes)
    coils = Coils(path, markers.time_s[later], seen, axes_named, planar.pop(), notes)
    return coils if axes is None else _in_directions(coils, axes, markers.up)


def _reader(path: Path) -> Callable[..., Markers]:
    """The reader of a file, by its first bytes; AG500 and damaged files by their names."""
    start, suffix = content_of(path)[:128], path.suffix.lower()
    if suffix == ".c3d" or (start[1:2] == b"\x50" and start[:1] < b" "):
        return read_c3d
    if start.startswith(b"AG50x") or suffix == ".pos":
        return read_pos
    return read_mview if start.startswith((b"MATLAB ", b"\x89HDF")) or suffix == ".mat" else read_marker_table


def _in_directions(coils: Coils, axes: str, up: str) -> Coils:
    """Convert a recording with x, y, z to the axes of the model."""
    if coils.axes == "anatomical" or coils.planar:
        raise InputError(f"{coils.path}: `axes` is for recordings with x, y and z; omit it.")
    turn = parse_axes(axes)
    given = "".join(f"{'-' if turn[row, 2] < 0.0 else '+'}{'XYZ'[row]}" for row in np.flatnonzero(turn[:, 2]))
    if re.fullmatch("[+-][XYZ]", up) and up != given:
        coils.notes.append(f"{coils.path}: the file states that {up} points up (POINT:Y_SCREEN), and `axes` that {given} does.")
    return replace(coils, axes="anatomical", positions={name: place @ turn for name, place in coils.positions.items()})


def parse_axes(words: str) -> np.ndarray:
    """Parse the directions of x, y and z, such as ``front,left,up``: M (3, 3), so that x_model = x M.

    Raises
    ------
    InputError : these are not three directions along different axes.
    """
    names = [word.strip().lower() for word in words.split(",")]
    turn = np.zeros((3, 3))
    if len(names) == 3 and set(names) <= set(ANATOMICAL_AXES):
        for row, name in enumerate(names):
            number, sign = ANATOMICAL_AXES[name]
            turn[row, number] = sign
    if abs(np.linalg.det(turn)) < 0.5:
        raise InputError(f"`axes` {shortened(words)}: give the directions of x, y and z, such as `axes` front,left,up.")
    return turn


def read_trace(path: Path, *, unit: str | None = None) -> tuple[np.ndarray, AxesKind]:
    """Read the points of a trace, such as the midline of the palate: positions (k, 3) m, and what the axes are (see Coils).

    The columns are axes with the unit, such as ``front_mm`` and ``up_mm``, or those of one sensor. A missing lateral coordinate
    is 0. Rows with a missing value are omitted.

    Raises
    ------
    InputError : the file cannot be read, axes or units are missing or wrong, or there are several sensors.
    """
    sensors = read_marker_table(path, unit=unit, trace=True).coordinates_mm
    if len(sensors) > 1:
        raise InputError(f"{path}: a trace has one sensor, and this table has {some_names([*sensors])}; give the trace alone.")
    ((name, columns),) = sensors.items()
    places = _positions(path, name, columns, [])
    return places[np.isfinite(places).all(axis=1)], _axes_named(path, columns)


def parse_mapping(words: Sequence[str]) -> dict[str, str]:
    """Parse ``POINT=SENSOR`` pairs: point of the model -> sensor.

    Raises
    ------
    InputError : a pair is not of this form, or a point or a sensor is mapped twice.
    """
    mapping: dict[str, str] = {}
    for word in words:
        point, equals, sensor = (part.strip() for part in word.partition("="))
        if not (point and equals and sensor):
            raise InputError(f"`mapping` {shortened(word)}: write POINT=SENSOR, such as `mapping` tip=T1.")
        if point in mapping or sensor in mapping.values():
            twice = f'point "{point}"' if point in mapping else f'sensor "{sensor}"'
            raise InputError(f"`mapping` {shortened(word)}: the {shortened(twice)} is mapped twice; map each of them once.")
        mapping[point] = sensor
    return mapping


def parse_interval(words: str, option: str) -> tuple[float, float]:
    """Parse ``START:END`` in seconds.

    Raises
    ------
    InputError : it is not of this form, or does not increase.
    """
    try:
        start_s, end_s = (float(part) for part in words.split(":"))
    except ValueError:
        start_s, end_s = np.nan, np.nan
    if not start_s < end_s:
        raise InputError(f"{option} {shortened(words)}: write START:END in seconds, such as {option} 0.2:0.5.")
    return start_s, end_s


def _axes_named(path: Path, axes: Iterable[str]) -> AxesKind:
    """Whether axes are directions or x, y, z."""
    kinds = {axis in ANATOMICAL_AXES for axis in axes}
    if len(kinds) > 1:
        raise InputError(f"{path}: some columns have the axes x, y, z and others directions such as up; use one of the two.")
    return "anatomical" if kinds.pop() else "cartesian"


def _positions(path: Path, name: str, places: dict[str, np.ndarray], notes: list[str]) -> np.ndarray:
    """Positions (k, 3) m of one sensor in three axes; the lateral coordinate of a planar recording is 0."""
    if set(places) == {"x", "y"}:  # planar recordings call the vertical axis y
        places = {"x": places["x"], "z": places["y"]}
        note = f"{path}: the sensors have x and y only; x is taken as horizontal and y as vertical in the midsagittal plane."
        notes += [note] if note not in notes else []
    positions = np.zeros((len(next(iter(places.values()))), 3))
    axes = {AXES[axis][0] for axis in places}
    if len(axes) < len(places) or not axes >= {0, 2}:
        raise InputError(
            f'{path}: sensor "{shortened(name)}" has the axes {", ".join(places)}; give x, y, z, or x and z, or directions '
            f"such as forward, right, up."
        )
    for axis, values in places.items():
        number, sign = AXES[axis]
        positions[:, number] = sign * M_PER_MM * values
    return positions
