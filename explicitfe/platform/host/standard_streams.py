"""Standard input, output and error: open, even where a program was started without them."""

from __future__ import annotations

import os

STANDARD_DESCRIPTORS = (0, 1, 2)


def open_all() -> None:
    """Open those that are closed (``command 2>&-``) on nothing.

    The next file that is opened would get their number otherwise: a result file, into which messages of libraries would then go.
    """
    for descriptor in STANDARD_DESCRIPTORS:
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free, which is this one
