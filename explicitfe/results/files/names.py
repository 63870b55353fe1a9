"""Names of result files, and which existing files a run may replace.

A result has a hidden temporary name before its first sample and is ``<stem>.running.vtkhdf`` until its run ends. It gets its
final name ``<stem>.vtkhdf`` when the run ends by itself, successfully or not. An interrupted or killed run keeps the running
name. Only results are replaced, only with ``overwrite``, and never one that is being written.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from explicitfe.platform.errors import InputError
from explicitfe.platform.host import files
from explicitfe.platform.host.result_files import RUNNING_SUFFIX, SUFFIX, running_path
from explicitfe.results.files.layout import FINISHED, FORMAT_VERSION, RUNNING
from explicitfe.results.files.reader import open_result
from explicitfe.results.files.stored import NoResultError


def check_names(path: Path, overwrite: bool) -> None:
    """Check that a run may write its result to ``path`` and use the running name until then; no file is changed.

    Raises
    ------
    InputError : the name has another suffix, or belongs to a file that a run must not replace.
    """
    if path.suffix != SUFFIX:
        raise InputError(f"result {path} must end in .vtkhdf: ParaView and pyvista recognize the file type by this suffix")
    running = running_path(path)
    if path.stem.endswith(RUNNING_SUFFIX):
        owner = path.stem.removesuffix(RUNNING_SUFFIX)
        raise InputError(f'{path} is the name of an unfinished result of "{owner}"; choose another name with `name`')
    try:
        is_folder = path.is_dir()
    except OSError as error:  # a name that is too long
        raise InputError(f"result {path} cannot be written ({files.reason(error)}); choose another name") from None
    if is_folder:
        raise InputError(f"result {path} is a folder; choose another `out` folder")
    if os.path.lexists(path):
        if not overwrite:
            raise InputError(f"result {path} exists; add `overwrite` to replace it or choose another `out` folder")
        with _locked(path):
            _check_replaceable(path)
    if os.path.lexists(running):
        with _unfinished(running, overwrite):
            pass


def check_stopped(path: Path, final: Path, overwrite: bool) -> tuple[int, int]:
    """Number of restart states and of samples in an interrupted result; InputError if it cannot be resumed."""
    if path.is_symlink():
        raise InputError(f"{path} is a symbolic link; give the file it points to")
    with open_result(path) as result:
        if result.live:
            raise InputError(f"another run is writing {path}; wait until it ends")
        if result.status == FINISHED:
            raise InputError(f"{path} is finished; there is nothing to resume")
        if result.format != FORMAT_VERSION:
            raise InputError(f"{path} was written by an older version, which stored no restart state; run the scenario again")
        if path != final and os.path.lexists(final) and not overwrite:
            raise InputError(f"result {final} exists; add `overwrite` to replace it, or move it away")
        if len(result.times):
            result.history("time")
            for name in result.fields:
                result.field(name)
        state = result.restart_state()
        return (0 if state is None else state.sequence), len(result.times)


def to_running(source: Path, running: Path, overwrite: bool) -> None:
    """Rename the temporary result file to the running name, replacing the file of a killed run if that is permitted.

    Raises
    ------
    InputError : a file of this name exists that must not be replaced.
    OSError : the folder cannot be written.
    """
    try:
        files.rename_new(source, running)
    except FileExistsError:
        with _unfinished(running, overwrite):
            source.replace(running)


def to_final(running: Path, path: Path, overwrite: bool) -> None:
    """Rename a complete result to its final name.

    Raises
    ------
    InputError : a file of this name has been created meanwhile and must not be replaced; the result keeps its running name.
    OSError : the folder cannot be written.
    """
    try:
        files.rename_new(running, path)
    except FileExistsError:
        try:
            if not overwrite:
                raise InputError(f"{path} was created by another program during the run") from None
            with _locked(path):
                _check_replaceable(path)
                running.replace(path)
        except InputError as error:
            raise InputError(f"{error.args[0].rstrip('.')}; the complete result is {running}, rename it yourself") from None


def _check_replaceable(path: Path) -> None:
    """InputError unless a file is a result of this program, damaged or not."""
    try:
        open_result(path).close()
    except NoResultError as error:
        raise InputError(f"{error}. It is not replaced; move it away or choose another `out` folder") from None
    except InputError:
        pass  # HDF5, damaged


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock of a file, so that no other process writes it.

    Raises
    ------
    InputError : another process holds it, or it is a link or no regular file, or may not be written.
    """
    if path.is_symlink():
        raise InputError(f"{path} is a symbolic link and is not replaced; remove it or choose another `out` folder")
    if not files.is_plain(path):
        raise InputError(f"{path} is not a regular file and is not replaced; choose another `out` folder")
    try:
        number = files.open_plain(path)
    except OSError as error:
        raise InputError(f"{path} cannot be replaced ({files.reason(error)}); choose another `out` folder") from None
    try:
        if not files.lock(number):
            if files.lock(number, to_read=True):
                raise InputError(f"{path} is open for reading, here or in another program; close it before it is replaced")
            raise InputError(f"another run is writing {path}; wait until it ends or choose another `out` folder")
        if not files.is_at(path, number):
            raise InputError(f"another run is writing {path}; wait until it ends or choose another `out` folder")
        yield
    finally:
        os.close(number)


@contextmanager
def _unfinished(running: Path, overwrite: bool) -> Iterator[None]:
    """Hold the lock of an interrupted or killed run's file while it is replaced; InputError if it must not be replaced."""
    with _locked(running):
        _check_replaceable(running)
        state, samples = _progress_of(running)
        if state == FINISHED:
            raise InputError(f"{running} is a complete result that was not renamed; rename it or choose another `out` folder")
        if not overwrite:
            held = f"{samples} samples" if samples is not None else "damaged data"
            how = f"resume it with 'explicitfe resume {shlex.quote(str(running))}', or " if samples else ""
            raise InputError(f"{running} holds {held} of an interrupted run; {how}add `overwrite` to start again")
        yield


def _progress_of(running: Path) -> tuple[str, int | None]:
    """Status and number of samples of an unfinished result; None where it is damaged."""
    try:
        with open_result(running) as result:
            return result.status, len(result.times)
    except InputError:
        return RUNNING, None
