"""Entry of the command ``explicitfe``: errors become one sentence and an exit code.

Exit code 0: done; 1: the run ended early (what it computed is stored); 2: the input cannot be used; 130: stopped by hand.
"""

from __future__ import annotations

import os
import sys

from rich.markup import escape

from explicitfe.cli.answer import console
from explicitfe.cli.app import app
from explicitfe.errors import InputError, RunError


def main() -> None:
    """Run the command of ``sys.argv``."""
    # Products of matrices are small here: more threads would only wait for cores that are busy. In time, for nothing has
    # imported numpy yet, and for the processes that are started too.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        app()
    except InputError as error:
        console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True, highlight=False, markup=True)
        sys.exit(2)
    except RunError as error:
        console.print(f"[red]failed:[/red] {escape(str(error))}", soft_wrap=True, highlight=False)
        sys.exit(1)
    except KeyboardInterrupt:
        console.print("stopped by hand")
        sys.exit(130)
