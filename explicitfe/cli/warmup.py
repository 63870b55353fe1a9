"""``explicitfe warmup``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.view.progress import following


def warmup(
    everything: Annotated[bool, typer.Option("--all", help="Also other elements, and tissue that relaxes.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Make the machine code that runs need, now: the first run then need not wait for it.

    Example: [bold]explicitfe warmup[/bold]
    """
    with following(console, "starting") as progress:
        from explicitfe.run.speed import warm
        from explicitfe.view.terminal.program import machine_code_table

        code = warm(everything, progress)
    print_answer(code, as_json, lambda: machine_code_table(code["seconds"]))
