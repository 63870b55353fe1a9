"""Where a command writes: stdout for its answer, stderr for words to people.

Nobody may be listening (``explicitfe list muscles | head -1``), or the disk that a log goes to may be full. Neither ends a run:
words that cannot be written are dropped. An answer that cannot be written is an error, unless its reader has simply left.
"""

from __future__ import annotations

import os
import sys
import unicodedata
from collections.abc import Iterable
from typing import IO, Literal, cast

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from explicitfe.errors import MachineError

# Titles and names come from files of others: a terminal obeys control characters, so they are shown instead.
_VISIBLE = {
    code: 0x2400 + code if code < 0x20 else 0xFFFD
    for code in range(0x100)
    if unicodedata.category(chr(code)) == "Cc" and chr(code) not in "\n\t"
}


class Stream:
    """``sys.stdout`` or ``sys.stderr``, whichever object stands there now.

    Parameters
    ----------
    name : which.
    needed : whether a write that the machine refuses is an error.
    """

    def __init__(self, name: Literal["stdout", "stderr"], *, needed: bool) -> None:
        self._name = name
        self._needed = needed

    def _target(self) -> IO[str] | None:
        target = getattr(sys, self._name)  # None where there is no console; a bar of progress may stand in for it
        return cast("IO[str] | None", getattr(target, "rich_proxied_file", target))

    def write(self, text: str) -> int:
        """Write a text.

        Raises
        ------
        MachineError : it is needed, and the machine refuses.
        """
        target = self._target()
        if target is not None:
            try:
                target.write(text)
            except OSError as error:
                self._give_up(target, error)
        return len(text)

    def flush(self) -> None:
        """Hand on what was written; raises as :meth:`write` does."""
        target = self._target()
        if target is not None:
            try:
                target.flush()
            except OSError as error:
                self._give_up(target, error)

    def isatty(self) -> bool:
        target = self._target()
        return target is not None and target.isatty()

    def fileno(self) -> int:
        target = self._target()
        if target is None:
            raise OSError(f"there is no {self._name}")
        return target.fileno()

    @property
    def encoding(self) -> str:
        return getattr(self._target(), "encoding", None) or "utf-8"

    def show_what_cannot_be_encoded(self) -> None:
        """Write characters that the encoding of the stream lacks as escapes: an answer with them is better than none."""
        reconfigure = getattr(self._target(), "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")

    def _give_up(self, target: IO[str], error: OSError) -> None:
        """Let what is buffered, and all that follows, vanish: python would try again when it ends."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, target.fileno())
        os.close(nowhere)
        if self._needed and not isinstance(error, BrokenPipeError):
            raise MachineError(f"the answer could not be written to {self._name}: {error.strerror}.") from error


class Screen(Console):
    """A console on a stream that shows control characters instead of sending them to the terminal."""

    def __init__(self, stream: Stream) -> None:
        super().__init__(file=cast(IO[str], stream))

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=segment.text.translate(_VISIBLE))


stdout = Stream("stdout", needed=True)
stderr = Stream("stderr", needed=False)
