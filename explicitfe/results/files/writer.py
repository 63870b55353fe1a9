"""Writer of result files that stay readable if the process is killed at any time or the disk is full."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self
from zlib import crc32

import h5py
import numpy as np
import numpy.typing as npt

from explicitfe.platform.errors import InputError, MachineError
from explicitfe.platform.host import files
from explicitfe.platform.host.result_files import final_path, running_path
from explicitfe.results.documents.run_summary import without_history
from explicitfe.results.files import layout, names
from explicitfe.results.files.disk import DiskFile
from explicitfe.results.files.fibres import fibre_arrays
from explicitfe.results.files.layout import INTERRUPTED, RUNNING, Declaration, Origin
from explicitfe.results.files.recorded import Recorder
from explicitfe.results.files.rows import FieldRows, HistoryRows, Rows

# What h5py raises, by where in HDF5 something goes wrong.
HDF5_ERRORS = (OSError, RuntimeError)


class ResultWriter(Recorder):
    """Appends samples to a result file.

    The file has a hidden temporary name until its first sample, and is ``<stem>.running.vtkhdf`` until :meth:`finish` renames it
    to ``path``. Therefore an older result at ``path`` stays unchanged until the new one is complete, a refused run changes no
    file, and an interrupted or killed run leaves its samples under the running name. Leaving the ``with`` block without
    :meth:`finish` keeps the running file, or removes it if it has no sample.

    Parameters
    ----------
    path : the finished result; ends in ``.vtkhdf``. Missing folders are made.
    declared : mesh, fields and history.
    origin : scenario, model and provenance.
    restart : name -> array or number of the shape and type that :meth:`restart` will get; values are ignored.
    expected_samples : number of samples to allocate; more are possible, unused ones are removed by :meth:`finish`.
    overwrite : whether a result at ``path``, and the file of an interrupted run, may be replaced.

    Attributes
    ----------
    path, running_path : the result when its run has ended, and until then.
    last_row : name -> number or (components,), the last row of the history; empty before the first sample.

    Raises
    ------
    InputError : one of the names belongs to a file that must not be replaced, another process is writing it, or the folder
        cannot be written.
    MachineError : the disk has too little free space for the expected samples.
    """

    _private = True  # its name is one that nobody knows
    _samples = 0
    _last_time = -np.inf
    _restarts = 0
    _reopened = False
    _ended = False

    def __init__(
        self,
        path: Path | str,
        declared: Declaration,
        origin: Origin,
        *,
        restart: Mapping[str, npt.ArrayLike] | None = None,
        expected_samples: int = 64,
        overwrite: bool = False,
    ) -> None:
        self.path = Path(path)
        self.last_row: dict[str, np.ndarray] = {}
        names.check_names(self.path, overwrite)
        self._made = [folder for folder in self.path.absolute().parents if not folder.exists()]  # the innermost first
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            files.remove_stale(self.path.parent, self.path.stem)
            number, name = files.create_private(self.path.parent, self.path.stem)
        except OSError as error:
            self._remove_folders()
            raise _cannot_write(self.path, error) from error
        self._disk, self._name, self._overwrite = DiskFile(number), name, overwrite
        self._file = h5py.File(self._disk, "w", rdcc_nbytes=0, libver=layout.LIBRARY_VERSIONS)
        with _closing_after_errors(self.close, partial(_cannot_write, self.path)):
            layout.create(
                self._file,
                declared,
                origin,
                fibres=fibre_arrays(declared.fibres),
                restart={key: np.asarray(value) for key, value in (restart or {}).items()},
                capacity=max(1, expected_samples),
                reserve=self._disk.reserve,
            )
            self._file[layout.STATE][()] = RUNNING.encode()
            self._attach()
            self._flush()

    @classmethod
    def reopen(cls, path: Path | str, *, overwrite: bool = False) -> Self:
        """Open the result of an interrupted run to append to it; it has its running name until :meth:`finish`.

        Samples that are not later than the last stored one are skipped.

        Parameters
        ----------
        path : result of a killed or interrupted run.
        overwrite : whether a finished result of the same name may be replaced at the end.

        Raises
        ------
        InputError : it is no result, finished, damaged or of an older format, or is being written by another process.
        MachineError : it cannot be written.
        """
        path = Path(path)
        final = final_path(path)
        restarts, count = names.check_stopped(path, final, overwrite)
        try:
            number = files.open_plain(path)
        except OSError as error:
            raise _cannot_reopen(path, error) from None
        disk, name = DiskFile(number), path
        with _closing_after_errors(disk.close, partial(_cannot_reopen, path)):
            if not files.lock(number) or not files.is_at(path, number):
                raise InputError(f"another run is writing {path}; wait until it ends")
            if path == final:
                name = running_path(final)
                names.to_running(path, name, overwrite)
            file = h5py.File(disk, "r+", rdcc_nbytes=0, libver=layout.LIBRARY_VERSIONS)
        writer = cls.__new__(cls)
        writer.path, writer.last_row, writer._made = final, {}, []
        writer._disk, writer._file, writer._name, writer._overwrite = disk, file, name, overwrite
        writer._reopened, writer._private = True, False
        writer._restarts, writer._samples = restarts, count
        with _closing_after_errors(writer.close, partial(_cannot_reopen, path)):
            writer._reattach()
        return writer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    @property
    def running_path(self) -> Path:
        """Name of the result until its run has ended."""
        return running_path(self.path)

    def samples(
        self,
        times_s: np.ndarray,
        rows: Mapping[str, np.ndarray],
        point_data: Mapping[str, np.ndarray],
        cell_data: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Store fields and history at some times; when this returns, a kill does not lose them.

        Parameters
        ----------
        times_s : (k,) s, rising, later than the last sample.
        rows : every declared history, (k,) or (k, components) each.
        point_data : ``displacement`` and every declared point field, each (k, N) or (k, N, components).
        cell_data : every declared cell field, each (k, E) or (k, E, components).

        Raises
        ------
        MachineError : the disk refuses, such as when it is full. If it has room when the run ends, nothing is lost.
        InputError : at the first sample, when another run of the same result has been faster.
        """
        times_s = np.asarray(times_s, dtype=float)
        count = len(times_s)
        history = _checked({"time": times_s, **rows}, self._history.columns, (count,), "history row")
        points = _checked(point_data, self._point_data, (count, self._counts[0]), "sample")
        cells = _checked(cell_data or {}, self._cell_data, (count, self._counts[1]), "sample")
        if self._reopened:
            new = slice(int(np.count_nonzero(times_s <= self._last_time)), None)
            times_s = times_s[new]
            history, points, cells = ({name: array[new] for name, array in some.items()} for some in (history, points, cells))
            count = len(times_s)
        if count == 0:
            return
        for before, time_s in zip([self._last_time, *times_s], times_s, strict=False):
            if not time_s > before:
                raise ValueError(f"sample at {time_s} s does not come after the one at {before} s")
        safe = self._samples
        try:
            if self._samples + count > self._capacity:
                layout.make_room(self._file, self._samples, max(2 * self._capacity, self._samples + count), self._disk.reserve)
                self._flush()
                self._open_datasets()
            for datasets, arrays in ((self._point_data, points), (self._cell_data, cells)):
                for name, array in arrays.items():
                    datasets[name].put(self._samples, array)
            self._history.put(self._samples, history)
            self._times.resize(self._samples + count, axis=0)
            Rows(self._times).put(self._samples, times_s)
            self._step_count.write(np.array(self._samples + count, dtype=np.int64))
            self._samples += count
            # So far only numbers went to the file; the counts that make them valid follow.
            self._flush()
        except HDF5_ERRORS as error:
            raise self._stopped_writing(error, safe) from error
        self._last_time = float(times_s[-1])
        self.last_row = {name: column[-1] for name, column in history.items()}
        if self._private:
            self._rename(names.to_running, self.running_path)

    def restart(self, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Store the restart state in the older of the two slots; when this returns, a kill does not lose it.

        Parameters
        ----------
        arrays : every declared restart array, with its declared shape and type.

        Raises
        ------
        MachineError : the disk refuses.
        """
        number = self._restarts + 1
        slot = self._slots[number % 2]
        state = {name: np.asarray(value) for name, value in arrays.items()} | {"stored_at": np.asarray(time.time())}
        if state.keys() | {"seal"} != slot.keys():
            declared = sorted(slot.keys() - {"seal", "stored_at"})
            raise ValueError(f"restart state has {sorted(arrays)}, declared were {declared}")
        for name, array in state.items():
            if (array.shape, array.dtype) != (slot[name].shape, slot[name].dtype):
                raise ValueError(f"restart array {name} is {array.dtype} {array.shape}, not as declared")
        try:
            for name, array in state.items():
                slot[name][...] = array
            slot["seal"][...] = layout.seal(number, state)
            self._flush()
        except HDF5_ERRORS as error:
            raise self._stopped_writing(error, self._samples) from error
        self._restarts = number

    def place(self, status: str) -> Path:
        """Path of the result after :meth:`finish` with this status: an interrupted run keeps its running name."""
        return self.running_path if status == INTERRUPTED else self.path

    def finish(self, status: str, message: str, summary: Mapping[str, object]) -> Path:
        """Store how the run ended, close the file and rename it.

        Parameters
        ----------
        status : ``"finished"``, ``"failed"``, ``"interrupted"`` or another word of at most 32 bytes; not ``"running"``.
        message : one sentence for the user; may be empty.
        summary : JSON-able summary of the run; values that the history contains are not stored twice.

        Returns
        -------
        Path of the result: see :meth:`place`.

        Raises
        ------
        MachineError : the disk refuses; what is stored stays under the running name.
        InputError : another file has taken the final name; the result keeps the running name.
        """
        if status == RUNNING:
            raise ValueError('a run that ends is not "running"')
        if len(status.encode()) > layout.STATE_BYTES:
            raise ValueError(f"status {status!r} has more than {layout.STATE_BYTES} bytes")
        ending = layout.to_json({"message": message, "summary": without_history(summary)}).encode()
        try:
            dataset = self._file[layout.ENDING]
            layout.resize({dataset: len(ending)}, self._disk.reserve)
            dataset[...] = np.frombuffer(ending, dtype=np.uint8)
            h5py.h5a.open(dataset.id, b"crc32").write(np.array(crc32(ending), dtype=np.uint32))
            self._flush()
            self._file[layout.STATE][()] = status.encode()
            self._flush()
            layout.make_room(self._file, self._samples, self._samples, self._disk.reserve)
            self._times.resize(self._samples, axis=0)
            self._file.close()
            self._disk.settle()
            files.sync(self._disk.fileno(), self.path.parent)
        except HDF5_ERRORS as error:
            raise self._stopped_writing(error, self._samples) from error
        place = self.place(status)
        if place == self.path:
            self._rename(names.to_final, self.path)
        elif self._private:  # interrupted before its first sample
            self._rename(names.to_running, place)
        self._disk.close()
        self._ended = True
        return place

    def close(self) -> None:
        """Close the file; without :meth:`finish` it keeps its running name, or is removed if it has no sample."""
        if self._ended:
            return
        self._ended = True
        try:
            with suppress(*HDF5_ERRORS):
                self._file.close()
                self._disk.settle()
        finally:
            self._disk.close()
            if self._private:
                with suppress(OSError):
                    self._name.unlink()
                self._remove_folders()

    # ---- inside ----

    def _attach(self) -> None:
        """Handles to all that is written from now on."""
        self._counts = (len(self._file["VTKHDF/Points"]), len(self._file["VTKHDF/Types"]))
        self._slots = [dict(self._file[slot].items()) for slot in layout.RESTART_SLOTS]
        self._open_datasets()

    def _open_datasets(self) -> None:
        """Handles to everything that grows, anew after each time it was lengthened."""
        file = self._file
        self._point_data, self._cell_data = (
            {name: FieldRows(dataset, file[layout.checksums_of(f"{group}/{name}")]) for name, dataset in file[group].items()}
            for group in (layout.POINT_DATA, layout.CELL_DATA)
        )
        self._history = HistoryRows(file[layout.HISTORY], file[layout.HISTORY_CHECKSUMS])
        self._capacity = self._history.capacity
        self._times = file[f"{layout.STEPS}/Values"]
        self._step_count = h5py.h5a.open(file[layout.STEPS].id, b"NSteps")

    def _reattach(self) -> None:
        """Make a file that was stopped, perhaps between two writes, one that is being written."""
        file, count = self._file, self._samples
        self._attach()
        self._step_count.write(np.array(count, dtype=np.int64))
        self._times.resize(max(1, count), axis=0)
        file[layout.STATE][()] = RUNNING.encode()
        self._flush()
        layout.make_room(file, count, max(1, count, self._capacity), self._disk.reserve)
        self._flush()
        self._open_datasets()
        if count:
            self._last_time = float(self._times[count - 1])
            self.last_row = {name: dataset[count - 1] for name, dataset in file[layout.HISTORY].items()}

    def _flush(self) -> None:
        """Write everything to the disk; OSError if that fails."""
        self._file.flush()
        self._disk.settle()

    def _rename(self, rename: Callable[[Path, Path, bool], None], name: Path) -> None:
        try:
            rename(self._name, name, self._overwrite)
        except OSError as error:
            raise MachineError(f"cannot rename {self._name} to {name} ({files.reason(error)}); rename it yourself") from error
        self._name, self._private = name, False

    def _remove_folders(self) -> None:
        """Remove the folders that were made for this, as long as nobody has put anything there."""
        with suppress(OSError):
            for folder in self._made:
                folder.rmdir()

    def _stopped_writing(self, error: Exception, samples: int) -> MachineError:
        kept = self.running_path if samples else self._name
        return MachineError(
            f"cannot write {kept} ({files.reason(error)}). The {samples} samples stored so far are readable; "
            f"free disk space, then resume the run with 'explicitfe resume {shlex.quote(str(kept))}'."
            if samples
            else f"cannot write {self.path} ({files.reason(error)}); free disk space or choose another `out` folder."
        )


@contextmanager
def _closing_after_errors(close: Callable[[], None], refusal: Callable[[Exception], Exception]) -> Iterator[None]:
    """Close what was opened if the block fails, and raise the refusal in place of an error of HDF5."""
    try:
        yield
    except BaseException as error:
        close()
        if isinstance(error, HDF5_ERRORS):
            raise refusal(error) from error
        raise


def _cannot_write(path: Path, error: Exception) -> InputError | MachineError:
    return files.refusal(error, f"cannot write results to {path.parent}", "choose another `out` folder")


def _cannot_reopen(path: Path, error: Exception) -> InputError | MachineError:
    return files.refusal(error, f"cannot resume the run, because {path} cannot be written", "check its permissions")


def _checked(
    arrays: Mapping[str, np.ndarray], declared: Mapping[str, Rows] | Mapping[str, FieldRows], counts: tuple[int, ...], what: str
) -> dict[str, np.ndarray]:
    """The arrays of some steps as they are stored; ValueError where they are not what was declared."""
    if arrays.keys() != declared.keys():
        raise ValueError(f"{what} has {sorted(arrays)}, declared were {sorted(declared)}")
    checked = {name: np.ascontiguousarray(array, dtype=float) for name, array in arrays.items()}
    for name, array in checked.items():
        if array.shape != (*counts, *declared[name].shape):
            raise ValueError(f"{name} has shape {array.shape[1:]}, declared was {(*counts[1:], *declared[name].shape)}")
    return checked
