"""``explicitfe bench``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import JsonOption
from explicitfe.app.view.progress import following


def bench(
    sizes: Annotated[
        list[int] | None,
        typer.Option("--elements", metavar="N", help="Number of elements: 1000 | 30000 | 250000; repeatable."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the time per element and time step on this machine, and compare it with the documented time.

    Example: [bold]explicitfe bench --elements 1000 --elements 30000[/bold]
    """
    with following(console, "starting") as progress:
        from explicitfe.app.tools.speed import TIMED_SIZES
        from explicitfe.app.tools.speed import bench as time_it
        from explicitfe.app.view.terminal.program import speed_notes, speed_tables

        speed = time_it(sizes or tuple(TIMED_SIZES), progress)
    print_answer(speed, as_json, lambda: speed_tables(speed), speed_notes(speed))
