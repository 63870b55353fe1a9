"""Signals that ask a program to stop: a note that long loops look at, never an exception in the midst of something else.

Python raises KeyboardInterrupt wherever it is: half-way through a sample, or inside a callback that swallows it. So while
:func:`watching`, the first signal is only noted. Loops look at it between two chunks of compiled code, end where everything is
consistent, and store what they have. A second signal ends the program at once.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType

# Ctrl-C, what batch systems and "kill" send, and a terminal that is closed; Windows knows the first two.
SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
EXIT_CODE_OF_SIGNAL_0 = 128  # shells add the number of the signal that ended a program


class Stopped(KeyboardInterrupt):
    """A signal has asked to stop, and the work was left where everything is consistent.

    Attributes
    ----------
    signal : the signal.
    """

    def __init__(self, stop_signal: signal.Signals) -> None:
        super().__init__(described(stop_signal))
        self.signal = stop_signal


class _Note:
    """What has been asked: at most one signal, until the outermost :func:`watching` ends."""

    asked: signal.Signals | None = None
    watching: bool = False


_further_check: ContextVar[Callable[[], None] | None] = ContextVar("further check", default=None)


def asked() -> signal.Signals | None:
    """The signal that has asked to stop, if one has."""
    return _Note.asked


def check() -> None:
    """Leave here if that was asked.

    Raises
    ------
    Stopped : a signal has come; or what the function of :func:`checking` raises.
    """
    if _Note.asked is not None:
        raise Stopped(_Note.asked)
    further = _further_check.get()
    if further is not None:
        further()


@contextmanager
def checking(further: Callable[[], None]) -> Iterator[None]:
    """Call a function wherever work of this thread can be left, until the block ends. It may raise to leave there."""
    token = _further_check.set(further)
    try:
        yield
    finally:
        _further_check.reset(token)


def described(stop_signal: signal.Signals) -> str:
    """ "interrupted by Ctrl-C" or "interrupted by SIGTERM"."""
    return f"interrupted by {'Ctrl-C' if stop_signal == signal.SIGINT else stop_signal.name}"


def exit_code(stop_signal: signal.Signals) -> int:
    """What a program that a signal has stopped ends with: 130 for Ctrl-C, 143 for SIGTERM, 129 for SIGHUP."""
    return EXIT_CODE_OF_SIGNAL_0 + stop_signal


@contextmanager
def watching(
    first: Callable[[signal.Signals], None] | None = None, second: Callable[[signal.Signals], None] | None = None
) -> Iterator[None]:
    """Note signals instead of being interrupted by them, until the block ends.

    Only the main thread of a program receives signals: elsewhere, and inside another such block, nothing changes. A signal that
    the program was started to ignore (by ``nohup``, or in the background of a script) stays ignored.

    Parameters
    ----------
    first, second : called with the first signal, and with each further one; must be short. Without ``second`` a further signal
        raises KeyboardInterrupt, at once.
    """
    if _Note.watching or threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        stop_signal = signal.Signals(number)
        if _Note.asked is None:
            _Note.asked = stop_signal
            _end_workers()
            if first is not None:
                first(stop_signal)
        elif second is not None:
            second(stop_signal)
        else:
            raise KeyboardInterrupt

    before = {number: signal.getsignal(number) for number in SIGNALS}
    _Note.asked, _Note.watching = None, True
    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, note)
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # one that was not installed from Python cannot be put back
                signal.signal(number, handler)
        _Note.asked, _Note.watching = None, False


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt at once in this block, which waits for a person to type."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def ignore() -> None:
    """Let no signal disturb what is left to do: to leave."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def leave_signals_to_the_parent() -> None:
    """What a worker process begins with: Ctrl-C reaches it too, and it is its parent that decides; it ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    """Wait for the end of the process that started this one: nobody asks its workers for an answer any more."""
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _end_workers() -> None:
    """End the processes that this one has started to compute: what they have not handed over is computed again another time."""
    if "multiprocessing" in sys.modules:
        import multiprocessing

        for child in multiprocessing.active_children():
            child.terminate()
