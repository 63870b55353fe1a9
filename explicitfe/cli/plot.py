"""``explicitfe plot``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption, OverwriteFilesOption, PicturesFolderOption, is_sweep, result_argument
from explicitfe.errors import InputError
from explicitfe.view.progress import following


def plot(
    result: Annotated[Path, result_argument("Result file (.vtkhdf), its name in outputs/, or the folder of a sweep.")],
    only: Annotated[
        str | None,
        typer.Option(
            "--only",
            metavar="NAMES",
            help="contour, coronal, probes, energies, palatogram, airway, 3d, hourglass; of an indentation curve, section; of a "
            "sweep outlines, effects, indices, or two columns as A:B; with commas between them. All if left out.",
            show_default=False,
        ),
    ] = None,
    file_format: Annotated[str, typer.Option("--format", metavar="FORMAT", help="png, pdf or svg.")] = "png",
    times: Annotated[
        str | None,
        typer.Option(
            "--times",
            metavar="MS",
            help="The times to draw, in ms, with commas between them; pictures of one time show the last.",
            show_default=False,
        ),
    ] = None,
    out: PicturesFolderOption = None,
    overwrite: OverwriteFilesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Draw a result as pictures: contour, probes over time, energies, airway and more. Or the folder of a sweep.

    Example: [bold]explicitfe plot outputs/vowel-i.vtkhdf --only contour,probes --format pdf --times 20,50,200[/bold]
    """
    names = None if only is None else [name.strip() for name in only.split(",")]
    times_s = None if times is None else [1e-3 * _number(text) for text in times.split(",")]
    with following(console, f"reading {result}") as progress:
        from explicitfe.view.terminal.drawn import drawn_table

        if is_sweep(result):
            from explicitfe.sweep.pictures import draw_sweep

            if times_s is not None:
                raise InputError(f"{result}: a sweep has no times to draw; leave --times out.")
            drawn = draw_sweep(result, out, only=names, file_format=file_format, overwrite=overwrite, progress=progress)
        else:
            from explicitfe.view.draw import draw

            drawn = draw(
                result, out, only=names, file_format=file_format, times_s=times_s, overwrite=overwrite, progress=progress
            )
    print_answer(drawn, as_json, lambda: drawn_table(drawn), drawn["warnings"])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f'--times: "{text.strip()}" is no number of milliseconds; give times such as 20,50,200') from None
