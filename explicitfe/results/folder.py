"""What a command leaves on disk beside result files: a whole folder or nothing."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from explicitfe.errors import InputError


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
    InputError : ``out`` is a file, or holds something else, or an earlier answer that is not to be replaced.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: this is a file; name a folder.")
    if out.is_dir() and any(out.iterdir()):
        if not (out / summary).is_file():
            raise InputError(f"{out}: this folder holds something else; name a new one, or an empty one.")
        if not overwrite:
            raise InputError(f"{out}: this folder holds an earlier {what}; name another one, or add --overwrite.")
    return out


@contextmanager
def drawing(warnings: list[str]) -> Iterator[None]:
    """Draw pictures in this block: if that fails, a sentence is added to the warnings, and the numbers are not lost for it.

    Raises
    ------
    OSError : the pictures cannot be written, and so nothing can.
    """
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        warnings.append(f"not all pictures could be drawn, a fault of explicitfe ({type(error).__name__}: {error}).")


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """A folder to fill, beside the target; it takes its place at the end, or nothing of it is left.

    Raises
    ------
    InputError : the folder cannot be written.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise InputError(f"{target}: this cannot be written ({error.strerror}).") from None
    try:
        beside.chmod(0o755)
        yield beside
        old = None
        if target.exists():
            old = target.with_name(f".{target.name}-old-{beside.name[-8:]}")
            target.rename(old)
        beside.rename(target)
        if old is not None:
            shutil.rmtree(old)
    except OSError as error:
        raise InputError(f"{target}: this cannot be written ({error.strerror}).") from None
    finally:
        if beside.exists():
            shutil.rmtree(beside)
