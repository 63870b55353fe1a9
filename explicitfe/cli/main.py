"""Entry of the command ``explicitfe``: errors become one sentence and an exit code.

Exit code 0: done; 1: the run ended early (what it computed is stored); 2: the input cannot be used; 130: stopped by hand, 143:
stopped by SIGTERM, 129: by SIGHUP.
"""

from __future__ import annotations

import os
import signal
import sys

from rich.markup import escape

from explicitfe.cli.answer import console
from explicitfe.cli.app import app
from explicitfe.errors import InputError, RunError
from explicitfe.host import stopping

STDERR = 2  # the file descriptor


def main() -> None:
    """Run the command of ``sys.argv``."""
    # Products of matrices are small here: more threads would only wait for cores that are busy. In time, for nothing has
    # imported numpy yet, and for the processes that are started too.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    with stopping.watching(_say_that_it_stops, _end_at_once):
        _run_command()


def _run_command() -> None:
    try:
        app()
    except InputError as error:
        console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True, highlight=False, markup=True)
        sys.exit(2)
    except RunError as error:
        console.print(f"[red]failed:[/red] {escape(str(error))}", soft_wrap=True, highlight=False)
        sys.exit(1)
    except stopping.Stopped as stopped:
        console.print(f"{stopped}; nothing is left half-written, and what was stored before is still there", soft_wrap=True)
        sys.exit(stopping.exit_code(stopped.signal))


def _say_that_it_stops(stop_signal: signal.Signals) -> None:
    """Words that may be written in the midst of anything."""
    os.write(
        STDERR, f"\n{stopping.described(stop_signal)}: what has been computed is being stored; once more ends at once\n".encode()
    )


def _end_at_once(stop_signal: signal.Signals) -> None:
    """End without another instruction: result files can be read at any instant."""
    os.write(STDERR, b"ended at once; what was stored until then can be read\n")
    os._exit(stopping.exit_code(stop_signal))
