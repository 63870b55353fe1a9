"""``explicitfe design-test``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.completion import complete_protocol
from explicitfe.app.cli.options import JsonOption
from explicitfe.app.view.progress import following


def design_test(
    protocol: Annotated[
        Path,
        typer.Argument(
            help="Protocol (TOML file, or a name from `explicitfe list protocols`); with --propose a dataset or a report of "
            "close-loop.",
            show_default=False,
            autocompletion=complete_protocol,
        ),
    ],
    propose: Annotated[
        bool, typer.Option("--propose", help="Propose the most informative next tests for a dataset or a report.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Output folder for the results (JSON) and a page (HTML).")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing results.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Predict which effects a planned test can detect and distinguish.

    Print the smallest strength that the test detects and the effects that it cannot distinguish.

    Example: [bold]explicitfe design-test gerard-2005[/bold]
    """
    with following(console, f"reading {protocol}") as progress:
        from explicitfe.app.view.terminal.design import design_tables, proposal_tables

        if propose:
            from explicitfe.app.api.inverse import propose_tests

            proposed = propose_tests(protocol, out=out, overwrite=overwrite, progress=progress)
        else:
            from explicitfe.app.api.inverse import design_test as design

            planned = design(protocol, out=out, overwrite=overwrite, progress=progress)
    if propose:
        print_answer(proposed.document, as_json, lambda: proposal_tables(proposed))
    else:
        print_answer(planned.document, as_json, lambda: design_tables(planned))
