"""``explicitfe warmup``."""

from __future__ import annotations

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command()
def warmup(*, everything: bool = False, as_json: bool = False) -> None:
    """Precompile the simulation kernels. They are cached on disk, so that later commands need not compile them.

    Example: [bold]explicitfe warmup[/bold]

    Parameters
    ----------
    everything : include all element types and viscoelastic tissue.
    """
    with following(console, "starting") as progress:
        from explicitfe.app.tools.speed import warm
        from explicitfe.app.view.terminal.program import kernels_table

        kernels = warm(everything, progress)
    print_answer(kernels, as_json, lambda: kernels_table(kernels["seconds"]))
