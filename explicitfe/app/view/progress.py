"""Progress of a command: bars on a terminal, a line every few seconds in a log."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, Task, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars
from rich.text import Text

from explicitfe.platform.errors import Progress, Share, Stage
from explicitfe.platform.host import stopping
from explicitfe.platform.host.compilation import listening

# The words for each stage of a task.
STAGES: dict[Stage, str] = {
    "load": "loading compiled kernels",
    "compile": "compiling kernels",
    "run": "running",
    "load-step": "computing load steps",
    "identify": "identifying",
    "predict": "predicting",
    "draw": "drawing",
    "compare": "comparing",
    "export": "exporting",
    "trace": "tracing the residual",
    "design": "computing signatures of effects",
    "make": "making cases",
    "warm": "compiling kernels",
    "bench": "timing",
    "verify": "computing claims",
    "close-loop": "processing cases",
    "sweep": "computing runs",
}
# Stages whose parts take equal time: only there the elapsed time predicts the remaining time.
UNIFORM_STAGES = frozenset[Stage]({"run", "export", "sweep"})
SECONDS_BETWEEN_LINES = 10.0
SECONDS_OF_A_MINUTE = 60
# The first part of a stage, such as the compilation of kernels, does not predict the rest.
SMALLEST_SHARE_FOR_AN_ESTIMATE = 0.02


@contextmanager
def following(console: Console, beginning: str) -> Iterator[Progress]:
    """Show at once that a command works, and then its progress; give the function to call with a stage and the share done.

    The function raises Stopped if a signal has requested to stop: it is called where work can be interrupted. A ``Share`` is
    shown with its words. The first compilation of a group of kernels is shown as well.

    Parameters
    ----------
    console : bars if it is a terminal, lines if not.
    beginning : the words until the first stage, such as "reading vowel-i.toml". Libraries that take a second to import are
        imported inside the block, so that these words come first.
    """
    shown = _OnTerminal(console, beginning) if console.is_terminal else _InLog(console, beginning)
    announced: set[str] = set()

    def progress(stage: Stage, share: float) -> None:
        shown.show(stage, share, share.words if isinstance(share, Share) else "")
        stopping.check()

    def tell_compilation(what: str) -> None:
        if what not in announced:
            announced.add(what)
            shown.say(f"Compiling kernels for {what} (JIT; cached for later runs; `explicitfe warmup` compiles the usual ones).")

    try:
        with listening(tell_compilation):
            yield progress
    finally:
        shown.end()


class _Estimate:
    """The remaining time of a stage, from the time that its share has taken so far."""

    def __init__(self, stage: str, share: float) -> None:
        self._holds, self._first, self._begun_at = stage in UNIFORM_STAGES, share, time.monotonic()

    def words(self, share: float) -> str:
        """Such as "1:02:03 remaining"; empty where no estimate holds."""
        done, elapsed_s = share - self._first, time.monotonic() - self._begun_at
        if not self._holds or done < SMALLEST_SHARE_FOR_AN_ESTIMATE or share >= 1.0:
            return ""
        return f"{_duration(elapsed_s * (1.0 - share) / done)} remaining"


class _Estimates(TextColumn):
    """The remaining time of each bar, where an estimate holds."""

    def __init__(self) -> None:
        super().__init__("")

    def render(self, task: Task) -> Text:
        estimate = task.fields.get("estimate")
        return Text(estimate.words(task.completed) if estimate else "")


class _OnTerminal:
    """One bar per stage; a spinner before the first one, which disappears."""

    def __init__(self, console: Console, beginning: str) -> None:
        self._bars = Bars(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            _Estimates(),
            console=console,
        )
        self._beginning = self._bars.add_task(beginning, total=None)
        self._tasks: dict[str, TaskID] = {}
        self._bars.start()

    def show(self, stage: Stage, share: float, words: str) -> None:
        name = STAGES.get(stage, stage)
        if stage not in self._tasks:
            self._bars.update(self._beginning, visible=False)
            self._tasks[stage] = self._bars.add_task(name, total=1.0, estimate=_Estimate(stage, share))
        self._bars.update(self._tasks[stage], completed=share, description=f"{name}: {words}" if words else name)

    def say(self, sentence: str) -> None:
        self._bars.console.print(sentence, markup=False, highlight=False)

    def end(self) -> None:
        self._bars.live.transient = not self._tasks
        self._bars.stop()


class _InLog:
    """A line where a stage begins, and one every few seconds with its progress."""

    def __init__(self, console: Console, beginning: str) -> None:
        self._console = console
        self._begun: dict[str, _Estimate] = {}
        self.say(beginning)

    def show(self, stage: Stage, share: float, words: str) -> None:
        name = STAGES.get(stage, stage)
        if stage not in self._begun:
            self._begun[stage] = _Estimate(stage, share)
            self.say(f"{name}: {words}" if words else name)
        elif time.monotonic() - self._said_at > SECONDS_BETWEEN_LINES and share < 1.0:
            parts = [words, f"{100 * share:.0f} %", self._begun[stage].words(share)]
            self.say(f"{name}: {', '.join(part for part in parts if part)}")

    def say(self, sentence: str) -> None:
        self._said_at = time.monotonic()
        self._console.print(sentence, markup=False, highlight=False, soft_wrap=True)

    def end(self) -> None:
        """Nothing has to be removed."""


def _duration(seconds: float) -> str:
    """Hours, minutes and seconds, such as 1:02:03."""
    minutes, second = divmod(round(seconds), SECONDS_OF_A_MINUTE)
    hour, minute = divmod(minutes, SECONDS_OF_A_MINUTE)
    return f"{hour}:{minute:02d}:{second:02d}"
