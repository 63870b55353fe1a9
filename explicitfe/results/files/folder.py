"""Output folders and files of commands other than result files: written completely, or not at all.

A folder is written under a hidden name, ``.NAME.XXXXXXXX.part``, and renamed at the end; during the renaming an earlier answer is
``.NAME.XXXXXXXX.old``. The process that writes them locks them, so the next command can clean up after a killed one.
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

from explicitfe.platform.errors import InputError, MachineError
from explicitfe.platform.host.extras import PACKAGES, has_extra, how_to_install
from explicitfe.platform.host.files import create_private, lock, refusal, rename_new

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
            raise InputError(f"{out} would be replaced, but it contains the current folder; give a folder below it.")
        _put_right(target, summary)
        if target.exists() and not target.is_dir():
            raise InputError(f"{out} is a file; give a folder.")
        if target.is_dir() and any(target.iterdir()):
            if not (target / summary).is_file():
                raise InputError(f"{out} contains other files; give a new or an empty folder.")
            if not overwrite:
                raise InputError(f"{out} contains an earlier {what}; add `overwrite` to replace it, or give another folder.")
        # Better now than after the work.
        existing = next(folder for folder in target.parents if folder.exists())
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", suffix=".part", dir=existing):
            pass
    except (OSError, RuntimeError) as error:  # A circle of links is a RuntimeError.
        raise _cannot_write(out, error) from None
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{str(out)!r} cannot be the name of a folder; choose another name.") from None
    return out


def _cannot_write(folder: Path, error: BaseException) -> InputError | MachineError:
    return refusal(error, f"cannot write the folder {folder}", "choose another `out` folder")


@contextmanager
def drawing(warnings: list[str]) -> Iterator[None]:
    """Draw pictures in this block; an error only adds a sentence to the warnings, so that the numbers are stored anyway.

    If the packages for drawing are missing, the sentence says how to install them.

    Raises
    ------
    OSError : the pictures cannot be written.
    """
    try:
        yield
    except OSError:
        raise
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != PACKAGES["plots"] or has_extra("plots"):
            raise
        warnings.append(f"no pictures were drawn, because drawing needs {how_to_install('plots')}")
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
        warnings.append(f"some pictures could not be drawn because of an internal error ({problem}); please report it.")


@contextmanager
def whole_folder(target: Path, *, summary: str | None = None) -> Iterator[Path]:
    """A temporary folder to write to, which replaces the target at the end or is removed after an error.

    Parameters
    ----------
    summary : file that lists the files of an earlier answer, which are replaced; other files are kept.

    Raises
    ------
    InputError : the folder cannot be written.
    MachineError : the disk is full.
    """
    given, target = target, target.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _put_right(target, summary)
        beside = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent))
    except OSError as error:
        raise _cannot_write(given, error) from None
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
        raise _cannot_write(given, error) from None
    finally:
        if beside.exists():
            shutil.rmtree(beside, ignore_errors=True)


def whole_file(path: Path, content: str | bytes, *, overwrite: bool = True) -> None:
    """Write a file completely or not at all.

    Parameters
    ----------
    overwrite : replace an existing file.

    Raises
    ------
    FileExistsError : a file exists and is not to be replaced.
    OSError : the file cannot be written.
    """
    with whole_stream(path, overwrite=overwrite) as file:
        # A path that is not UTF-8 is shown with escapes such as \udce9, which JSON in a page reads back as it was.
        file.write(content.encode(errors="backslashreplace") if isinstance(content, str) else content)


@contextmanager
def whole_stream(path: Path, *, overwrite: bool = True) -> Iterator[BinaryIO]:
    """A temporary file to write to, renamed at the end or removed after an error. See :func:`whole_file`."""
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
    """Remove incomplete files and folders of killed commands from a folder."""
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
