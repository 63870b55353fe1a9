"""``explicitfe export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import JsonOption, ResultArgument
from explicitfe.app.view.progress import following


def export(
    result: ResultArgument,
    to: Annotated[
        list[str],
        typer.Option(
            "--to", metavar="FORMAT", help="csv, parquet, vtu, stl, mat or npz; repeat for several formats.", show_default=False
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Output folder.", show_default="folder of the result"),
    ] = None,
    at_ms: Annotated[
        float | None, typer.Option("--at-ms", metavar="T", help="Time for vtu and stl.", show_default="last sample")
    ] = None,
    positions: Annotated[bool, typer.Option("--positions", help="In tables: write positions instead of displacements.")] = False,
    history: Annotated[bool, typer.Option("--history", help="In tables: add energies and all other histories.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing files.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Export a result for other programs: a table of point trajectories, all arrays, a mesh or a surface.

    Example: [bold]explicitfe export vowel-i --to csv[/bold]
    """
    with following(console, f"reading {result}") as progress:
        from explicitfe.app.view.terminal.files import file_lines
        from explicitfe.results.files.export.export import export as export_result

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
