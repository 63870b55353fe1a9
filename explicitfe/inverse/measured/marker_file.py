"""Recordings of markers as other programs write them: their form in memory, units, and two binary formats.

Carstens AG50x (``.pos``): a header of text with its own size, then x, y, z, two angles, rms and an unused value for each channel
and frame, as 32-bit floating point numbers. mview (``.mat``): an array of structures, each with NAME, SRATE and SIGNAL.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from explicitfe.inverse.measured.quantities import QUANTITIES, unit_of
from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.text import bytes_of

# Ten minutes of 40 markers at 250 Hz have about 100 MiB.
LARGEST_RECORDING_MIB = 128
EXPORT_AGAIN = "export the recording again, or as a table (.csv)"
VALUES_PER_POS_CHANNEL = 7
AG500_CHANNELS, AG500_RATE_HZ = 12, 200.0
_POS_HEADER = re.compile(rb"AG50xDATA_V00(\d)\r?\n0*(\d+)\r?\n")
_LENGTH = re.compile(r"\s*([\d.]*)\s*(.*)")


class Markers(NamedTuple):
    """Contents of a recording.

    Attributes
    ----------
    time_s : (k,).
    coordinates_mm : name of a marker -> axis (x, y, z, or a direction such as up) -> (k,), nan where a value is missing.
    notes : sentences on what was omitted or interpreted.
    up : vertical axis that the file states, such as "+Z"; empty if it states none.
    """

    time_s: np.ndarray
    coordinates_mm: dict[str, dict[str, np.ndarray]]
    notes: list[str]
    up: str = ""


def content_of(path: Path) -> bytes:
    """The bytes of a recording."""
    return bytes_of(path, "give a recording, or a part of it", LARGEST_RECORDING_MIB * 2**20)


def mm_per_unit(path: Path, stated: str, unit: str | None, where: str, notes: list[str]) -> float:
    """Return the length in mm of the unit of a recording.

    Parameters
    ----------
    stated : by the file.
    unit : given by the user in its place; with a factor if the file counts in pixels or similar, such as "0.2 mm".
    where : the file states the unit; in brackets, for messages.

    Raises
    ------
    InputError : neither of them is a unit of length.
    """
    valid = ", ".join(QUANTITIES["displacement"].units)
    match = _LENGTH.fullmatch(unit or stated)
    assert match is not None
    known = unit_of("displacement", match[2])
    try:
        factor = float(match[1] or 1.0)
    except ValueError:
        factor = 0.0
    if known is None or not factor > 0.0:
        if unit:
            raise InputError(f'{path}: `unit` "{shortened(unit)}" is no unit of length; use {valid}.')
        what = f'the unit "{shortened(stated)}"{where} is no unit of length' if stated else "the file states no unit"
        raise InputError(f"{path}: {what}; give `unit` with the unit of the positions: {valid}, or a multiple such as 0.2mm.")
    if unit and stated and (unit_of("displacement", stated) != known or factor != 1.0):
        notes.append(
            f'{path}: positions are read in {(match[1] + " " + known).strip()}; the unit in the file is "{shortened(stated)}".'
        )
    return factor * QUANTITIES["displacement"].units[known]


def plain_names(labels: Sequence[str]) -> list[str]:
    """Return unique names for labels that are empty, repeat, or have letters with a meaning in the tables of a dataset."""
    names: list[str] = []
    for k, text in enumerate(labels):
        plain = "".join(" " if letter in ',"' or not letter.isprintable() else letter for letter in text)
        name = label = " ".join(plain.split()) or f"marker {k + 1}"
        number = 2
        while name in names:
            name, number = f"{label} {number}", number + 1
        names.append(name)
    return names


def by_axis(places: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of positions (k, 3) or (k, 2) by the names of their axes."""
    return dict(zip("xyz", places.T, strict=False))


