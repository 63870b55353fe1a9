"""``explicitfe doctor``."""

from __future__ import annotations

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command()
def doctor(*, as_json: bool = False) -> None:
    """Check the installation: versions, cores, load, memory, disk, compiled kernels, optional packages and 3D graphics.

    Include this output in bug reports.

    Example: [bold]explicitfe doctor[/bold]
    """
    with following(console, "checking the installation") as progress:
        from explicitfe.app.tools.doctor import examine
        from explicitfe.app.view.terminal.program import examination_table

        examination = examine(progress=progress)
    advice = [f"{one['name']}: {one['advice']}" for one in examination["findings"] if one["advice"]]
    print_answer(examination, as_json, lambda: examination_table(examination), advice)
