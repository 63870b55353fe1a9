"""What results are called, and which files a run may replace.

While its run goes on, a result is ``<stem>.running.vtkhdf``; before its first sample it has a name that nobody else can have, and
at the end its own. Only results are ever replaced, with ``overwrite`` alone, and never one that is being written.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from explicitfe.errors import InputError
from explicitfe.host import files
from explicitfe.results.layout import FINISHED, FORMAT_VERSION, RUNNING, running_path
from explicitfe.results.reader import open_result
from explicitfe.results.stored import NoResultError


def check_names(path: Path, overwrite: bool) -> None:
    """See that a run may store its result at ``path``, and call it as it likes until then; nothing is touched.

    Raises
    ------
    InputError : the name is of another kind, or something has it that a run must not replace.
    """
    if path.suffix != ".vtkhdf":
        raise InputError(f"result {path} must end in .vtkhdf: ParaView and pyvista know it by that")
    running = running_path(path)
    if path.stem.endswith(".running"):
        owner = path.name.removesuffix(".running.vtkhdf")
        raise InputError(f'{path} is what an unfinished result of "{owner}" is called; give the scenario another name')
    try:
        is_folder = path.is_dir()
    except OSError as error:  # a name that is too long
        raise InputError(f"result {path} cannot be written ({files.reason(error)}); choose another name") from None
    if is_folder:
        raise InputError(f"result {path} is a folder; choose another --out folder")
    if os.path.lexists(path):
        if not overwrite:
            raise InputError(f"result {path} exists; add --overwrite to replace it or choose another --out folder")
        with _locked(path):
            _check_replaceable(path)
    if os.path.lexists(running):
        with _dead_run(running, overwrite):
            pass


def check_stopped(path: Path, final: Path, overwrite: bool) -> tuple[int, int]:
    """How many restart states and samples a stopped result has; InputError if it cannot be gone on with."""
    if path.is_symlink():
        raise InputError(f"{path} is a link; name the file that it leads to")
    with open_result(path) as result:
        if result.live:
            raise InputError(f"another run is writing {path}; wait until it ends")
        if result.status == FINISHED:
            raise InputError(f"{path} is finished: there is nothing to go on with")
        if result.format != FORMAT_VERSION:
            raise InputError(
                f"{path} was written by an older version, which stored no state to go on from; run the scenario again"
            )
        if path != final and os.path.lexists(final) and not overwrite:
            raise InputError(f"result {final} exists; add --overwrite to replace it, or move it away")
        if len(result.times):
            result.history("time")
            for name in result.fields:
                result.field(name)
        state = result.restart_state()
        return (0 if state is None else state.sequence), len(result.times)


def to_running(source: Path, running: Path, overwrite: bool) -> None:
    """Give a new file the name of a run that goes on, in place of what a dead run left if that may go.

    Raises
    ------
    InputError : something has the name that must not be replaced.
    OSError : the folder cannot be written.
    """
    try:
        files.rename_new(source, running)
    except FileExistsError:
        with _dead_run(running, overwrite):
            source.replace(running)


def to_final(running: Path, path: Path, overwrite: bool) -> None:
    """Give a result that is whole its final name.

    Raises
    ------
    InputError : something has got the name meanwhile that must not be replaced; the result keeps its running name.
    OSError : the folder cannot be written.
    """
    try:
        files.rename_new(running, path)
    except FileExistsError:
        try:
            if not overwrite:
                raise InputError(f"{path} has appeared while the run went on") from None
            with _locked(path):
                _check_replaceable(path)
                running.replace(path)
        except InputError as error:
            raise InputError(f"{error.args[0].rstrip('.')}: the whole result stays at {running}; give it another name") from None


def _check_replaceable(path: Path) -> None:
    """InputError unless a file is a result of this program, be it a damaged one."""
    try:
        open_result(path).close()
    except NoResultError as error:
        raise InputError(f"{error}, and is not replaced; move it away or choose another --out folder") from None
    except InputError:
        pass  # HDF5, damaged


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock of a file, so that nobody goes on writing it.

    Raises
    ------
    InputError : another process holds it, or it is a link or no plain file, or may not be written.
    """
    if path.is_symlink():
        raise InputError(f"{path} is a link, which is never replaced; remove it or choose another --out folder")
    if not files.is_plain(path):
        raise InputError(f"{path} is no plain file, and is not replaced; choose another --out folder")
    try:
        number = files.open_plain(path)
    except OSError as error:
        raise InputError(f"{path} cannot be replaced ({files.reason(error)}); choose another --out folder") from None
    try:
        if not files.lock(number) or not files.is_at(path, number):
            raise InputError(f"another run is writing {path}; wait until it ends or choose another --out folder")
        yield
    finally:
        os.close(number)


@contextmanager
def _dead_run(running: Path, overwrite: bool) -> Iterator[None]:
    """Hold what a run left that was killed, so that it may be replaced; InputError if it may not."""
    with _locked(running):
        _check_replaceable(running)
        state, samples = _left(running)
        if state == FINISHED:
            raise InputError(
                f"{running} holds a whole result that has not got its name; rename it or choose another --out folder"
            )
        if not overwrite:
            held = f"{samples} samples" if samples is not None else "what is left"
            go_on = f"go on with explicitfe resume {running}, or " if samples else ""
            raise InputError(f"{running} holds {held} of a run that was stopped; {go_on}add --overwrite to begin anew")
        yield


def _left(running: Path) -> tuple[str, int | None]:
    """Status and number of samples of what a dead run left; None where it is damaged."""
    try:
        with open_result(running) as result:
            return result.status, len(result.times)
    except InputError:
        return RUNNING, None
