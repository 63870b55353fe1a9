"""Tables of what was drawn."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from explicitfe.results.drawn import DrawnPictures, ShownScene
from explicitfe.view.terminal.rows import pairs


def drawn_table(drawn: DrawnPictures) -> Table:
    """The files of ``explicitfe plot``."""
    table = pairs(drawn["result"])
    for path in drawn["files"]:
        table.add_row("picture", escape(path))
    return table


def scene_table(shown: ShownScene) -> Table:
    """The files of ``explicitfe view``, or that it was a window."""
    table = pairs(shown["result"])
    table.add_row("view", f"{shown['view']}, {shown['field']}")
    for path in shown["files"]:
        table.add_row("file", escape(path))
    if not shown["files"]:
        table.add_row("window", "closed")
    return table
