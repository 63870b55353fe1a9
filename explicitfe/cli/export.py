"""``explicitfe export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.view.progress import following


def export(
    result: Annotated[Path, typer.Argument(help="Result file (.vtkhdf).", show_default=False)],
    to: Annotated[
        list[str],
        typer.Option(
            "--to", metavar="FORMAT", help="csv | parquet | vtu | stl | mat | npz; repeat for more.", show_default=False
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder; that of the result if left out.", show_default=False)
    ] = None,
    at_ms: Annotated[
        float | None, typer.Option("--at-ms", metavar="T", help="When, for vtu and stl; at the end if left out.")
    ] = None,
    positions: Annotated[
        bool, typer.Option("--positions", help="In tables, where points are, not how far they have moved from rest.")
    ] = False,
    history: Annotated[bool, typer.Option("--history", help="In tables, energies and the rest of the history too.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a result for other programs: a table of points as sensors see them, arrays, a mesh, a surface.

    Example: [bold]explicitfe export outputs/vowel-i.vtkhdf --to csv[/bold]
    """
    with following(console, f"reading {result}") as progress:
        from explicitfe.results.export.export import export as export_result
        from explicitfe.view.terminal.files import file_lines

        exported = export_result(
            result,
            to,
            out,
            time_s=None if at_ms is None else 1e-3 * at_ms,
            positions=positions,
            history=history,
            overwrite=overwrite,
            progress=progress,
        )
    print_answer(exported, as_json, lambda: file_lines([(file["format"], file["file"]) for file in exported["files"]]))