def read_pos(path: Path, *, unit: str | None = None, rate_hz: float | None = None) -> Markers:
    """Read the file of an AG500 or AG501 articulograph; channels are called "channel 1", ...

    Raises
    ------
    InputError : the file cannot be read, is damaged, or has amplitudes in place of positions.
    """
    content, notes = content_of(path), list[str]()
    channels, rate, values = AG500_CHANNELS, AG500_RATE_HZ, content
    head = _POS_HEADER.match(content)
    if head is not None:
        text = content[: int(head[2])].decode("latin-1")
        stated = {key: re.search(rf"{key}=(\d+)", text) for key in ("NumberOfChannels", "SamplingFrequencyHz")}
        if "Calf_Channel" in text:
            raise InputError(f"{path}: the file has amplitudes of the coils; give the positions computed of them.")
        if head[1] not in b"123" or int(head[2]) < head.end() or not all(stated.values()):
            raise InputError(f"{path}: the header is not that of a Carstens AG50x file of version 1 to 3; {EXPORT_AGAIN}.")
        channels, rate = (int(match[1]) for match in stated.values() if match)
        values = content[int(head[2]) :]
    else:
        notes.append(f"{path}: no header; read as positions of an AG500, {channels} channels at {rate:g} Hz.")
    per_frame = 4 * VALUES_PER_POS_CHANNEL * channels
    if not values or not per_frame or len(values) % per_frame:
        sizes = f"{len(values)} bytes of positions are no whole number of frames of {channels} channels"
        raise InputError(f"{path}: {sizes}; the file is damaged, or no .pos file of an articulograph. Copy it again.")
    frames = np.frombuffer(values, dtype="<f4").reshape(-1, channels, VALUES_PER_POS_CHANNEL)[:, :, :3].astype(float)
    factor = mm_per_unit(path, "mm", unit, "", notes)
    if not head and not np.nanmax(np.abs(frames), initial=0.0) < 1e4:
        raise InputError(f"{path}: no header, and the values are no positions in mm; {EXPORT_AGAIN}.")
    rate = rate_hz or rate
    if not rate:
        raise InputError(f"{path}: the file does not state a sampling rate; give it with `rate_hz`.")
    positions = {f"channel {k + 1}": by_axis(factor * frames[:, k]) for k in range(channels)}
    return Markers(np.arange(len(frames)) / rate, positions, notes)


def read_mview(path: Path, *, unit: str | None = None, rate_hz: float | None = None) -> Markers:
    """Read the channels with two or three coordinates from a file of mview; those with one value, such as sound, are ignored.

    Raises
    ------
    InputError : the file cannot be read, or has no such channels of one sampling rate.
    """
    from scipy.io import loadmat

    content, notes = content_of(path), []
    if content.startswith(b"\x89HDF") or b"MATLAB 7.3" in content[:124]:
        raise InputError(f"{path}: MATLAB files of version 7.3 are not read; save it in MATLAB with save(..., '-v7').")
    try:
        variables = {k: v for k, v in loadmat(io.BytesIO(content), squeeze_me=True).items() if not k.startswith("__")}
    except Exception as error:  # scipy raises what its parsing meets
        raise InputError(f"{path}: this is no MATLAB file, or it is damaged ({shortened(str(error))}); save it again.") from None
    fields = ("NAME", "SRATE", "SIGNAL")
    arrays = {k: array for k, v in variables.items() if set(fields) <= set((array := np.atleast_1d(v)).dtype.names or ())}
    if len(arrays) != 1:
        what = f"{len(arrays)} variables have channels ({', '.join(arrays)}); save one of them"
        others = f"{', '.join(fields)} (there are: {', '.join(map(shortened, variables)) or 'none'}); save a table (.csv)"
        raise InputError(f"{path}: {what if arrays else f'no variable is a structure array of mview, with {others}'}.")
    (channels,) = arrays.values()
    signals: dict[str, tuple[np.ndarray, float]] = {}
    names = plain_names([str(channel["NAME"]) for channel in channels])
    for name, channel in zip(names, channels, strict=True):
        signal = np.asarray(channel["SIGNAL"], dtype=float)
        if signal.ndim == 2 and signal.shape[1] > 1:
            signals[name] = signal[:, :3], float(channel["SRATE"])
    if sound := [name for name in names if name not in signals]:
        notes.append(f"{path}: channels that are no positions are ignored: {', '.join(map(shortened, sound))}.")
    rates = {rate for _, rate in signals.values()}
    shapes = {signal.shape for signal, _ in signals.values()}
    if len(rates) != 1 or len(shapes) != 1 or not all(0.0 < rate < np.inf for rate in rates):
        what = "no channel has coordinates" if not signals else "the channels with coordinates differ in rate, length or axes"
        raise InputError(f"{path}: {what}; save the sensors of one recording in one array.")
    factor, ((count, _),) = mm_per_unit(path, "mm", unit, "", notes), shapes
    positions = {name: by_axis(factor * signal) for name, (signal, _) in signals.items()}
    return Markers(np.arange(count) / (rate_hz or rates.pop()), positions, notes)
