"""``explicitfe warmup``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import JsonOption
from explicitfe.app.view.progress import following


def warmup(
    everything: Annotated[bool, typer.Option("--all", help="Include all element types and viscoelastic tissue.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Precompile the simulation kernels. They are cached on disk, so that later commands need not compile them.

    Example: [bold]explicitfe warmup[/bold]
    """
    with following(console, "starting") as progress:
        from explicitfe.app.tools.speed import warm
        from explicitfe.app.view.terminal.program import kernels_table

        kernels = warm(everything, progress)
    print_answer(kernels, as_json, lambda: kernels_table(kernels["seconds"]))
