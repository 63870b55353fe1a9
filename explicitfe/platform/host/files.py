"""Safe files in folders that other processes use too: unique names, no symbolic links followed, no accidental replacement.

A file that is being written is locked by its process; the lock ends with the process. A system without such locks (Windows) or
without atomic renaming uses the nearest equivalent.
"""

from __future__ import annotations

import ctypes
import errno
import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from explicitfe.platform.errors import InputError, MachineError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Neither a link nor, where it has such a thing, a terminal or a pipe is waited for.
PLAIN_FILE_FLAGS = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY", "O_CLOEXEC"))
RENAME_NOREPLACE_FLAG = 1  # of Linux's renameat2
AT_FDCWD_NUMBER = -100
# What a system answers that has no renameat2, or whose file system has none, or no hard links.
CANNOT = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EPERM, errno.EMLINK}
# What an operating system refuses without anybody's fault in a program.
REFUSALS = {
    getattr(errno, name)
    for name in ("EACCES", "EDQUOT", "EFBIG", "EIO", "EMFILE", "ENFILE", "ENOMEM", "ENOSPC", "EPERM", "EROFS", "ESTALE")
    if hasattr(errno, name)
}
# Those of them that no other file name would change.
WITHOUT_ROOM = {getattr(errno, name) for name in ("EDQUOT", "EFBIG", "EIO", "ENOMEM", "ENOSPC") if hasattr(errno, name)}
BETWEEN_LOCK_TRIES_S = 0.05
STALE_AFTER_S = 3600.0  # an unlocked file younger than that may belong to a run that is just about to lock it


def create_private(folder: Path, stem: str) -> tuple[int, Path]:
    """A new empty file, open for reading and writing and locked, under a hidden name that nobody else can have.

    Raises
    ------
    OSError : the folder cannot be written.
    """
    while True:
        path = folder / f".{stem}.{secrets.token_hex(8)}.part"
        with suppress(FileExistsError):
            number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | PLAIN_FILE_FLAGS, 0o666)
            lock(number)
            return number, path


def remove_stale(folder: Path, stem: str) -> None:
    """Remove what :func:`create_private` made for processes that are dead and left it an hour ago or more."""
    wanted = re.compile(rf"\.{re.escape(stem)}\.[0-9a-f]{{16}}\.part")
    with suppress(OSError):
        for entry in os.scandir(folder):
            if not wanted.fullmatch(entry.name):
                continue
            with suppress(OSError):
                if entry.stat(follow_symlinks=False).st_mtime > time.time() - STALE_AFTER_S:
                    continue
                number = open_plain(Path(entry.path))
                try:
                    if lock(number):
                        Path(entry.path).unlink()
                finally:
                    os.close(number)


def open_plain(path: Path) -> int:
    """Open a file for reading and writing, if it is one.

    Raises
    ------
    OSError : there is none, it may not be written, or it is a link, a folder, a pipe or a device.
    """
    number = os.open(path, os.O_RDWR | PLAIN_FILE_FLAGS)
    if stat.S_ISREG(os.fstat(number).st_mode):
        return number
    os.close(number)
    raise OSError(errno.EINVAL, "this is no plain file", str(path))


def is_plain(path: Path) -> bool:
    """Whether there is a file itself: not a link to one, not a folder, pipe or device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def is_at(path: Path, number: int) -> bool:
    """Whether the file that is open as ``number`` is, now, the one at ``path``."""
    try:
        return os.path.samestat(path.lstat(), os.fstat(number))
    except OSError:
        return False


def lock(number: int, *, to_read: bool = False) -> bool:
    """Lock an open file until it is closed, or the process dies; False where another process, or another part of this, has.

    A lock ``to_read`` is refused only where one to write is held.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(number, (fcntl.LOCK_SH if to_read else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # a file system without locks
    return True


@contextmanager
def one_at_a_time(path: Path) -> Iterator[None]:
    """What is done within this no other process does at the same time; ``path`` is a file for it, which stays.

    Raises
    ------
    OSError : the file cannot be made.
    """
    number = os.open(path, os.O_RDWR | os.O_CREAT | PLAIN_FILE_FLAGS, 0o666)
    try:
        while not lock(number):
            time.sleep(BETWEEN_LOCK_TRIES_S)
        yield
    finally:
        os.close(number)


def rename_new(source: Path, target: Path) -> None:
    """Rename a file to a name that nothing has, not even a dangling link.

    Raises
    ------
    FileExistsError : something has the name.
    OSError : the folder cannot be written.
    """
    attempts: tuple[Callable[[Path, Path], None], ...] = (_rename_at_once, _rename_by_link, _rename_after_a_look)
    for attempt in attempts:
        try:
            attempt(source, target)
        except OSError as error:
            if isinstance(error, FileExistsError) or error.errno not in CANNOT or attempt is attempts[-1]:
                raise
        else:
            return


def sync(number: int, folder: Path) -> None:
    """Have a file and the folder that names it on the disk itself, so that a power cut does not undo a renaming."""
    os.fsync(number)
    with suppress(OSError):  # some systems do not open folders
        folder_number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(folder_number)
        finally:
            os.close(folder_number)


def reserve(number: int, size: int) -> None:
    """Have room for ``size`` bytes behind the end of an open file, all or nothing.

    Where the system cannot reserve (macOS, Windows), the disk says so when it is written.

    Raises
    ------
    OSError : the disk has no room for them.
    """
    if not hasattr(os, "posix_fallocate"):
        return
    end = os.fstat(number).st_size
    try:
        os.posix_fallocate(number, end, size)
    except OSError as error:
        if error.errno in (errno.EINVAL, errno.EOPNOTSUPP):  # a file system that cannot
            return
        with suppress(OSError):
            os.ftruncate(number, end)
        raise


def refusal(error: BaseException, what: str, advice: str) -> InputError | MachineError:
    """The error to raise where a file cannot be written: MachineError (exit code 3) for a full disk, otherwise InputError (2).

    Parameters
    ----------
    what : begins the sentence, such as "cannot write FILE".
    advice : what the user can do if the disk is not full, such as "choose another --out folder".
    """
    if isinstance(error, OSError) and error.errno in WITHOUT_ROOM:
        return MachineError(f"{what} ({reason(error)}); free disk space or use another disk.")
    return InputError(f"{what} ({reason(error)}); {advice}.")


def reason(error: BaseException) -> str:
    """Why the operating system refused, in its words."""
    return os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)


def _rename_at_once(source: Path, target: Path) -> None:
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if os.name == "posix" else None
    if renameat2 is None:
        raise OSError(errno.ENOSYS, "")
    if renameat2(AT_FDCWD_NUMBER, os.fsencode(source), AT_FDCWD_NUMBER, os.fsencode(target), RENAME_NOREPLACE_FLAG) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), str(target))


def _rename_by_link(source: Path, target: Path) -> None:
    os.link(source, target, follow_symlinks=False)
    source.unlink()


def _rename_after_a_look(source: Path, target: Path) -> None:
    if os.path.lexists(target):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
    source.rename(target)
