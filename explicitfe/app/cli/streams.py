"""Output of commands: answers on stdout, messages for people on stderr.

A closed pipe (``explicitfe list muscles | head -1``) or a full disk under a log does not end a run: messages that cannot be
written are discarded. An answer that cannot be written is an error, unless the reader has closed the pipe.
"""

from __future__ import annotations

import os
import sys
import unicodedata
from collections.abc import Iterable
from typing import IO, Literal, cast

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from explicitfe.platform.errors import MachineError

# Titles and names may come from files of others. A terminal executes control characters, and characters that change the direction
# of text reverse the rest of a line, so they are replaced by visible ones.
_VISIBLE = {
    code: 0x2400 + code if code < 0x20 else 0xFFFD
    for code in range(0x100)
    if unicodedata.category(chr(code)) == "Cc" and chr(code) not in "\n\t"
} | dict.fromkeys([*range(0x202A, 0x202F), *range(0x2066, 0x206A)], 0xFFFD)


class Stream:
    """The present ``sys.stdout`` or ``sys.stderr``.

    Parameters
    ----------
    name : of the stream.
    needed : whether a failed write is an error.
    """

    def __init__(self, name: Literal["stdout", "stderr"], *, needed: bool) -> None:
        self._name = name
        self._needed = needed

    def _target(self) -> IO[str] | None:
        target = getattr(sys, self._name)  # None without a console; a progress bar may have replaced it
        return cast("IO[str] | None", getattr(target, "rich_proxied_file", target))

    def write(self, text: str) -> int:
        """Write a text.

        Raises
        ------
        MachineError : the stream is needed, and the operating system refuses.
        """
        target = self._target()
        if target is not None:
            try:
                target.write(text)
            except OSError as error:
                self._give_up(target, error)
        return len(text)

    def flush(self) -> None:
        """Flush the stream; raises as :meth:`write` does."""
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
        """Write characters that the encoding of the stream lacks as escape sequences."""
        reconfigure = getattr(self._target(), "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")

    def _give_up(self, target: IO[str], error: OSError) -> None:
        """Discard buffered and later output, which Python would otherwise try to write again at its end."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, target.fileno())
        os.close(nowhere)
        if self._needed and not isinstance(error, BrokenPipeError):
            raise MachineError(f"the answer could not be written to {self._name}: {error.strerror}.") from error


class Screen(Console):
    """A console that replaces control characters by visible ones."""

    def __init__(self, stream: Stream) -> None:
        super().__init__(file=cast(IO[str], stream))

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=segment.text.translate(_VISIBLE))


stdout = Stream("stdout", needed=True)
stderr = Stream("stderr", needed=False)
