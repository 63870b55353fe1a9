"""The file of a page: where it may go, and how it is written."""

from __future__ import annotations

import os
from pathlib import Path

from explicitfe.errors import InputError
from explicitfe.host.files import reason
from explicitfe.results.folder import whole_file


def page_file(usual: Path, out: Path | None, overwrite: bool) -> Path:
    """Where a page goes, if it may.

    Parameters
    ----------
    usual : its place if nobody names another.
    out : the place that was named.
    overwrite : replace a page that exists.

    Raises
    ------
    InputError : the name is not that of a page, is taken, or is that of a folder.
    """
    target = usual if out is None else out
    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{target}: a report is a page; give it a name that ends in .html.")
    if target.is_dir():
        raise InputError(f"{target}: this is a folder; name a file in it.")
    if os.path.lexists(target) and not overwrite:
        raise InputError(f"{target} exists; add --overwrite to replace it, or name another file with --out.")
    return target


def write_page(target: Path, text: str) -> float:
    """Write the text of a page, as a whole or not at all; its size, MB.

    Raises
    ------
    InputError : it cannot be written.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        whole_file(target, text)
    except OSError as error:
        raise InputError(f"{target}: this cannot be written ({reason(error)}); name another place with --out.") from None
    return len(text.encode()) / 1e6
