"""``explicitfe doctor``."""

from __future__ import annotations

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.view.progress import following


def doctor(as_json: JsonOption = False) -> None:
    """Look at this installation: versions, cores, load, memory, disk, kept machine code, extras, and whether 3D can be drawn.

    Its answer belongs into every report of a fault.

    Example: [bold]explicitfe doctor[/bold]
    """
    with following(console, "looking at this machine") as progress:
        from explicitfe.run.doctor import examine
        from explicitfe.view.terminal.program import examination_table

        examination = examine(progress=progress)
    advice = [f"{one['name']}: {one['advice']}" for one in examination["findings"] if one["advice"]]
    print_answer(examination, as_json, lambda: examination_table(examination), advice)
