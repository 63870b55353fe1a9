"""``explicitfe design-test``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.completion import complete_protocol
from explicitfe.cli.options import JsonOption
from explicitfe.view.progress import following


def design_test(
    protocol: Annotated[
        Path,
        typer.Argument(
            help="Protocol file (TOML), or the name of one that `explicitfe list protocols` shows.",
            show_default=False,
            autocompletion=complete_protocol,
        ),
    ],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the numbers and a page of them.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what an earlier plan wrote.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Say which effects a planned test can find and tell apart, before anything is measured.

    Example: [bold]explicitfe design-test gerard-2005[/bold]
    """
    with following(console, f"reading {protocol}") as progress:
        from explicitfe.close_loop.design import design_test as design
        from explicitfe.view.terminal.design import design_tables

        planned = design(protocol, out=out, overwrite=overwrite, progress=progress)
    print_answer(planned.document, as_json, lambda: design_tables(planned))
