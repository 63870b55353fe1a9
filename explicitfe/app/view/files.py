"""Files of pictures, films and pages: whether they may be written, and the error if they cannot be."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.files import refusal

ANOTHER_FOLDER = "choose another --out folder"


def new_files(targets: Iterable[Path], overwrite: bool) -> None:
    """Check that files may be written, and make their folders.

    Raises
    ------
    InputError : a file exists and must not be replaced, or is a folder or a device, or its folder cannot be made.
    MachineError : the disk is full.
    """
    for target in targets:
        with writing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            if target.is_dir() or (target.exists() and not target.is_file()):
                raise InputError(f"{target} is not a regular file; {ANOTHER_FOLDER}.")
            if target.is_file() and not overwrite:
                raise InputError(f"{target} exists; add --overwrite to replace it, or {ANOTHER_FOLDER}.")


@contextmanager
def writing(target: Path, advice: str = ANOTHER_FOLDER) -> Iterator[None]:
    """Write a file in this block; a refusal of the operating system becomes a sentence that names the file.

    Parameters
    ----------
    advice : what the user can do if the disk is not full.

    Raises
    ------
    InputError : the file cannot be written there.
    MachineError : the disk is full.
    """
    try:
        yield
    except OSError as error:
        raise refusal(error, f"cannot write {target}", advice) from None
