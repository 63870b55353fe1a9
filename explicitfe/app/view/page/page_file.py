"""The file of a page: whether it may be written, and writing it."""

from __future__ import annotations

import os
from pathlib import Path

from explicitfe.app.view.files import writing
from explicitfe.platform.errors import InputError
from explicitfe.results.files.folder import whole_file


def page_file(usual: Path, out: Path | None, overwrite: bool) -> Path:
    """The file of a page, if it may be written.

    Parameters
    ----------
    usual : default file.
    out : file that the user names.
    overwrite : replace an existing page.

    Raises
    ------
    InputError : the name does not end in .html, or the file exists or is a folder.
    """
    target = usual if out is None else out
    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{target}: a report is an HTML page; use a name that ends in .html.")
    if target.is_dir():
        raise InputError(f"{target} is a folder; name a file in it, such as {target / 'report.html'}.")
    if os.path.lexists(target) and not overwrite:
        raise InputError(f"{target} exists; add --overwrite to replace it, or name another file with --out.")
    return target


def write_page(target: Path, text: str) -> float:
    """Write the text of a page, completely or not at all, and return its size in MB.

    Raises
    ------
    InputError : the file cannot be written there.
    MachineError : the disk is full.
    """
    with writing(target, "name another file with --out"):
        target.parent.mkdir(parents=True, exist_ok=True)
        whole_file(target, text)
    return target.stat().st_size / 1e6
