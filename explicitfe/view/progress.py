"""How far a long task is, as bars on a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from explicitfe.errors import Progress, Stage
from explicitfe.host import stopping

# What each stage of a task is called.
STAGES: dict[Stage, str] = {
    "compile": "compiling (10 s, first time only)",
    "run": "running",
    "identify": "identifying",
    "predict": "predicting",
    "draw": "drawing",
    "trace": "tracing the residual",
    "decide": "deciding on a finer mesh",
    "design": "designing",
    "make": "making cases",
    "warm": "making machine code",
    "bench": "timing",
    "close-loop": "closing the loop on cases",
}


@contextmanager
def following(console: Console) -> Iterator[Progress]:
    """Show bars on a console; gives the function that is called with a stage and the share of it that is done.

    That function raises Stopped where a signal has asked to stop: it is called where work can be left.
    """
    bars = Bars(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
    )
    tasks: dict[str, TaskID] = {}

    def progress(stage: Stage, share: float) -> None:
        if stage not in tasks:
            bars.start()  # not before there is something to show
            tasks[stage] = bars.add_task(STAGES.get(stage, stage), total=1.0)  # the name itself is better than no answer
        bars.update(tasks[stage], completed=share)
        stopping.check()

    try:
        yield progress
    finally:
        bars.stop()
