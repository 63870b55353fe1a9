"""How far a command is: bars on a terminal, a line now and then in a log."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from explicitfe.errors import Stage, WordedProgress
from explicitfe.host import stopping

# What each stage of a task is called.
STAGES: dict[Stage, str] = {
    "load": "loading machine code",
    "compile": "compiling machine code (about a minute, first time only)",
    "run": "running",
    "identify": "identifying",
    "predict": "predicting",
    "draw": "drawing",
    "compare": "comparing",
    "export": "exporting",
    "trace": "tracing the residual",
    "decide": "deciding on a finer mesh",
    "design": "designing",
    "make": "making cases",
    "warm": "making machine code",
    "bench": "timing",
    "verify": "computing claims",
    "close-loop": "closing the loop on cases",
    "sweep": "computing members",
}
BETWEEN_LINES_S = 10.0  # of a log, which nobody watches
SECONDS_OF_A_MINUTE = 60
# What begins a stage, such as machine code that is compiled, says nothing of its pace.
SHARE_THAT_TELLS_PACE = 0.02


@contextmanager
def following(console: Console, beginning: str) -> Iterator[WordedProgress]:
    """Show at once that a command works, and then how far it is; gives the function to call with a stage and the share done.

    That function raises Stopped where a signal has asked to stop: it is called where work can be left.

    Parameters
    ----------
    console : where; bars if it is a terminal, lines if not.
    beginning : what is done until the first stage, such as "reading vowel-i.toml". Libraries that take a second to import are
        imported inside the block, so that these words come before them.
    """
    shown = _OnTerminal(console, beginning) if console.is_terminal else _InLog(console, beginning)

    def progress(stage: Stage, share: float, words: str = "") -> None:
        shown.show(stage, share, words)
        stopping.check()

    try:
        yield progress
    finally:
        shown.end()


class _OnTerminal:
    """Bars, one a stage; a spinner before the first one, which vanishes."""

    def __init__(self, console: Console, beginning: str) -> None:
        self._bars = Bars(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
        )
        self._beginning = self._bars.add_task(beginning, total=None)
        self._tasks: dict[str, TaskID] = {}
        self._bars.start()

    def show(self, stage: Stage, share: float, words: str) -> None:
        name = STAGES.get(stage, stage)  # its name is better than no answer
        if stage not in self._tasks:
            self._bars.update(self._beginning, visible=False)
            self._tasks[stage] = self._bars.add_task(name, total=1.0)
        self._bars.update(self._tasks[stage], completed=share, description=f"{name}: {words}" if words else name)

    def end(self) -> None:
        self._bars.live.transient = not self._tasks
        self._bars.stop()


class _InLog:
    """A line where a stage begins, and every few seconds one on how far it is."""

    def __init__(self, console: Console, beginning: str) -> None:
        self._console = console
        self._begun: dict[str, tuple[float, float]] = {}  # stage -> when it began, and with which share
        self._say(beginning)

    def show(self, stage: Stage, share: float, words: str) -> None:
        name = STAGES.get(stage, stage)
        if stage not in self._begun:
            self._begun[stage] = time.monotonic(), share
            self._say(f"{name}: {words}" if words else name)
        elif time.monotonic() - self._said_at > BETWEEN_LINES_S and share < 1.0:
            begun_at, first = self._begun[stage]
            gone_s, done = time.monotonic() - begun_at, share - first
            left = f", {_duration(gone_s * (1.0 - share) / done)} left" if done >= SHARE_THAT_TELLS_PACE else ""
            self._say(f"{name}: {f'{words}, ' if words else ''}{100 * share:.0f} %{left}")

    def end(self) -> None:
        """Nothing is left to take away."""

    def _say(self, words: str) -> None:
        self._said_at = time.monotonic()
        self._console.print(words, markup=False, highlight=False, soft_wrap=True)


def _duration(seconds: float) -> str:
    """As bars have it: 1:02:03."""
    minutes, second = divmod(round(seconds), SECONDS_OF_A_MINUTE)
    hour, minute = divmod(minutes, SECONDS_OF_A_MINUTE)
    return f"{hour}:{minute:02d}:{second:02d}"
