"""Headers of text tables with positions of markers: programs, and sensor, axis and unit of each column."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from explicitfe.inverse.measured.quantities import unit_of
from explicitfe.platform.errors import InputError

# Axis of a column -> axis of the model (x backwards, y to the speaker's right, z up), and sign.
ANATOMICAL_AXES = {
    "back": (0, 1.0), "backward": (0, 1.0), "front": (0, -1.0), "forward": (0, -1.0),
    "right": (1, 1.0), "left": (1, -1.0),
    "up": (2, 1.0), "down": (2, -1.0),
}  # fmt: skip
CARTESIAN_AXES = {"x": (0, 1.0), "y": (1, 1.0), "z": (2, 1.0)}
AXES = ANATOMICAL_AXES | CARTESIAN_AXES
LIKELIHOOD = "likelihood"
_KEY_OF_QTM = re.compile(r"[A-Z]+_?[A-Z_]+")
# "TT_x (mm)", "TT_x [mm]", "TT_x / mm", "TT_x, mm", "TT_x_mm": a name and a unit.
_NAMED_UNITS = (
    re.compile(r"(?P<name>.*?)\s*[(\[]\s*(?P<unit>[^()\[\]]*?)\s*[)\]]\s*"),
    re.compile(r"(?P<name>.*?)\s*(?:/|,\s)\s*(?P<unit>\S+)"),
    re.compile(r"(?P<name>.+)_(?P<unit>s|ms|min|mm|cm|m|um|µm|in)"),
)


@dataclass(frozen=True)
class Layout:
    """The header of a program.

    Attributes
    ----------
    sign : of the program in the header.
    unit : of lengths; where it begins with a capital letter, the key whose value it is.
    rate, rows : keys of the sampling rate and of the number of rows.
    below : whether values stand below their keys, not behind them.
    image : whether positions are those in a picture, whose vertical axis points down.
    """

    program: str
    sign: str
    unit: str = ""
    rate: str = ""
    rows: str = ""
    below: bool = False
    image: bool = False


LAYOUTS = (
    Layout("TRC", r"\APathFileType", "Units", "DataRate", "NumFrames", below=True),
    Layout("OpenSim", r"(?im)^endheader", "m", rows="nRows|datarows"),
    Layout("Motive", r"\AFormat Version", "Length Units", "Export Frame Rate", "Total Exported Frames"),
    Layout("Qualisys", r"(?m)^NO_OF_FRAMES", "mm", "FREQUENCY", "NO_OF_FRAMES"),
    Layout("NDI Wave", r"(?i)\b(WavId|Sensor 1 Status)\b", "mm"),
    Layout("DeepLabCut", r"\Ascorer", "px", image=True),
)
ANY_TABLE = Layout("", "")


@dataclass(frozen=True)
class MarkerColumn:
    """A column by its number, the words of the header, and the axis; empty if it is none."""

    number: int
    sensor: str
    axis: str
    unit: str
    kind: str = ""


def columns_of(path: Path, lines: Sequence[list[str]], width: int) -> list[MarkerColumn]:
    """Sensor, axis and unit of each column, from the lines of the header."""
    head = [row + [""] * (width - len(row)) for row in lines]
    names = next((row[1:] for row in head if row[0] == "MARKER_NAMES"), None)
    if names is not None and _KEY_OF_QTM.fullmatch(head[-1][0]):
        names = [name for name in names if name]
        before: list[str] | None = {0: [], 1: ["Frame"], 2: ["Frame", "Time"]}.get(width - 3 * len(names))
        if before is None:
            what = f"{width} columns are not three for each of the {len(names)} MARKER_NAMES"
            raise InputError(f"{path}: {what}; export positions (3D) with a column header.")
        head = [[*before, *(f"{name} {axis}" for name in names for axis in "XYZ")]]
    head = [row for row in head if len(row) == width] or [[""] * width]
    units = [""] * width
    if len(head) > 1 and sum(map(bool, head[-1])) > 1 and all(not cell or _bare_unit(cell) for cell in head[-1]):
        units, head = [_bare_unit(cell) for cell in head[-1]], head[:-1]
    axes = [_axis(cell) for cell in head[-1]]
    if sum(map(bool, axes)) > 1:
        labels = {next((cell for cell in row if cell), "").lower(): row for row in head[:-1]}
        above = (row for row in head[-2::-1] if any(cell and axis for cell, axis in zip(row, axes, strict=True)))
        named = next((labels[label] for label in ("name", "bodyparts", "frame#") if label in labels), None) or next(above, None)
        if named is not None:
            return _in_several_lines(head, named, labels, axes, units)
    columns = []
    for k, cell in enumerate(head[-1]):
        name, unit = _name_and_unit(cell)
        columns.append(MarkerColumn(k, name or f"column {k + 1}", "", units[k] or unit))
    return columns


def _in_several_lines(
    head: list[list[str]], named: list[str], labels: dict[str, list[str]], axes: Sequence[str], units: Sequence[str]
) -> list[MarkerColumn]:
    """Columns whose sensor stands above the axis, once for all its axes or above each of them."""
    kinds, types = next((row for row in head if "Position" in row), None), labels.get("type")
    people = labels.get("individuals", [])
    several = len({cell for cell in people[1:] if cell}) > 1
    columns, sensor = [], ""
    for k, cell in enumerate(head[-1]):
        name, unit = _name_and_unit(cell)
        axis = axes[k] or (name.lower() if name.lower() == LIKELIHOOD else "")
        sensor = named[k] or (sensor if axis else "")
        if axis and (kinds is None or kinds[k] == "Position"):
            whole = f"{people[k]} {sensor}" if several else sensor
            columns.append(MarkerColumn(k, whole, axis, units[k] or unit, types[k] if types else "Marker"))
        else:
            above, unit_above = _name_and_unit(named[k])
            alone = f"{sensor} {kinds[k] if kinds else ''} {name}" if axis else name or (kinds and kinds[k]) or above
            columns.append(MarkerColumn(k, alone.strip(), "", units[k] or unit or unit_above))
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
    for pattern in _NAMED_UNITS:
        match = pattern.fullmatch(cell.strip())
        if match:
            name, unit = match["name"].strip(), match["unit"]
            return (f"{name}_{unit}", "") if unit.lower() in AXES else (name, unit)  # "TT (x)"
    return cell.strip(), ""
