"""Recordings in C3D files (motion capture): positions of markers, unit, sampling rate and missing values."""

from __future__ import annotations

import io
import stat
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS
from explicitfe.inverse.measured.quantities import QUANTITIES, unit_of
from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.extras import require

# Ten minutes of 40 markers at 250 Hz have about 100 MiB.
LARGEST_C3D_MIB = 128
# Parameters that list points which are no positions: results of gait models, such as angles in degrees.
NO_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "REACTIONS", "SCALARS")
EXPORT_AGAIN = "export the recording again, or as a table (.csv)"


class Markers(NamedTuple):
    """Contents of a C3D file.

    Attributes
    ----------
    time_s : (k,); the first frame is at 0.
    positions_mm : name of a marker -> (k, 3), nan where a value is missing.
    notes : sentences on what was omitted or interpreted.
    """

    time_s: np.ndarray
    positions_mm: dict[str, np.ndarray]
    notes: list[str]


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
    content = _content(path)
    notes: list[str] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on parameters that are not used here
            reader = _reader(content)
            rate = _rate(path, reader, rate_hz)
            frames = _frames(path, reader)  # (k, markers, 4): x, y, z, residual
            names, others = _names(reader, frames.shape[1])
            factor = _mm_per_unit(path, reader, unit, notes)
    except InputError:
        raise
    except Exception as error:  # the library raises what its parsing meets: struct.error, AssertionError, KeyError, ...
        reason = f" ({shortened(str(error))})" if isinstance(error, AssertionError) else ""
        raise InputError(f"{path}: this is no C3D file, or it is damaged{reason}; {EXPORT_AGAIN}.") from None
    places = np.where(frames[:, :, 3:] < 0.0, np.nan, factor * frames[:, :, :3])
    visible = np.any(np.isfinite(places), axis=(0, 2))
    never_seen = [name for k, name in enumerate(names) if not visible[k] and name not in others]
    for why, omitted in (
        ("points that are no positions are ignored", [name for name in names if name in others]),
        ("markers without any value are omitted", never_seen),
    ):
        if omitted:
            notes.append(f"{path}: {why}: {', '.join(map(shortened, omitted))}.")
    positions = {name: places[:, k] for k, name in enumerate(names) if visible[k] and name not in others}
    if not positions:
        raise InputError(f"{path}: no marker of the C3D file has a value; {EXPORT_AGAIN}.")
    return Markers(np.arange(len(places)) / rate, positions, notes)


def _content(path: Path) -> bytes:
    """The bytes of a regular file of limited size."""
    try:
        status = path.stat()
        regular, mebibytes = stat.S_ISREG(status.st_mode), status.st_size / 2**20
        content = path.read_bytes() if regular and mebibytes <= LARGEST_C3D_MIB else b""
    except OSError as error:
        raise InputError(f"{path}: this cannot be read ({error.strerror}); give a C3D file.") from None
    except ValueError:  # a NUL in the name
        raise InputError(f"{str(path)!r}: this cannot be the name of a file; give a C3D file.") from None
    if not regular:
        raise InputError(f"{path}: this is no regular file; give a C3D file.")
    if mebibytes > LARGEST_C3D_MIB:
        sizes = f"{mebibytes:.0f} MiB, and no more than {LARGEST_C3D_MIB} MiB are read"
        raise InputError(f"{path}: the file has {sizes}; export a part of the recording.")
    return content


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
    names: list[str] = []
    labels = list(_words(reader, "LABELS"))
    for k in range(count):
        name = label = (labels[k] if k < len(labels) else "") or f"marker {k + 1}"
        number = 2
        while name in names:
            name, number = f"{label} {number}", number + 1
        names.append(name)
    return names, {name for parameter in NO_POSITIONS for name in _words(reader, parameter)}


def _words(reader: Any, parameter: str) -> Iterator[str]:
    """Texts of a parameter of the group POINT; more than 255 of them continue in parameters with a number."""
    for suffix in ("", *map(str, range(2, 100))):
        values = reader.get(f"POINT:{parameter}{suffix}")
        if values is None:
            return
        if values.num_elements > len(values.bytes):
            raise ValueError(f"POINT:{parameter}{suffix} is too short")
        for text in np.ravel(values.string_array) if values.num_elements else ():
            # Commas and quotes have a meaning in the tables of a dataset, control characters in no name.
            plain = "".join(" " if letter in ',"' or not letter.isprintable() else letter for letter in str(text))
            yield " ".join(plain.split())


def _mm_per_unit(path: Path, reader: Any, unit: str | None, notes: list[str]) -> float:
    """Length in mm of the unit of the positions."""
    stated = next(_words(reader, "UNITS"), "")
    valid = ", ".join(QUANTITIES["displacement"].units)
    known = unit_of("displacement", unit or stated)
    if known is None:
        if unit:
            raise InputError(f'{path}: `unit` "{shortened(unit)}" is no unit of length; use {valid}.')
        what = f'the unit "{shortened(stated)}" (POINT:UNITS) is no unit of length' if stated else "the file states no unit"
        raise InputError(f"{path}: {what}; give `unit` with the unit of the positions: {valid}.")
    if unit and unit_of("displacement", stated) != known:
        notes.append(f'{path}: positions are read in {known}; the unit in the file is "{shortened(stated)}".')
    return QUANTITIES["displacement"].units[known]
