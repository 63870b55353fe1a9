"""``explicitfe export``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import export as api
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command(api.export)
def export(result: Path, *, as_json: bool = False, **options: Any) -> None:
    """Export a result for other programs: a table of point trajectories, all arrays, a mesh or a surface.

    Example: [bold]explicitfe export vowel-i --to csv[/bold]
    """
    with following(console, f"reading {result}") as progress:
        from explicitfe.app.view.terminal.files import file_lines
        from explicitfe.results.files.export.export import export as export_result

        exported = export_result(result, **options, progress=progress)
    print_answer(exported, as_json, lambda: file_lines([(file["format"], file["file"]) for file in exported["files"]]))
