"""Execution of a command; every exception becomes one sentence and an exit code, see ``ending.py``."""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Sequence
from contextlib import suppress

import typer

from explicitfe.app.cli.answer import print_failure, print_json, print_note
from explicitfe.app.cli.app import app
from explicitfe.app.cli.completion import PROGRAM, answer_to_shell
from explicitfe.app.cli.ending import DONE_EXIT_CODE, INPUT_EXIT_CODE, debug_first, failure_of, wants_json
from explicitfe.app.cli.streams import stderr, stdout
from explicitfe.platform.errors import MachineError, RunWarning

HELP = frozenset({"--help", "-h"})
UNKNOWN_SHELL_EXIT_CODE = 1  # typer's own, of --install-completion and --show-completion


def execute(words: Sequence[str]) -> int:
    """Run ``explicitfe WORDS``; return its exit code."""
    for stream in (stdout, stderr):
        stream.show_what_cannot_be_encoded()
    with warnings.catch_warnings():
        return _exit_code_of(debug_first(list(words) or ["--help"]))


def _exit_code_of(words: list[str]) -> int:
    """Run a command and report its failure."""
    debug = False
    try:
        try:
            # Not by app(), which handles KeyboardInterrupt and broken pipes silently.
            command = typer.main.get_command(app)
            words_printed = answer_to_shell(command)
            if words_printed is not None:
                return words_printed
            with command.make_context(PROGRAM, words) as context:
                debug = context.params["debug"]
                if not debug:
                    warnings.showwarning = _tell_warning
                command.invoke(context)
        finally:
            stdout.flush()
    except typer.Exit as end:
        return INPUT_EXIT_CODE if end.exit_code == UNKNOWN_SHELL_EXIT_CODE else end.exit_code
    except SystemExit:  # raised by rich if the reader of --help has closed the pipe
        return DONE_EXIT_CODE
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, BrokenPipeError) and not HELP.isdisjoint(words):  # likewise by click
            return DONE_EXIT_CODE
        if debug:
            stderr.write(traceback.format_exc())
        ending = failure_of(error)
        if wants_json(words):
            with suppress(MachineError):  # it cannot be written
                print_json({"failure": ending})
        print_failure(ending)
        return ending["exit_code"]
    return DONE_EXIT_CODE


def _tell_warning(message: Warning | str, category: type[Warning], *place: object, **more: object) -> None:
    """Print warnings for users; those of libraries are for programmers and shown with --debug only."""
    if issubclass(category, RunWarning):
        print_note(str(message))
