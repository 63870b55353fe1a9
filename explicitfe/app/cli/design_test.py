"""``explicitfe design-test``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import inverse
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_protocol
from explicitfe.app.view.progress import following


@command(inverse.design_test, without=("processes",), completions={"protocol": complete_protocol})
def design_test(protocol: Path, *, propose: bool = False, as_json: bool = False, **options: Any) -> None:
    """Predict which effects a planned test can detect and distinguish.

    Print the smallest strength that the test detects and the effects that it cannot distinguish.

    Example: [bold]explicitfe design-test gerard-2005[/bold]

    Parameters
    ----------
    protocol : protocol (TOML file, or a name from ``explicitfe list protocols``); with --propose a dataset or a report of
        close-loop.
    propose : propose the most informative next tests for a dataset or a report.
    """
    with following(console, f"reading {protocol}") as progress:
        from explicitfe.app.view.terminal.design import design_tables, proposal_tables

        if propose:
            proposed = inverse.propose_tests(protocol, **options, progress=progress)
        else:
            planned = inverse.design_test(protocol, **options, progress=progress)
    if propose:
        print_answer(proposed.document, as_json, lambda: proposal_tables(proposed))
    else:
        print_answer(planned.document, as_json, lambda: design_tables(planned))
