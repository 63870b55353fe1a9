"""Files that a user names: only regular ones are opened, and none that is larger than such a file can be."""

from __future__ import annotations

import stat
from pathlib import Path

from explicitfe.platform.errors import InputError

KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}


def size_of(path: Path, advice: str, *, largest_bytes: int) -> int:
    """The size of a file in bytes, before a library opens it.

    Parameters
    ----------
    advice : what to do if it cannot be read; completes a sentence.
    largest_bytes : a larger file is refused.

    Raises
    ------
    InputError : there is no such file, it is no regular file, is empty, or is too large.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(f"{path}: this cannot be read ({error.strerror}); {advice}.") from None
    kind = stat.S_IFMT(status.st_mode)
    if kind != stat.S_IFREG:
        raise InputError(f"{path}: this is {KINDS.get(kind, 'no regular file')}; {advice}.")
    if status.st_size == 0:
        raise InputError(f"{path}: the file is empty; {advice}.")
    if status.st_size > largest_bytes:
        raise InputError(
            f"{path}: the file has {status.st_size / 2**20:.0f} MiB, and no more than {largest_bytes / 2**20:.0f} MiB are read; "
            f"{advice}."
        )
    return status.st_size
