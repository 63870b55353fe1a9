"""Checked reading of a result file: any damage is reported in one sentence."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zlib import crc32

import h5py
import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.files import reason
from explicitfe.platform.host.result_files import running_path
from explicitfe.results.files import layout

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
# What h5py raises where HDF5 cannot read something, or reads what h5py has no type or no room for.
READING_ERRORS = (OSError, KeyError, RuntimeError, ValueError, TypeError, OverflowError, MemoryError)


class NoResultError(InputError):
    """A file that is not a result of this program: not HDF5, or of another kind."""


class BusyError(InputError):
    """A file that another process was writing when it was read."""


class StoredFile:
    """An open result file; each part is checked when it is read.

    Attributes
    ----------
    path : the file.
    live : whether another process is writing it now.
    format : of its layout.

    Raises
    ------
    InputError : ``path`` is missing, a folder, no HDF5 file, HDF5 but no result, or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file, self.live = _open_file(path)
        self._objects: dict[str, h5py.Group | h5py.Dataset] = {}
        self._datasets: dict[tuple[str, str, tuple[int, ...]], h5py.Dataset] = {}
        try:
            with self._reading("its root group"):
                self._objects[""] = self._file["/"]
            self._size = self._file.id.get_filesize()
            if not self.has("explicitfe") or not self.has("VTKHDF"):
                raise NoResultError(f"{self.path} is an HDF5 file but not a result of explicitfe")
            self.format = self.whole_number("explicitfe", "format")
            if self.format > layout.FORMAT_VERSION:
                raise InputError(f"{self.path} has format {self.format}, which needs a newer version of explicitfe; update it")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file; reading then raises InputError."""
        self._file.close()
        self._datasets.clear()

    def damaged(self, what: str) -> InputError:
        """The error to raise if a part is wrong."""
        if self.live:
            return BusyError(f"{self.path} is being written and was incomplete when it was read ({what}); try again")
        return InputError(f"{self.path} is damaged ({what}); run the scenario again")

    def names(self, group: str) -> list[str]:
        """What stands in a group, sorted."""
        with self._reading(group):
            members = self._object(group)
            if isinstance(members, h5py.Group):
                return sorted(members)
        raise self.damaged(f"{group} is not a group")

    def has(self, name: str) -> bool:
        """Whether the file has a group or a dataset of this name."""
        with self._reading(name):
            try:
                return bool(self._object(name))
            except KeyError:
                return False

    def text_attribute(self, name: str, key: str) -> str:
        """An attribute that is a string."""
        with self._reading(f"{key} of {name}"):
            value = self._object(name).attrs[key]
            return value.decode() if isinstance(value, bytes) else str(value)

    def whole_number(self, name: str, key: str) -> int:
        """An attribute that is a whole number, 0 or more."""
        with self._reading(f"{key} of {name}"):
            value = self._object(name).attrs[key]
            if np.ndim(value) == 0 and np.issubdtype(np.asarray(value).dtype, np.integer) and value >= 0:
                return int(value)
        raise self.damaged(f"{key} of {name} is not a count")

    def shape(self, name: str, kind: str = "f", axes: tuple[int, ...] = ()) -> tuple[int, ...]:
        """Shape of a dataset of numbers.

        Parameters
        ----------
        kind : "f" for float64, "i" for whole numbers.
        axes : how many it may have; any number if empty.
        """
        shape: tuple[int, ...] = self._dataset(name, kind, axes).shape
        return shape

    def numbers(self, name: str, kind: str = "f", rows: slice | None = None, axes: tuple[int, ...] = ()) -> np.ndarray:
        """Numbers of a dataset, of some rows or, checked against their sum where there is one, of all."""
        dataset = self._dataset(name, kind, axes)
        with self._reading(name):
            array: np.ndarray = dataset[() if rows is None else rows]
            if rows is None:
                self._check(name, dataset, np.asarray(array).tobytes())
            return array

    def all_of(self, group: str) -> dict[str, np.ndarray]:
        """All datasets of a group, unchecked."""
        arrays = {}
        for name in self.names(group):
            with self._reading(f"{group}/{name}"):
                dataset = self._object(f"{group}/{name}")
                self._check_size(f"{group}/{name}", dataset)
                arrays[name] = np.asarray(dataset[()])
        return arrays

    def text(self, name: str, in_header: bool = False) -> str:
        """A string that is a dataset; ``in_header``: HDF5 itself has checked it."""
        with self._reading(name):
            dataset = self._object(name)
            self._check_size(name, dataset)
            value = dataset[()]
            if isinstance(value, np.ndarray) and value.dtype == np.uint8:
                value = value.tobytes()
            if isinstance(value, bytes):
                if not in_header:
                    self._check(name, dataset, value)
                return value.decode()
        raise self.damaged(f"{name} is not a text")

    def table(self, name: str) -> dict[str, Any]:
        """A dictionary that is stored as JSON."""
        try:
            value = json.loads(self.text(name))
        except (json.JSONDecodeError, RecursionError):
            value = None
        if isinstance(value, dict):
            return value
        raise self.damaged(f"{name} is not a JSON object")

    def _dataset(self, name: str, kind: str, axes: tuple[int, ...]) -> h5py.Dataset:
        if (name, kind, axes) in self._datasets:
            return self._datasets[name, kind, axes]
        with self._reading(name):
            dataset = self._object(name)
            if isinstance(dataset, h5py.Dataset) and dataset.shape is not None:
                right = dataset.dtype == np.float64 if kind == "f" else np.issubdtype(dataset.dtype, np.integer)
                if right and (not axes or dataset.ndim in axes):
                    self._check_size(name, dataset)
                    self._datasets[name, kind, axes] = dataset
                    return dataset
        raise self.damaged(f"{name} has a wrong type or shape")

    def _check_size(self, name: str, dataset: h5py.Dataset) -> None:
        size = max(self._size, self.path.stat().st_size) if self.live else self._size
        if dataset.nbytes > size:
            raise self.damaged(f"{name} claims to be larger than the file")

    def _check(self, name: str, dataset: h5py.Dataset, data: bytes) -> None:
        if self.format >= layout.FIRST_FORMAT_WITH_CHECKSUMS and crc32(data) != self.whole_number(name, "crc32"):
            raise self.damaged(f"the checksum of {name} does not match")

    def _object(self, name: str) -> h5py.Group | h5py.Dataset:
        """A group or dataset of this file.

        A result has no links to other names or files and no dataset whose numbers are in another file: a file that has some was
        edited, and could make a reader open any file of the user.

        Raises
        ------
        InputError : it is such a link or dataset.
        KeyError : there is none.
        """
        if name not in self._objects:
            folder, _, last = name.rpartition("/")
            group = self._object(folder)
            if not isinstance(group, h5py.Group) or not group.id.links.exists(last.encode()):
                raise KeyError(name)
            if group.id.links.get_info(last.encode()).type != h5py.h5l.TYPE_HARD:
                raise self.damaged(f"{name} is a link to another place, which a result never has")
            member = group[last]
            if isinstance(member, h5py.Dataset) and (member.external or member.is_virtual):
                raise self.damaged(f"the numbers of {name} are in another file, which a result never has")
            self._objects[name] = member
        return self._objects[name]

    @contextmanager
    def _reading(self, what: str) -> Iterator[None]:
        if not self._file:
            raise InputError(
                f"{self.path} was closed; open it again with open_result, and read it before close() or in a with block."
            )
        try:
            yield
        except InputError:
            raise
        except KeyError:
            raise self.damaged(f"{what} is missing") from None
        except READING_ERRORS as error:
            raise self.damaged(f"{what} cannot be read: {_one_line(error)}") from None


def _open_file(path: Path) -> tuple[h5py.File, bool]:
    """The open file, and whether another process is writing it."""
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder; give the .vtkhdf file in it")
        if path.exists() and not path.is_file():
            raise NoResultError(f"{path} is not a regular file, so it is not a result of explicitfe")
        signature = _first_bytes(path)
    except FileNotFoundError as error:
        unfinished = running_path(path)
        hint = f"; an unfinished run has {unfinished}" if unfinished.exists() else ""
        raise InputError(f"{path} does not exist{hint}") from error
    except InputError:
        raise
    except (OSError, ValueError) as error:  # a name that is too long, or has a character of code 0
        raise InputError(f"{str(path)!r} cannot be read ({reason(error)})") from error
    if signature != HDF5_SIGNATURE:
        raise NoResultError(f"{path} is not an HDF5 file, so it is not a result of explicitfe")
    live = False
    try:
        try:
            return h5py.File(path, "r"), False
        except BlockingIOError:
            live = True
            return h5py.File(path, "r", locking=False), True
    except READING_ERRORS as error:
        if not path.exists():
            raise InputError(f"{path} was removed while it was read") from error
        if live:
            raise BusyError(
                f"{path} is being written and was incomplete when it was read ({_one_line(error)}); try again"
            ) from error
        raise InputError(f"{path} is damaged (HDF5 cannot open it: {_one_line(error)}); run the scenario again") from error


def _first_bytes(path: Path) -> bytes:
    """The first bytes of a file; none of a special file without size, such as /proc/kmsg, whose reading would wait."""
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        return os.read(descriptor, len(HDF5_SIGNATURE)) if os.fstat(descriptor).st_size else b""
    finally:
        os.close(descriptor)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
