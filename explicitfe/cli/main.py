"""Entry of the command ``explicitfe``: signals are watched before anything is imported that takes its time."""

from __future__ import annotations

import os
import signal
import sys

from explicitfe.host import standard_streams, stopping

STDERR = 2  # the file descriptor


def entry() -> None:
    """The whole process: what comes after its command can no more be interrupted, there is nothing left to stop."""
    try:
        main()
    finally:
        stopping.ignore()


def main() -> None:
    """Run the command of ``sys.argv``; leave with its exit code if that is not 0."""
    standard_streams.open_all()
    # Products of matrices are small here: more threads would only wait for cores that are busy. In time, for nothing has
    # imported numpy yet, and for the processes that are started too.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    with stopping.watching(_say_that_it_stops, _end_at_once):
        from explicitfe.cli.execute import execute

        code = execute(sys.argv[1:])
    if code:
        sys.exit(code)


def _say_that_it_stops(stop_signal: signal.Signals) -> None:
    """Words that may be written in the midst of anything."""
    os.write(
        STDERR, f"\n{stopping.described(stop_signal)}: what has been computed is being stored; once more ends at once\n".encode()
    )


def _end_at_once(stop_signal: signal.Signals) -> None:
    """End without another instruction: result files can be read at any instant."""
    os.write(STDERR, b"ended at once; what was stored until then can be read\n")
    os._exit(stopping.exit_code(stop_signal))
