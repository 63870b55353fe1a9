"""Entry of the command ``explicitfe``: signals are watched before anything is imported that takes its time."""

from __future__ import annotations

import gc
import os
import signal
import sys

from explicitfe.platform.host import standard_streams, stopping

STDERR_DESCRIPTOR = 2  # the file descriptor
# New objects after which Python looks for garbage: imports make many that stay, and looking as usual took a tenth of a start.
OBJECTS_BETWEEN_COLLECTIONS = 100_000


def entry() -> None:
    """Entry point of the process; signals are ignored after the command has ended."""
    try:
        main()
    finally:
        stopping.ignore()


def main() -> None:
    """Run the command of ``sys.argv``; leave with its exit code if that is not 0."""
    standard_streams.open_all()
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    # Products of matrices are small here: more threads would only wait for cores that are busy. In time, for nothing has
    # imported numpy yet, and for the processes that are started too.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    with stopping.watching(_confirm_stop, _quit):
        from explicitfe.app.cli.execute import execute

        code = execute(sys.argv[1:])
    if code:
        sys.exit(code)


def _confirm_stop(stop_signal: signal.Signals) -> None:
    """Confirm the first signal; os.write is safe inside a signal handler."""
    sentence = (
        f"\n{stopping.described(stop_signal)}: stopping as soon as all files are complete; press Ctrl-C again to quit now\n"
    )
    os.write(STDERR_DESCRIPTOR, sentence.encode())


def _quit(stop_signal: signal.Signals) -> None:
    """Exit immediately; result files are readable at any time."""
    os.write(STDERR_DESCRIPTOR, b"quit; files that were stored are readable\n")
    os._exit(stopping.exit_code(stop_signal))
