"""What a command leaves on disk beside result files: a whole folder or file, or nothing.

A folder is filled under a hidden name, ``.NAME.XXXXXXXX.part``, and renamed at the end; for that moment an earlier answer is
``.NAME.XXXXXXXX.old``. What a killed command left of these is put right by the next one: each is locked by who fills it.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from explicitfe.errors import InputError
from explicitfe.host.extras import PACKAGES, has_extra, how_to_install
from explicitfe.host.files import create_private, lock, rename_new

# A folder that is as young as this and empty may belong to a command that is just about to lock it.
UNLOCKED_FOR_S = 60.0


def checked_target(out: Path, overwrite: bool, *, summary: str, what: str) -> Path:
    """The folder ``out``, if it may be written.

    Parameters
    ----------
    out : a folder that is new or empty, or one that holds an earlier answer of the same command.
    overwrite : whether an earlier answer may be replaced.
    summary : the file by which an earlier answer is known, such as ``identify.json``.
    what : how messages call such an answer, such as "identification".

    Raises
    ------
    InputError : ``out`` is a file or cannot be written, holds something else, or an earlier answer that is not to be replaced.
    """
    try:
        target = out.resolve()
        if target in (here := Path.cwd().resolve(), *here.parents):
            raise InputError(f"{out}: the answer takes the place of this folder, and you are in it; name a folder in it.")
        _put_right(target, summary)
        if target.exists() and not target.is_dir():
            raise InputError(f"{out}: this is a file; name a folder.")
        if target.is_dir() and any(target.iterdir()):
            if not (target / summary).is_file():
                raise InputError(f"{out}: this folder holds something else; name a new one, or an empty one.")
            if not overwrite:
                raise InputError(f"{out}: this folder holds an earlier {what}; name another one, or add --overwrite.")
        # Better now than after the work.
        existing = next(folder for folder in target.parents if folder.exists())
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", suffix=".part", dir=existing):
            pass
    except (OSError, RuntimeError) as error:  # A circle of links is a RuntimeError.
        raise InputError(f"{out}: this cannot be written ({getattr(error, 'strerror', None) or error}).") from None
    except ValueError as error:
        raise (
            error if isinstance(error, InputError) else InputError(f"{str(out)!r}: this cannot be the name of a folder.")
        ) from None
    return out


@contextmanager
def drawing(warnings: list[str]) -> Iterator[None]:
    """Draw pictures in this block: if that fails, a sentence is added to the warnings, and the numbers are not lost for it.

    Without the packages that draw, the sentence says how to install them.

    Raises
    ------
    OSError : the pictures cannot be written, and so nothing can.
    """
    try:
        yield
    except OSError:
        raise
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != PACKAGES["plots"] or has_extra("plots"):
            raise
        warnings.append(f"no pictures were drawn: that needs {how_to_install('plots')}")
    except Exception as error:
        warnings.append(f"not all pictures could be drawn, a fault of explicitfe ({type(error).__name__}: {error}).")


@contextmanager
def whole_folder(target: Path, *, summary: str | None = None) -> Iterator[Path]:
    """A folder to fill, beside the target; it takes its place at the end, or nothing of it is left.

    Parameters
    ----------
    summary : the file that lists what belongs to an earlier answer, which is replaced; what it does not list is kept.

    Raises
    ------
    InputError : the folder cannot be written.
    """
    given, target = target, target.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _put_right(target, summary)
        beside = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent))
    except OSError as error:
        raise InputError(f"{given}: this cannot be written ({error.strerror}).") from None
    try:
        with _locked(beside):
            beside.chmod(0o755)
            yield beside
            old = beside.with_suffix(".old")
            if target.exists():
                target.rename(old)
            beside.rename(target)
            if old.exists():
                _keep_what_is_not_listed(old, target, summary)
    except OSError as error:
        raise InputError(f"{given}: this cannot be written ({error.strerror}).") from None
    finally:
        if beside.exists():
            shutil.rmtree(beside, ignore_errors=True)


def whole_file(path: Path, content: str | bytes, *, overwrite: bool = True) -> None:
    """Write a file as a whole or not at all.

    Parameters
    ----------
    overwrite : replace one that is there.

    Raises
    ------
    FileExistsError : something is there, and is not to be replaced.
    OSError : it cannot be written.
    """
    with whole_stream(path, overwrite=overwrite) as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def whole_stream(path: Path, *, overwrite: bool = True) -> Iterator[BinaryIO]:
    """A file to fill; it gets its name at the end, or nothing of it is left. See :func:`whole_file`."""
    number, beside = create_private(path.parent, path.name)
    try:
        with os.fdopen(number, "wb") as file:
            yield file
        if overwrite:
            beside.replace(path)
        else:
            rename_new(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed commands left half-written in a folder, whatever its name was to be."""
    with suppress(OSError):
        for path in list(folder.iterdir()):
            if re.fullmatch(r"\..+\.\w+\.part", path.name) and _is_left(path):
                _remove(path)


def _put_right(target: Path, summary: str | None) -> None:
    """Remove what killed commands left of a folder; the earlier answer takes its place again where the new one had not yet."""
    left = re.compile(rf"\.{re.escape(target.name)}\.\w+\.(part|old)")
    with suppress(OSError):
        for path in list(target.parent.iterdir()):
            match = left.fullmatch(path.name)
            if match is None or not path.is_dir() or not _is_left(path):
                continue
            if match[1] == "part":
                _remove(path)
            elif not target.exists():
                path.rename(target)
            else:
                _keep_what_is_not_listed(path, target, summary)


def _keep_what_is_not_listed(old: Path, target: Path, summary: str | None) -> None:
    """Remove an earlier answer, but what its summary does not list: that is the user's own, and goes into the new folder."""
    listed: set[str] = set()
    if summary is not None:
        with suppress(OSError, ValueError, TypeError, KeyError, AttributeError):  # A summary that is damaged lists nothing.
            listed = {summary, *(Path(name).name for name in json.loads((old / summary).read_text(encoding="utf-8"))["files"])}
        for path in old.iterdir():
            if path.name not in listed and not os.path.lexists(target / path.name):
                path.rename(target / path.name)
    remains = old.with_suffix(".part")
    old.rename(remains)
    shutil.rmtree(remains)


def _is_left(path: Path) -> bool:
    """Whether no process that is alive fills a file or folder."""
    if path.is_dir() and not any(path.iterdir()) and time.time() - path.stat().st_mtime < UNLOCKED_FOR_S:
        return False
    with _locked(path) as is_free:
        return is_free


@contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Hold the lock of a file or folder; False where another process holds it."""
    if os.name == "nt":  # Windows opens no folders.
        yield True
        return
    number = os.open(path, os.O_RDONLY)
    try:
        yield lock(number)
    finally:
        os.close(number)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
