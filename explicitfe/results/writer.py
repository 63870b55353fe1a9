"""Writes a run's samples to one file that stays readable when the process is killed at any time."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import h5py
import numpy as np
import numpy.typing as npt

from explicitfe.errors import InputError, RunError
from explicitfe.mesh.hexmesh import HexMesh
from explicitfe.results import layout
from explicitfe.results.layout import Quantity

# What h5py raises when the file system refuses, by where in HDF5 that happens.
HDF5_ERRORS = (OSError, RuntimeError)
RUNNING, FINISHED, FAILED = "running", "finished", "failed"


class ResultWriter:
    """Appends samples to a result file.

    While the run goes on the file is called ``<stem>.running.vtkhdf``; :meth:`finish` renames it to ``path``. So an
    older result at ``path`` stays whole until the new one is, and a killed run leaves its samples under the running
    name. Leaving the ``with`` block without :meth:`finish` keeps the running file if it holds a sample and removes it
    if not.

    Parameters
    ----------
    path : the finished result; ends in ``.vtkhdf``. Missing folders are made.
    mesh : the reference mesh; its node sets and named points are stored too.
    point_fields, cell_fields : name -> quantity, what :meth:`samples` gets beside ``displacement`` (m), which is always
        stored.
    history : name -> quantity, what :meth:`histories` gets beside the time.
    scenario_text : the scenario file as the user wrote it.
    model, provenance : JSON-able dicts.
    bones : name -> points (k, 3) m and triangles (m, 3) of the surface of each bone at rest.
    restart : name -> array or number of the shape and type that :meth:`restart` will get; values are ignored.
    expected_samples : room is made for this many at once; more are possible, fewer are trimmed by :meth:`finish`.
    overwrite : whether a finished result at ``path`` may be replaced.

    Raises
    ------
    InputError : a result exists at ``path`` and ``overwrite`` is False, another process is writing it, or the folder
        cannot be written or has no room for the expected samples.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        mesh: HexMesh,
        point_fields: Mapping[str, Quantity] | None = None,
        cell_fields: Mapping[str, Quantity] | None = None,
        history: Mapping[str, Quantity] | None = None,
        scenario_text: str,
        model: Mapping[str, object],
        provenance: Mapping[str, object],
        bones: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None,
        restart: Mapping[str, npt.ArrayLike] | None = None,
        expected_samples: int = 64,
        overwrite: bool = False,
    ) -> None:
        self.path = Path(path)
        self.running_path = layout.running_path(self.path)
        self._capacity = max(1, expected_samples)
        self._samples = 0
        self._last_time = -np.inf
        self._finished = False
        self._rows = 0
        self._restarts = 0
        declared = {name: np.asarray(value) for name, value in (restart or {}).items()}
        self._file = _create_file(self.path, self.running_path, overwrite)
        try:
            layout.create(
                self._file,
                mesh=mesh,
                bones=bones or {},
                point_fields={"displacement": layout.DISPLACEMENT, **(point_fields or {})},
                cell_fields=cell_fields or {},
                history={"time": layout.TIME, **(history or {})},
                scenario_text=scenario_text,
                model=model,
                provenance=provenance,
                restart=declared,
                capacity=self._capacity,
            )
            self._write_status(RUNNING, "", "{}")
            self._file.flush()
        except BaseException as error:
            with suppress(*HDF5_ERRORS):
                self.close()
            if isinstance(error, HDF5_ERRORS):
                raise _cannot_write(self.path, error) from error
            raise
        self._open_datasets()
        self._counts = (mesh.node_count, mesh.element_count)
        self._noted: dict[str, list[np.ndarray]] = {name: [] for name in self._history}
        self._slots = [{name: self._file[slot][name] for name in (*declared, "seal")} for slot in layout.RESTART_SLOTS]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def sample(
        self, time_s: float, point_data: Mapping[str, np.ndarray], cell_data: Mapping[str, np.ndarray] | None = None
    ) -> None:
        """Store the fields at one time; see :meth:`samples`."""
        one_point, one_cell = (
            {name: np.asarray(array)[None] for name, array in (d or {}).items()} for d in (point_data, cell_data)
        )
        self.samples(np.array([time_s], dtype=float), one_point, one_cell)

    def samples(
        self, times_s: np.ndarray, point_data: Mapping[str, np.ndarray], cell_data: Mapping[str, np.ndarray] | None = None
    ) -> None:
        """Store the fields at some times, with all history rows so far; they are safe from a kill when this returns.

        Parameters
        ----------
        times_s : (k,) s, rising, later than the last sample.
        point_data : ``displacement`` and every declared point field, each (k, N) or (k, N, components).
        cell_data : every declared cell field, each (k, E) or (k, E, components).

        Raises
        ------
        RunError : the file system refuses, such as when the disk is full.
        """
        count = len(times_s)
        if count == 0:
            return
        for before, time_s in zip([self._last_time, *times_s], times_s, strict=False):
            if not time_s > before:
                raise ValueError(f"sample at {time_s} s does not come after the one at {before} s")
        point_data = _checked(point_data, self._point_data, (count, self._counts[0]))
        cell_data = _checked(cell_data or {}, self._cell_data, (count, self._counts[1]))
        try:
            if self._samples + count > self._capacity:
                capacity = max(2 * self._capacity, self._samples + count)
                layout.make_room(self._file, self._samples, capacity)
                self._capacity = capacity
                self._file.flush()
                self._open_datasets()
            for datasets, arrays in ((self._point_data, point_data), (self._cell_data, cell_data)):
                for name, array in arrays.items():
                    datasets[name].put(self._samples * array.shape[1], array.reshape(-1, *array.shape[2:]))
            self._put_history()
            self._times.resize(self._samples + count, axis=0)
            _Rows(self._times).put(self._samples, np.array(times_s, dtype=float))
            self._step_count.write(np.array(self._samples + count, dtype=np.int64))
            # So far only numbers went to the file; the counts that make them valid follow.
            self._file.flush()
        except HDF5_ERRORS as error:
            raise self._stopped_writing(error) from error
        self._samples += count
        self._last_time = float(times_s[-1])

    def history(self, time_s: float, row: Mapping[str, float | np.ndarray]) -> None:
        """Note one row of scalars; see :meth:`histories`."""
        self.histories(np.array([time_s]), {name: np.asarray(value)[None] for name, value in row.items()})

    def histories(self, times_s: np.ndarray, rows: Mapping[str, np.ndarray]) -> None:
        """Note rows of the history, (k,) or (k, components) each; they reach the file with the next samples or :meth:`finish`."""
        rows = {"time": times_s, **rows}
        if rows.keys() != self._noted.keys():
            raise ValueError(f"history row has {sorted(rows)}, declared were {sorted(self._noted)}")
        for name, values in rows.items():
            self._noted[name].append(np.asarray(values, dtype=float))

    def restart(self, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Store the state to go on from, over the older of the two slots; safe from a kill when this returns.

        Parameters
        ----------
        arrays : every declared restart array, with its declared shape and type.
        """
        number = self._restarts + 1
        slot = self._slots[number % 2]
        state = {name: np.asarray(value) for name, value in arrays.items()}
        if state.keys() | {"seal"} != slot.keys():
            raise ValueError(f"restart state has {sorted(state)}, declared were {sorted(slot.keys() - {'seal'})}")
        for name, array in state.items():
            if (array.shape, array.dtype) != (slot[name].shape, slot[name].dtype):
                raise ValueError(f"restart array {name} is {array.dtype} {array.shape}, not as declared")
        try:
            for name, array in state.items():
                slot[name][...] = array
            slot["seal"][...] = layout.seal(number, state)
            self._file.flush()
        except HDF5_ERRORS as error:
            raise self._stopped_writing(error) from error
        self._restarts = number

    def finish(self, status: str, message: str, summary: Mapping[str, object]) -> Path:
        """Store how the run ended, close the file and give it its final name.

        Parameters
        ----------
        status : ``"finished"``, ``"failed"`` or another word of at most 32 bytes; not ``"running"``.
        message : one sentence for the user; empty when there is nothing to say.
        summary : JSON-able dict of what the run came to.

        Returns
        -------
        The final path.
        """
        if status == RUNNING:
            raise ValueError('a run that ends is not "running"')
        try:
            self._put_history()
            self._write_status(status, message, layout.to_json(summary))
            self._file.flush()
            layout.make_room(self._file, self._samples, self._samples)
            self._times.resize(self._samples, axis=0)
            self._resize_history(self._rows)
            self._file.close()
            self.running_path.replace(self.path)
        except HDF5_ERRORS as error:
            raise self._stopped_writing(error) from error
        self._finished = True
        return self.path

    def close(self) -> None:
        """Close the file; without :meth:`finish` it keeps its running name, or goes if it holds no sample."""
        if self._finished:
            return
        try:
            self._file.close()
        finally:
            if not self._samples:
                self.running_path.unlink(missing_ok=True)

    def _open_datasets(self) -> None:
        """Handles to everything that grows, anew after each time it was lengthened."""
        self._point_data, self._cell_data, self._history = (
            {name: _Rows(dataset) for name, dataset in self._file[group].items()}
            for group in (layout.POINT_DATA, layout.CELL_DATA, layout.HISTORY)
        )
        self._times = self._file[f"{layout.STEPS}/Values"]
        self._step_count = h5py.h5a.open(self._file[layout.STEPS].id, b"NSteps")
        self._row_count = h5py.h5a.open(self._file[layout.HISTORY].id, b"rows")

    def _put_history(self) -> None:
        """Append the rows noted since the last time."""
        count = sum(len(times) for times in self._noted["time"])
        if not count:
            return
        if self._rows + count > self._history["time"].capacity:
            self._resize_history(2 * (self._rows + count))
            self._file.flush()
            self._open_datasets()
        for name, rows in self._noted.items():
            history = self._history[name]
            history.put(self._rows, np.concatenate(rows).reshape(count, *history.shape))
        self._rows += count
        self._row_count.write(np.array(self._rows, dtype=np.int64))
        self._noted = {name: [] for name in self._history}

    def _resize_history(self, rows: int) -> None:
        layout.resize(self._file, dict.fromkeys(self._file[layout.HISTORY].values(), rows))

    def _write_status(self, state: str, message: str, summary: str) -> None:
        texts = {"summary": summary.encode(), "message": message.encode(), "state": state.encode()}
        for name, text in texts.items():
            if len(text) > layout.STATUS_BYTES[name]:
                raise ValueError(f"{name} has {len(text)} bytes, at most {layout.STATUS_BYTES[name]} can be stored")
        for name, text in texts.items():
            self._file[f"{layout.STATUS}/{name}"][()] = text

    def _stopped_writing(self, error: Exception) -> RunError:
        return RunError(
            f"could not go on writing {self.running_path} ({_reason(error)}); its {self._samples} samples so far stay "
            "readable: free space or choose another --out folder"
        )


def _create_file(path: Path, running: Path, overwrite: bool) -> h5py.File:
    """A new file at ``running``, in place of one that a killed run left."""
    if path.suffix != ".vtkhdf":
        raise InputError(f"result {path} must end in .vtkhdf: ParaView and pyvista know it by that")
    try:
        if path.is_dir():
            raise InputError(f"result {path} is a folder; choose another --out folder")
        if path.exists() and not overwrite:
            raise InputError(f"result {path} exists; add --overwrite to replace it or choose another --out folder")
        path.parent.mkdir(parents=True, exist_ok=True)
        mode = "x"
        if running.exists():
            _check_not_being_written(running)
            mode = "w"
        # Without a chunk cache HDF5 writes each step's numbers straight to their place.
        return h5py.File(running, mode, rdcc_nbytes=0)
    except OSError as error:
        raise _cannot_write(path, error) from error


def _check_not_being_written(running: Path) -> None:
    """InputError if a live process holds the file; to be asked first, as HDF5 empties a file before it asks."""
    try:
        h5py.File(running, "r+").close()
    except BlockingIOError as error:
        raise InputError(f"another run is writing {running}; wait until it ends or choose another --out folder") from error
    except OSError:
        pass  # killed before it was a file that HDF5 can open


def _cannot_write(path: Path, error: Exception) -> InputError:
    return InputError(f"cannot write results in {path.parent} ({_reason(error)}); choose another --out folder")


def _reason(error: Exception) -> str:
    """Why the file system refused, in its words; HDF5 hides them in a longer text, and often says no ``errno``."""
    hidden = re.search("error message = '([^']*)'", str(error))
    if hidden:
        return hidden[1]
    return os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)


def _checked(arrays: Mapping[str, np.ndarray], declared: Mapping[str, _Rows], counts: tuple[int, int]) -> dict[str, np.ndarray]:
    """The arrays of some steps as they are stored; ValueError where they are not what was declared."""
    if arrays.keys() != declared.keys():
        raise ValueError(f"sample has {sorted(arrays)}, declared were {sorted(declared)}")
    checked = {name: np.ascontiguousarray(array, dtype=float) for name, array in arrays.items()}
    for name, array in checked.items():
        if array.shape != (*counts, *declared[name].shape):
            raise ValueError(f"{name} has shape {array.shape[1:]}, declared was {(counts[1], *declared[name].shape)}")
    return checked


class _Rows:
    """The rows of one dataset, and the handles to write them.

    h5py makes these handles anew for each write, which takes 130 microseconds where the write takes 10.
    """

    def __init__(self, dataset: h5py.Dataset) -> None:
        self.capacity, *shape = dataset.shape
        self.shape = tuple(shape)
        self._id = dataset.id
        self._space = dataset.id.get_space()
        self._type = h5py.h5t.py_create(np.dtype(float))

    def put(self, start: int, rows: np.ndarray) -> None:
        """``dataset[start : start + len(rows)] = rows``, for rows of float64 and of the right shape."""
        self._space.select_hyperslab((start, *(0 for _ in self.shape)), rows.shape)
        self._id.write(h5py.h5s.create_simple(rows.shape), self._space, rows, self._type)
