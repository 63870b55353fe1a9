"""``explicitfe compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.view.progress import following


def compare(
    a: Annotated[Path, typer.Argument(help="Result file (.vtkhdf).", show_default=False)],
    b: Annotated[Path, typer.Argument(help="The one that is compared with it.", show_default=False)],
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="SHARE",
            help="End with exit code 3 where displacements differ by more than this share of the largest one.",
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Say how two results differ: keys of their scenarios, fields, points, energies, measures; on different meshes too.

    Example: [bold]explicitfe compare outputs/vowel-i.vtkhdf finer/vowel-i.vtkhdf --tolerance 0.05[/bold]
    """
    with following(console, f"reading {a}, {b}") as progress:
        from explicitfe.measure.compare import compare as compare_results
        from explicitfe.view.terminal.comparison import comparison_tables, difference_in_words

        comparison = compare_results(a, b, tolerance, progress)
    print_answer(
        comparison.document,
        as_json,
        lambda: comparison_tables(comparison),
        failure=None if comparison.within_tolerance in (None, True) else ("check", difference_in_words(comparison)),
    )
