"""Entry of the command ``explicitfe``: whatever happens becomes one sentence and an exit code, which ``ending.py`` names."""

from __future__ import annotations

import os
import signal
import sys
import traceback
import warnings
from contextlib import suppress

import typer

from explicitfe.cli.answer import print_error, print_json, print_note
from explicitfe.cli.app import app
from explicitfe.cli.ending import DONE_EXIT_CODE, debug_first, error_of, wants_json
from explicitfe.cli.streams import stderr, stdout
from explicitfe.errors import MachineError
from explicitfe.host import stopping

STDERR = 2  # the file descriptor


def main() -> None:
    """Run the command of ``sys.argv``."""
    # Products of matrices are small here: more threads would only wait for cores that are busy. In time, for nothing has
    # imported numpy yet, and for the processes that are started too.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    for stream in (stdout, stderr):
        stream.show_what_cannot_be_encoded()
    with warnings.catch_warnings(), stopping.watching(_say_that_it_stops, _end_at_once):
        code = _exit_code_of(debug_first(sys.argv[1:] or ["--help"]))
    if code:
        sys.exit(code)


def _exit_code_of(words: list[str]) -> int:
    """Run the command that the words name; whatever ends it is told here."""
    debug = False
    try:
        try:
            # Not by app(), which takes KeyboardInterrupt and broken pipes for itself, without a word.
            command = typer.main.get_command(app)
            with command.make_context("explicitfe", words) as context:
                debug = context.params["debug"]
                if not debug:
                    warnings.showwarning = _tell_warning
                command.invoke(context)
        finally:
            stdout.flush()
    except typer.Exit as end:
        return end.exit_code
    except SystemExit:  # so rich ends --help whose reader has left
        return DONE_EXIT_CODE
    except (Exception, KeyboardInterrupt) as error:
        if debug:
            stderr.write(traceback.format_exc())
        ending = error_of(error)
        if wants_json(words):
            with suppress(MachineError):  # there is no room for it
                print_json({"error": ending})
        print_error(ending)
        return ending["exit_code"]
    return DONE_EXIT_CODE


def _tell_warning(message: Warning | str, category: type[Warning], *place: object, **more: object) -> None:
    """Say what a room warns of; libraries warn their programmers, who ask for it with --debug."""
    if category is UserWarning:
        print_note(str(message))


def _say_that_it_stops(stop_signal: signal.Signals) -> None:
    """Words that may be written in the midst of anything."""
    os.write(
        STDERR, f"\n{stopping.described(stop_signal)}: what has been computed is being stored; once more ends at once\n".encode()
    )


def _end_at_once(stop_signal: signal.Signals) -> None:
    """End without another instruction: result files can be read at any instant."""
    os.write(STDERR, b"ended at once; what was stored until then can be read\n")
    os._exit(stopping.exit_code(stop_signal))
