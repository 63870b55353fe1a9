"""Output of ``explicitfe plot`` and ``explicitfe view`` in the terminal."""

from __future__ import annotations

from rich.console import Group
from rich.markup import escape

from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs
from explicitfe.results.documents.drawn import DrawnPictures, ShownScene


def drawn_table(drawn: DrawnPictures) -> Group:
    """The files of ``explicitfe plot``."""
    return file_lines([*_results(drawn), *(("picture", path) for path in drawn["files"])])


def scene_table(shown: ShownScene) -> Group:
    """The files of ``explicitfe view``, or the note that it was a window."""
    table = pairs("")
    table.add_row("view", escape(f"{shown['view']}, {shown['field']}"))
    if not shown["files"]:
        table.add_row("window", "closed")
    return Group(table, file_lines([*_results(shown), *(("file", path) for path in shown["files"])]))


def _results(drawn: DrawnPictures) -> list[tuple[str, str]]:
    return [("result", path) for path in drawn.get("results", [drawn["result"]])]
