"""Text files that a user names: read whole, but no device, no pipe, and nothing that is larger than such a file can be."""

from __future__ import annotations

import codecs
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.plain import MOST_LEVELS, check_plain

# Tables are written by people: the largest that come with the program, the fibres of a tongue, have some 100 kB.
LARGEST_TABLE_BYTES = 4 * 2**20
# A key of so many parts; Python's reader takes a time that grows with the square of their number, hours for a file of 4 MiB.
_LONG_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){100}""")

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}


def text_of(path: Path | str, advice: str, *, largest_bytes: int = LARGEST_TABLE_BYTES, of_other_programs: bool = False) -> str:
    """The text of a file, without a byte-order mark.

    Parameters
    ----------
    advice : what to do if it cannot be read; completes a sentence.
    largest_bytes : a larger file is not read.
    of_other_programs : whether it may also be UTF-16, or the Latin text of Windows, as programs of machines write it.

    Raises
    ------
    InputError : the file is missing, is no regular file, is too large, or holds no UTF-8 text.
    """
    raw = bytes_of(path, advice, largest_bytes)
    if of_other_programs and raw[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if of_other_programs:
            return raw.decode("cp1252", errors="replace")
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: this is not UTF-8 text; save the file as UTF-8.") from None


def bytes_of(path: Path | str, advice: str, largest_bytes: int) -> bytes:
    """The bytes of a file; parameters and errors as of :func:`text_of`."""
    try:
        # Opening a pipe must not wait for someone to write into it.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except OSError as error:
        raise InputError(f"{path}: this cannot be read ({error.strerror}); {advice}.") from None
    except (ValueError, TypeError):  # a NUL in the name, or no name at all
        raise InputError(f"{str(path)!r}: this cannot be the name of a file; {advice}.") from None
    try:
        # Whether it is a regular file is asked of what was opened: the name may be given to something else meanwhile.
        status = os.fstat(descriptor)
        kind = stat.S_IFMT(status.st_mode)
        if kind != stat.S_IFREG:
            raise InputError(f"{path}: this is {_KINDS.get(kind, 'no regular file')}; {advice}.")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            raw = file.read(largest_bytes + 1) or b""  # None where nothing stands ready.
    except OSError as error:
        raise InputError(f"{path}: this cannot be read ({error.strerror}); {advice}.") from None
    finally:
        os.close(descriptor)
    if len(raw) > largest_bytes:
        size = max(status.st_size, len(raw)) / 2**20
        raise InputError(
            f"{path}: the file has {size:.0f} MiB, and no more than {largest_bytes / 2**20:.0f} MiB are read; {advice}."
        )
    return raw


def toml_of(text: str, path: Path | str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises
    ------
    InputError : it is not TOML, or holds what no key can mean: see ``check_plain``.
    """
    too_deep = InputError(f"{path}: there are tables in tables here, more than {MOST_LEVELS} levels; write them flat.")
    if _LONG_KEY.search(text):
        raise too_deep
    try:
        # Python's reader takes \r\n for the end of a line, but not a single \r.
        data = tomllib.loads(text.replace("\r\n", "\n").replace("\r", "\n"))
    except RecursionError:
        raise too_deep from None
    except ValueError as error:  # It is no TOML, or has a whole number of thousands of digits.
        raise InputError(f"{path}: this is not valid TOML: {_sentence(error)}.") from None
    check_plain(data, path)
    return data


def json_of(text: str, path: Path | str) -> Any:
    """What a JSON text holds.

    Raises
    ------
    InputError : it is not JSON, or holds what no key can mean: see ``check_plain``.
    """
    too_deep = InputError(f"{path}: there are lists in lists here, more than {MOST_LEVELS} levels.")
    try:
        data = json.loads(text)
    except RecursionError:
        raise too_deep from None
    except ValueError as error:
        raise InputError(f"{path}: this is not valid JSON: {_sentence(error)}.") from None
    check_plain(data, path)
    return data


def _sentence(error: ValueError) -> str:
    """The reason of a parser in one line, without the advice to programmers that follows a semicolon."""
    return " ".join(str(error).split(";")[0].split())[:200]
