"""Recordings in C3D files (motion capture): positions of markers, unit, sampling rate and missing values."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS
from explicitfe.inverse.measured.marker_file import EXPORT_AGAIN, Markers, by_axis, content_of, mm_per_unit, plain_names
from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.extras import require

# Parameters that list points which are no positions: results of gait models, such as angles in degrees.
NO_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "REACTIONS", "SCALARS")


def read_c3d(path: Path, *, unit: str | None = None, rate_hz: float | None = None) -> Markers:
    """Read a recording from a C3D file.

    Missing positions (residual below 0) are nan. Markers that are never visible and points that are no positions are omitted.

    Parameters
    ----------
    unit : of the positions, in place of POINT:UNITS in the file.
    rate_hz : sampling rate, in place of POINT:RATE in the file.

    Raises
    ------
    InputError : the package c3d is not installed; the file cannot be read, is damaged, or has no markers; or unit or rate is not
        known.
    """
    require("c3d", "reading a C3D file")
    content = content_of(path)
    notes: list[str] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on parameters that are not used here
            reader = _reader(content)
            rate = _rate(path, reader, rate_hz)
            up = next(_words(reader, "Y_SCREEN"), "")
            frames = _frames(path, reader)  # (k, markers, 4): x, y, z, residual
            names, others = _names(reader, frames.shape[1])
            labels = _words(reader, "LABELS")
            if again := [name for name, label in zip(names, labels, strict=False) if name.startswith(f"{label} ")]:
                notes.append(f"{path}: labels that occur again have a number: {', '.join(map(shortened, again))}.")
            factor = mm_per_unit(path, next(_words(reader, "UNITS"), ""), unit, " (POINT:UNITS)", notes)
    except InputError:
        raise
    except Exception as error:  # the library raises what its parsing meets: struct.error, AssertionError, KeyError, ...
        reason = f" ({shortened(str(error))})" if isinstance(error, AssertionError) else ""
        raise InputError(f"{path}: this is no C3D file, or it is damaged{reason}; {EXPORT_AGAIN}.") from None
    places = np.where(frames[:, :, 3:] < 0.0, np.nan, factor * frames[:, :, :3])
    if others:
        notes.append(f"{path}: points that are no positions are ignored: {', '.join(map(shortened, sorted(others)))}.")
    positions = {name: by_axis(places[:, k]) for k, name in enumerate(names) if name not in others}
    return Markers(np.arange(len(places)) / rate, positions, notes, up)


def _reader(content: bytes) -> Any:
    """A reader of the file with its parameters."""
    import c3d

    class Reader(c3d.Reader):  # type: ignore[misc, unused-ignore]
        @property
        def analog_per_frame(self) -> int:
            """Number of analog samples per frame, also of a file without a rate."""
            return int(self.header.analog_per_frame)

    return Reader(io.BytesIO(content))


def _rate(path: Path, reader: Any, rate_hz: float | None) -> float:
    """Sampling rate in Hz."""
    if rate_hz is not None:
        return rate_hz
    rate = float(reader.point_rate)
    if not 0.0 < rate < np.inf:
        raise InputError(f"{path}: the C3D file does not state a sampling rate; give it with `rate_hz`.")
    return rate


def _frames(path: Path, reader: Any) -> np.ndarray:
    """Coordinates and residual of all points (frames, points, 4), in the unit of the file."""
    if not reader.point_used:
        raise InputError(f"{path}: the C3D file has no markers; export a recording with positions.")
    stated = int(reader.last_frame) - int(reader.first_frame) + 1
    frames = [points[:, :4].astype(float) for _, points, _ in reader.read_frames(copy=False)]
    if len(frames) < stated:
        raise InputError(f"{path}: the C3D file ends after {len(frames)} of {stated} frames; {EXPORT_AGAIN}.")
    if len(frames) < SMALLEST_CURVE_ROWS:
        raise InputError(f"{path}: the C3D file has {len(frames)} frames; at least {SMALLEST_CURVE_ROWS} are needed.")
    return np.array(frames)


def _names(reader: Any, count: int) -> tuple[list[str], set[str]]:
    """A unique name for each point, and those of points that are no positions."""
    labels = list(_words(reader, "LABELS"))
    names = plain_names([*labels, *[""] * count][:count])
    listed = {label for parameter in NO_POSITIONS for label in _words(reader, parameter)}
    return names, {name for name, label in zip(names, labels, strict=False) if label in listed}


def _words(reader: Any, parameter: str) -> Iterator[str]:
    """Texts of a parameter of the group POINT; more than 255 of them continue in parameters with a number."""
    for suffix in ("", *map(str, range(2, 100))):
        values = reader.get(f"POINT:{parameter}{suffix}")
        if values is None:
            return
        if values.num_elements > len(values.bytes):
            raise ValueError(f"POINT:{parameter}{suffix} is too short")
        for text in np.ravel(values.string_array) if values.num_elements else ():
            yield str(text).strip()
