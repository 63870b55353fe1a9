"""Reports that kernels are being compiled: in this process, and in worker processes that send the report to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from explicitfe.platform.host import stopping
from explicitfe.platform.host.code_cache import compiler_watched

Report = Callable[[str], None]
"""Called with the kernels that are being compiled, such as "transient runs of hex8 elements"."""


class _Listener:
    """The function that receives the reports of this process."""

    report: Report | None = None


def set_listener(report: Report | None) -> None:
    """Send the reports of this process to a function; None discards them."""
    _Listener.report = report


@contextmanager
def listening(report: Report) -> Iterator[None]:
    """Send the reports of this process to a function until the block ends."""
    before = _Listener.report
    set_listener(report)
    try:
        yield
    finally:
        set_listener(before)


def announce(what: str) -> None:
    """Report that kernels are being compiled."""
    if _Listener.report is not None:
        _Listener.report(what)


@contextmanager
def announcing(what: str, begins: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Report the first compilation in this block, and leave before a further one if a signal asked for it; loading is none.

    Parameters
    ----------
    what : the kernels that the block needs.
    begins : called after the report.
    """
    is_reported = False

    def report() -> None:
        nonlocal is_reported
        stopping.check()
        if not is_reported:
            is_reported = True
            announce(what)
            begins()

    with compiler_watched(report):
        yield
