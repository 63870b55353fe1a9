"""``explicitfe bench``."""

from __future__ import annotations

from collections.abc import Sequence

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command()
def bench(*, sizes: Sequence[int] = (), as_json: bool = False) -> None:
    """Measure the time per element and time step on this machine, and compare it with the documented time.

    Example: [bold]explicitfe bench --elements 1000 --elements 30000[/bold]

    Parameters
    ----------
    sizes : number of elements: 1000 | 30000 | 250000.
    """
    with following(console, "starting") as progress:
        from explicitfe.app.tools.speed import TIMED_SIZES
        from explicitfe.app.tools.speed import bench as time_it
        from explicitfe.app.view.terminal.program import speed_notes, speed_tables

        speed = time_it(sizes or tuple(TIMED_SIZES), progress)
    print_answer(speed, as_json, lambda: speed_tables(speed), speed_notes(speed))
