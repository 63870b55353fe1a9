"""Headers of text tables with positions of markers: programs, and sensor, axis and unit of each column."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from explicitfe.inverse.measured.cells import name_and_unit
from explicitfe.inverse.measured.quantities import unit_of
from explicitfe.platform.errors import InputError, shortened

# Axis of a column -> axis of the model (x backwards, y to the speaker's right, z up), and sign.
ANATOMICAL_AXES = {
    "back": (0, 1.0), "backward": (0, 1.0), "front": (0, -1.0), "forward": (0, -1.0),
    "right": (1, 1.0), "left": (1, -1.0),
    "up": (2, 1.0), "down": (2, -1.0),
}  # fmt: skip
CARTESIAN_AXES = {"x": (0, 1.0), "y": (1, 1.0), "z": (2, 1.0)}
AXES = ANATOMICAL_AXES | CARTESIAN_AXES
LIKELIHOOD = "likelihood"
_ALL = "|".join(AXES)
# Sensor and axis in one name. All but the first reading need two axes of the sensor: "apex" is no axis x of "ape".
_COORDINATES = (
    re.compile(rf"(?P<sensor>.+?)[_ .:-](?P<axis>{_ALL})", re.IGNORECASE),
    re.compile(rf"(?P<axis>{_ALL})[_ .:-](?P<sensor>.+)", re.IGNORECASE),
    re.compile(r"(?P<sensor>.+)(?P<axis>[xyzXYZ])"),
    re.compile(r"(?P<axis>[xyzXYZ])(?P<sensor>.+)"),
)
_NO_POSITION = re.compile(
    r"(.*[_ .:-])?(q|quat\w*|rot\w*|euler|angles?|vel\w*|speed|acc\w*|forces?|moments?|torque|orientation)", re.IGNORECASE
)
_ROTATION = re.compile(r".*[_ .:-]r", re.IGNORECASE)  # about an axis: "jaw_rx"
_KEY_OF_QTM = re.compile(r"[A-Z]+_?[A-Z_]+")
_SORTS_OF_MOTIVE = {"", "Marker", "Rigid Body", "Rigid Body Marker", "Bone", "Bone Marker"}


@dataclass(frozen=True)
class Layout:
    """The header of a program.

    Attributes
    ----------
    sign : of the program in the header.
    unit, unit_key : unit of lengths, and the key that states it.
    rate, rows : keys of the sampling rate and of the number of rows.
    below : whether values stand below their keys, not behind them.
    image : whether positions are those in a picture, whose vertical axis points down.
    """

    program: str
    sign: str
    unit: str = ""
    unit_key: str = ""
    rate: str = ""
    rows: str = ""
    below: bool = False
    image: bool = False


LAYOUTS = (
    Layout("TRC", r"\APathFileType", "", "Units", "DataRate", "NumFrames", below=True),
    # "Units are S.I. units" states none.
    Layout("OpenSim", r"(?im)^endheader", "m", r"Units(?=\s*=)", rows="nRows|datarows"),
    Layout("Motive", r"\AFormat Version", "", "Length Units", "Export Frame Rate", "Total Exported Frames"),
    Layout("Qualisys", r"(?m)^NO_OF_FRAMES", "mm", "", "FREQUENCY", "NO_OF_FRAMES"),
    Layout("NDI Wave", r"(?i)\b(WavId|Sensor 1 Status)\b", "mm"),
    Layout("DeepLabCut", r"\Ascorer", "px", image=True),
    Layout("SLEAP", r"(?im)\A(.*,)?frame_idx,.*\binstance\.score\b", "px", image=True),
)
ANY_TABLE = Layout("", "")


@dataclass(frozen=True)
class MarkerColumn:
    """A column by its number. ``axis`` is empty if it is no coordinate; ``name`` is then what the header says."""

    number: int
    name: str  # of the sensor
    axis: str
    unit: str

    @property
    def words(self) -> str:
        """Name for messages."""
        return shortened(f"{self.name}_{self.axis}" if self.axis else self.name)


def columns_of(path: Path, lines: Sequence[list[str]], width: int) -> list[MarkerColumn]:
    """Sensor, axis and unit of each column, from the lines of the header."""
    head = [row + [""] * (width - len(row)) for row in lines if len(row) <= width] or [[""] * width]
    names = next((row[1:] for row in lines if row[0] == "MARKER_NAMES"), None)
    if names is not None and _KEY_OF_QTM.fullmatch(lines[-1][0]):
        before = {0: [], 1: ["Frame"], 2: ["Frame", "Time"]}.get(width - 3 * len(names))
        if before is None:
            what = f"{width} columns are not three for each of the {len(names)} MARKER_NAMES"
            raise InputError(f"{path}: {what}; export positions (3D) with a column header.")
        head = [[*before, *(f"{name} {axis}" for name in names for axis in "XYZ")]]
    units = [""] * width
    if len(head) > 1 and sum(map(bool, head[-1])) > 1 and all(not cell or _bare_unit(cell) for cell in head[-1]):
        units = [_bare_unit(cell) for cell in head.pop()]
    split = [_name_and_unit(cell) for cell in head[-1]]
    axes = [_axis(cell) for cell in head[-1]]
    if sum(map(bool, axes)) > 1:
        labels = {next((cell for cell in row if cell), "").lower(): row for row in head[:-1]}
        for sorts, name in pairwise(head[:-1]):
            if any(sorts) and {*sorts} <= _SORTS_OF_MOTIVE:
                labels = {"type": sorts, "name": name} | labels  # Old versions do not name these lines.
        above = (row for row in head[-2::-1] if any(cell and axis for cell, axis in zip(row, axes, strict=True)))
        sensors = next((labels[label] for label in ("name", "bodyparts", "frame#") if label in labels), None) or next(above, None)
        if sensors is not None:
            return _below_sensors(head, sensors, labels, axes, [own or unit for own, (_, unit) in zip(units, split, strict=True)])
    columns = [MarkerColumn(k, name or f"column {k + 1}", "", units[k] or unit) for k, (name, unit) in enumerate(split)]
    for number, pattern in enumerate(_COORDINATES):
        matches = {column: match for column in columns if (match := pattern.fullmatch(column.name))}
        coordinates = {c: (match["sensor"].strip(), match["axis"].lower()) for c, match in matches.items()}
        several = [sensor for sensor, _ in coordinates.values()]
        coordinates = {
            column: (sensor, axis)
            for column, (sensor, axis) in coordinates.items()
            if not _NO_POSITION.fullmatch(sensor)
            and (number == 0 or several.count(sensor) > 1)
            and not (number == 2 and not column.unit and (_ROTATION.fullmatch(sensor) or (sensor == "r" and "t" in several)))
        }
        if coordinates:
            return [replace(c, name=coordinates[c][0], axis=coordinates[c][1]) if c in coordinates else c for c in columns]
    return columns


def _below_sensors(
    head: list[list[str]], sensors: list[str], labels: dict[str, list[str]], axes: Sequence[str], units: Sequence[str]
) -> list[MarkerColumn]:
    """Columns whose sensor stands above the axis, once for all its axes or above each of them."""
    kinds, types = next((row for row in head if "Position" in row), None), labels.get("type", [])
    people = labels.get("individuals", [])
    several = len({cell for cell in people[1:] if cell}) > 1
    columns, sensor = [], ""
    for k, cell in enumerate(head[-1]):
        own, unit_above = _name_and_unit(sensors[k])
        axis = LIKELIHOOD if cell.lower() == LIKELIHOOD else axes[k]
        sensor = sensors[k] or (sensor if axis else "")
        # Motive: where a solved body expects a marker that was seen.
        expected = bool(types) and types[k] in ("Rigid Body Marker", "Bone Marker") and "Marker" in types
        if axis and (kinds is None or kinds[k] == "Position") and not expected:
            columns.append(MarkerColumn(k, f"{people[k]} {sensor}" if several else sensor, axis, units[k]))
        else:
            what = f"{sensor} {types[k] if expected else kinds[k] if kinds else ''} {cell}" if axis else ""
            unit = _bare_unit(cell) if own else ""  # "s" below "Time"
            name = what or (own if unit else _name_and_unit(cell)[0]) or (kinds and kinds[k]) or own
            columns.append(MarkerColumn(k, name, "", units[k] or unit_above or unit))
    return columns


def _axis(cell: str) -> str:
    """Axis that a cell of the header names, as in "X1" or "x (mm)"; empty if none."""
    word = _name_and_unit(cell)[0].lower().rstrip("0123456789")
    return word if word in AXES else ""


def _bare_unit(cell: str) -> str:
    """Unit of a length or a time that a cell consists of; empty if it is none."""
    word = cell.strip().strip("[]()")
    return word if any(unit_of(quantity, word) for quantity in ("displacement", "time")) or cell != word else ""


def _name_and_unit(cell: str) -> tuple[str, str]:
    name, unit = name_and_unit(cell.strip())
    return (f"{name}_{unit}", "") if unit.lower() in AXES else (name, unit)  # "TT (x)"
