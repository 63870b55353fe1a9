"""Recordings of sensors (coils of an articulograph, markers) in a CSV: names of columns, axes, units and sampling rate."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from explicitfe.inverse.measured.c3d_file import read_c3d
from explicitfe.inverse.measured.curve import TIME
from explicitfe.inverse.measured.export import Export, ExportColumn, read_export
from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS
from explicitfe.inverse.measured.quantities import QUANTITIES, guessed, unit_of
from explicitfe.platform.errors import InputError, nearest, shortened

# Axis of a column -> axis of the model (x backwards, y to the speaker's right, z up), and sign.
ANATOMICAL_AXES = {
    "back": (0, 1.0), "backward": (0, 1.0), "front": (0, -1.0), "forward": (0, -1.0),
    "right": (1, 1.0), "left": (1, -1.0),
    "up": (2, 1.0), "down": (2, -1.0),
}  # fmt: skip
CARTESIAN_AXES = {"x": (0, 1.0), "y": (1, 1.0), "z": (2, 1.0)}
AXES = ANATOMICAL_AXES | CARTESIAN_AXES
_COORDINATE = re.compile(rf"(?P<sensor>.+?)[_ .:-](?P<axis>{'|'.join(AXES)})", re.IGNORECASE)
M_PER_MM = 1e-3  # lengths in QUANTITIES are in mm
C3D_SUFFIX = ".c3d"


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
        notes = list(self.notes)
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
    """Read a recording from a text table or a C3D file (suffix .c3d, see :func:`explicitfe.inverse.measured.c3d_file.read_c3d`).

    Columns of a table are ``SENSOR_AXIS`` with the unit in the name, such as ``T1_x_mm`` or ``TT_up (m)``. The axis is x, y or z,
    or a direction: forward, front, back, left, right, up, down. A time column is named ``time_s``, ``time_ms`` or similar. Other
    columns are ignored.

    Parameters
    ----------
    unit : of coordinates whose columns do not name one: "mm", "cm", "m", "µm" or "in"; in a C3D file it replaces the stated unit.
    rate_hz : sampling rate of a recording without a time column; in a C3D file it replaces the stated rate.
    axes : directions of x, y and z in a recording with these axes, such as "front,left,up".

    Raises
    ------
    InputError : the file cannot be read, or axes, units or times are missing or wrong.
    """
    if rate_hz is not None and not 0.0 < rate_hz < np.inf:
        raise InputError(f"`rate_hz` {rate_hz:g} is not possible; give the sampling rate, a number above 0.")
    if path.suffix.lower() == C3D_SUFFIX:
        markers = read_c3d(path, unit=unit, rate_hz=rate_hz)
        positions = {name: M_PER_MM * place for name, place in markers.positions_mm.items()}
        coils = Coils(path, markers.time_s, positions, "cartesian", planar=False, notes=markers.notes)
    else:
        coils = _read_table(path, unit, rate_hz)
    return coils if axes is None else _in_directions(coils, axes)


def _read_table(path: Path, unit: str | None, rate_hz: float | None) -> Coils:
    """Read a recording from a text table."""
    export = read_export(path)
    notes: list[str] = []
    sensors, ignored = _sensors(export)
    time_s, time = _time(export, [column for column in ignored if column.name], rate_hz)
    if extra := [column.name for column in ignored if column is not time]:
        notes.append(f"{path}: columns that are no coordinates are ignored: {_listed(extra)}.")
    axes_named = _axes_named(path, (axis for axes in sensors.values() for axis in axes))
    positions, planar = {}, set()
    for name, columns in sensors.items():
        places = {axis: _metres(export, column, unit) for axis, column in columns.items()}
        planar.add(len(places) == 2)
        positions[name] = _positions(path, name, places, notes)
    if len(planar) > 1:
        raise InputError(f"{path}: some sensors have two coordinates and others three; give the same axes for all.")
    later = np.append(True, np.diff(np.maximum.accumulate(np.where(np.isfinite(time_s), time_s, -np.inf))) > 0.0)
    later &= np.isfinite(time_s)
    if not later.all():
        notes.append(f"{path}: {(~later).sum()} rows whose time does not increase are omitted.")
    positions = {name: place[later] for name, place in positions.items()}
    return Coils(path, time_s[later], positions, axes_named, planar.pop(), notes)


def _in_directions(coils: Coils, axes: str) -> Coils:
    """Convert a recording with x, y, z to the axes of the model."""
    if coils.axes == "anatomical" or coils.planar:
        raise InputError(f"{coils.path}: `axes` is for recordings with x, y and z; omit it.")
    turn = parse_axes(axes)
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
    export = read_export(path)
    columns = {column.name.lower(): column for column in export.columns if column.name.lower() in AXES}
    if not columns:
        sensors, _ = _sensors(export)
        if len(sensors) > 1:
            raise InputError(f"{path}: a trace has one sensor, and this table has {_listed([*sensors])}; give the trace alone.")
        (columns,) = sensors.values()
    axes = _axes_named(path, columns)
    places = _positions(path, path.stem, {axis: _metres(export, column, unit) for axis, column in columns.items()}, [])
    return places[np.isfinite(places).all(axis=1)], axes


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


def _sensors(export: Export) -> tuple[dict[str, dict[str, ExportColumn]], list[ExportColumn]]:
    """Sensor -> axis -> column, and the columns that are no coordinates."""
    sensors: dict[str, dict[str, ExportColumn]] = {}
    others = []
    for column in export.columns:
        match = _COORDINATE.fullmatch(column.name)
        if match is None:
            others.append(column)
            continue
        axes = sensors.setdefault(match["sensor"], {})
        axis = match["axis"].lower()
        if axis in axes:
            raise InputError(f'{export.path}: two columns are called "{shortened(column.name)}"; give each sensor its own name.')
        axes[axis] = column
    if not sensors:
        bare = any(column.name.lower() in AXES for column in export.columns)
        names = ", ".join(shortened(column.name) for column in export.columns)
        raise InputError(
            f"{export.path}: no column is a coordinate of a sensor; name them SENSOR_AXIS_UNIT, such as T1_x_mm or TT_up_mm. "
            f"Columns: {names}.{' A trace of the palate is drawn by `compare --palate`.' if bare else ''}"
        )
    return sensors, others


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
        positions[:, number] = sign * values
    return positions


def _metres(export: Export, column: ExportColumn, unit: str | None) -> np.ndarray:
    """A column of lengths in m."""
    stated = column.unit or unit or ""
    known = unit_of("displacement", stated)
    valid = ", ".join(QUANTITIES["displacement"].units)
    if not stated:
        raise InputError(
            f'{export.path}: the unit of "{shortened(column.name)}" is not known; give `unit` mm or `unit` m, or name the column '
            f"{shortened(column.name)}_mm."
        )
    if known is None:
        raise InputError(f'{export.path}: "{shortened(stated)}" of "{shortened(column.name)}" is no unit of length; use {valid}.')
    values: np.ndarray = M_PER_MM * QUANTITIES["displacement"].units[known] * column.values
    return values


def _time(export: Export, columns: Sequence[ExportColumn], rate_hz: float | None) -> tuple[np.ndarray, ExportColumn | None]:
    """Times (k,) s, and the column that they are from; the sampling rate if it is given."""
    if rate_hz is not None:
        return np.arange(len(export.columns[0].values)) / rate_hz, None
    column = guessed(replace(export, columns=tuple(columns)), "time")
    if column is None:
        raise InputError(f"{export.path}: there is no time column; name one {TIME}, or give the sampling rate with `rate_hz`.")
    unit = unit_of("time", column.unit)
    if unit is None:
        raise InputError(
            f'{export.path}: the unit of "{shortened(column.name)}" is not known; name the column time_s or time_ms, or give the '
            f"sampling rate with `rate_hz`."
        )
    return QUANTITIES["time"].units[unit] * column.values, column


def _listed(names: Sequence[str]) -> str:
    most = 5
    shown = ", ".join(map(shortened, names[:most]))
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
