"""Writers of recordings as other programs make them; each takes times (k,) s and positions (k, sensors, 3) mm, nan if missing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.io import savemat

RATE_HZ, ROWS = 200.0, 57
NAMES = ("TT", "TB", "TD", "TR")
REST_MM = np.array([[70.0, 1.0, 108.0], [83.0, -1.0, 112.0], [98.0, 0.5, 110.0], [113.0, 2.0, 98.0]])


def movement() -> tuple[np.ndarray, np.ndarray]:
    """Times, and positions of four coils on a tongue with a smooth movement of 8 mm."""
    times_s = np.arange(ROWS) / RATE_HZ
    phase = np.sin(12.0 * times_s + np.arange(4)[:, None]).T
    return times_s, REST_MM + 4.0 * phase[:, :, None] * [1.0, 0.1, 0.6]


def cell(value: float, lost: str = "", comma: bool = False) -> str:
    text = lost if np.isnan(value) else f"{value:.5f}"
    return text.replace(".", ",") if comma else text


def rows(
    times_s: np.ndarray, places: np.ndarray, *, before: Sequence[Sequence[object]] = (), separator: str = "\t", **options
) -> list[str]:
    """Rows of a table; ``before``: cells in front of the coordinates."""
    front = before or [[f"{time:.4f}"] for time in times_s]
    return [
        separator.join([*map(str, cells), *(cell(value, **options) for value in row.ravel())])
        for cells, row in zip(front, places, strict=True)
    ]


def numbered(times_s: np.ndarray, **options) -> list[list[str]]:
    return [[str(k + 1), cell(time_s, **options)] for k, time_s in enumerate(times_s)]


def trc(times_s: np.ndarray, places: np.ndarray, *, unit: str = "mm", count: int = ROWS, blank: bool = True, **options) -> str:
    factor = {"mm": 1.0, "m": 1e-3}[unit]
    axes = "".join(f"\tX{k}\tY{k}\tZ{k}" for k in range(1, len(NAMES) + 1))
    head = [
        "PathFileType\t4\t(X/Y/Z)\tsubject.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{RATE_HZ}\t{RATE_HZ}\t{count}\t{len(NAMES)}\t{unit}\t{RATE_HZ}\t1\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(NAMES) + "\t\t",
        "\t" + axes,
        *([""] if blank else []),
    ]
    return "\n".join(head + rows(times_s, factor * places, before=numbered(times_s), **options)) + "\n"


def sto(times_s: np.ndarray, places: np.ndarray, *, vectors: bool = False, unit: str = "") -> str:
    """``unit``: stated in the header of vectors; metres if none is."""
    if vectors:
        head = ["DataRate=200", "DataType=Vec3", *([f"Units={unit}"] if unit else []), "endheader", "\t".join(["time", *NAMES])]
        shown = places if unit == "mm" else 1e-3 * places
        body = [[f"{t}", *(",".join(map(cell, place)) for place in row)] for t, row in zip(times_s, shown, strict=True)]
        return "\n".join([*head, *map("\t".join, body)]) + "\n"
    head = ["PointKinematics", f"nRows={len(times_s)}", f"nColumns={1 + 3 * len(NAMES)}", "inDegrees=no", "", "endheader"]
    head += ["\t".join(["time", *(f"{name}_{axis}" for name in NAMES for axis in "XYZ")])]
    return "\n".join([*head, *rows(times_s, 1e-3 * places)]) + "\n"


def motive(times_s: np.ndarray, places: np.ndarray, *, body: bool = False, unit: str = "Meters", start: int = 0) -> str:
    """As Motive 2 and 3 export it; ``body``: a rigid body with rotation, position, error, and the markers it expects."""
    kinds, names, sorts, axes = [], [], [], []
    if body:
        kinds += ["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3
        names += ["Head"] * 8 + ["TT"] * 3
        sorts += ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"] + ["Position"] * 3
        axes += [*"XYZWXYZ", "", *"XYZ"]
    kinds += ["Marker"] * 12
    names += [name for name in NAMES for _ in range(3)]
    sorts += ["Position"] * 12
    axes += [*"XYZ" * 4]
    factor = {"Meters": 1e-3, "Millimeters": 1.0}[unit]
    stated = [
        "Format Version",
        "1.23",
        "Take Name",
        "Take 1",
        "Capture Frame Rate",
        f"{RATE_HZ}",
        "Export Frame Rate",
        f"{RATE_HZ}",
    ]
    stated += ["Total Exported Frames", f"{len(times_s)}", "Rotation Type", "Quaternion", "Length Units", unit]
    ids = [f"{k:032X}" for k in range(len(names))]
    head = [",".join(stated), "", ",Type," + ",".join(kinds), ",Name," + ",".join(names), ",ID," + ",".join(ids)]
    head += [",," + ",".join(sorts), "Frame,Time (Seconds)," + ",".join(axes)]
    extra = ["0.1", "0.2", "0.3", "0.9", "1.0", "1.1", "1.2", "0.0001", "9", "9", "9"] if body else []
    front = [[str(start + k), f"{time:.6f}", *extra] for k, time in enumerate(times_s)]
    return "\n".join(head + rows(times_s, factor * places, before=front, separator=",")) + "\n"


def qtm(
    times_s: np.ndarray,
    places: np.ndarray,
    *,
    labels: bool = True,
    leading: int = 2,
    count: int | None = None,
    event: str = "",
    data: str = "3D",
    **options,
) -> str:
    stated = {"NO_OF_FRAMES": count or len(times_s), "NO_OF_CAMERAS": 8, "NO_OF_MARKERS": len(NAMES), "FREQUENCY": f"{RATE_HZ:g}",
              "NO_OF_ANALOG": 0, "ANALOG_FREQUENCY": 0, "DESCRIPTION": "--", "TIME_STAMP": "2024-05-01, 10:11:12.131\t12345.678",
              "DATA_INCLUDED": data}  # fmt: skip
    head = [f"{key}\t{value}" for key, value in stated.items()] + ["\t".join(["MARKER_NAMES", *NAMES])]
    head[-1:-1] = [f"EVENT\t{event}\t51\t0.5"] if event else []
    head += ["\t".join(["TRAJECTORY_TYPES", *["Measured"] * 4])]
    if labels:
        head += ["\t".join([*["Frame", "Time"][:leading], *(f"{name} {axis}" for name in NAMES for axis in "XYZ")])]
    front = [line[:leading] for line in numbered(times_s)]
    return "\n".join(head + rows(times_s, places, before=front, **options)) + "\n"


def sleap(times_s: np.ndarray, places: np.ndarray, *, tracks: int = 1, mm_per_px: float = 0.2) -> str:
    """Rows of a video as DeepLabCut has them; several tracks of the same animal in turn."""
    lines = ["track,frame_idx,instance.score," + ",".join(f"{name}.x,{name}.y,{name}.score" for name in NAMES)]
    for k, row in enumerate(places):
        cells = [cell(v) for x, _, z in row for v in (x / mm_per_px, 1000.0 - z / mm_per_px, 0.9)]
        lines += [",".join([f"track_{track}" if tracks > 1 else "", str(k), "0.9", *cells]) for track in range(tracks)]
    return "\n".join(lines) + "\n"


def wave(times_s: np.ndarray, places: np.ndarray, *, ok: str = "OK", bad: str = "Out of Volume", values: bool = False) -> str:
    """NDI WaveFront: identity, status, position and quaternion of each sensor; ``values``: also where it is lost."""
    head = ["Time", "MeasId", "WavId"]
    for k in range(1, len(NAMES) + 1):
        head += [f"Sensor {k} {word}" for word in ("Id", "Status", "X", "Y", "Z", "Q0", "Qx", "Qy", "Qz")]
    lines = ["\t".join(head)]
    for k, (time, row) in enumerate(zip(times_s, places, strict=True)):
        cells = [f"{time:.4f}", str(k), str(k)]
        for number, place in enumerate(row):
            lost = np.isnan(place).any()
            shown = ["1.0", "2.0", "3.0"] if values else [""] * 3
            cells += [str(number), bad if lost else ok, *(shown if lost else map(cell, place)), *["0.5"] * 4]
        lines.append("\t".join(cells))
    return "\n".join(lines) + "\n"


def deeplabcut(times_s: np.ndarray, places: np.ndarray, *, people: bool = False, mm_per_px: float = 0.2) -> str:
    """Rows of a video: x to the right, y down from the upper edge; a lost point has a low likelihood."""
    names = [name for name in NAMES for _ in range(3)]
    head = ["scorer," + ",".join(["DLC_resnet50"] * 12), *(["individuals," + ",".join(["me"] * 12)] if people else [])]
    head += ["bodyparts," + ",".join(names), "coords," + ",".join(["x", "y", "likelihood"] * 4)]
    lines = []
    for k, row in enumerate(places):
        cells = [str(k)]
        for place in row:
            lost = np.isnan(place).any()
            x, z = (5.0, 5.0) if lost else (place[0] / mm_per_px, 1000.0 - place[2] / mm_per_px)
            cells += [f"{x:.6f}", f"{z:.6f}", "0.02" if lost else "0.98"]
        lines.append(",".join(cells))
    return "\n".join(head + lines) + "\n"


def pos(
    times_s: np.ndarray, places: np.ndarray, *, version: int = 2, header: bool = True, channels: int = 16, more: str = ""
) -> bytes:
    """Carstens AG50x; the coils are the first channels, the others have no value."""
    frames = np.zeros((len(times_s), channels, 7), dtype="<f4")
    frames[:, : len(NAMES), :3] = np.nan_to_num(places)
    frames[:, : len(NAMES), 3:6] = [12.0, 34.0, 0.5]
    text = f"AG50xDATA_V00{version}\n{{:08d}}\nNumberOfChannels={channels}\nSamplingFrequencyHz={RATE_HZ:.0f}\n{more}\0"
    size = len(text.format(0))
    return (text.format(size).encode() if header else b"") + frames.tobytes()


def mview(path: Path, places: np.ndarray, *, columns: int = 6, rate_hz: float = RATE_HZ, name: str = "trial") -> Path:
    """mview: sound first, then a structure for each coil with position and orientation."""
    kinds = [("NAME", object), ("SRATE", object), ("SIGNAL", object), ("SOURCE", object)]
    channels = np.zeros((1, 1 + len(NAMES)), dtype=kinds)
    channels[0, 0] = ("AUDIO", 22050.0, np.zeros((100, 1)), "")
    for k, label in enumerate(NAMES):
        signal = np.column_stack([places[:, k], np.zeros((len(places), 3))])[:, :columns]
        channels[0, 1 + k] = (label, rate_hz, signal, "")
    savemat(path, {name: channels, "note": "a text"})
    return path


def table(
    times_s: np.ndarray,
    places: np.ndarray,
    *,
    names: str = "{name}_{axis}_mm",
    axes: str = "xyz",
    time: str | None = "time_s",
    above: Sequence[str] = (),
    units: Sequence[str] = (),
    separator: str = ",",
    two_lines: bool = False,
    factor: float = 1.0,
    **options,
) -> str:
    """A table of no known program; ``two_lines``: sensors stand above the axes; ``units``: of time and lengths."""
    shown = places[:, :, ["xyz".index(axis) for axis in axes]] * factor
    columns = [(name, axis) for name in NAMES for axis in axes]
    first = [] if time is None else [time]
    head = [separator.join([*first, *(names.format(name=name, axis=axis) for name, axis in columns)])]
    if two_lines:
        head = [separator.join(["", *(name if axis == axes[0] else "" for name, axis in columns)])]
        head += [separator.join([time or "", *(axis for _, axis in columns)])]
    if units:
        head += [separator.join([units[0], *[units[1]] * len(columns)])]
    front = [[]] * len(times_s) if time is None else [[cell(t, comma=options.get("comma", False))] for t in times_s]
    return "\n".join([*above, *head, *rows(times_s, shown, before=front, separator=separator, **options)]) + "\n"
