"""How a command ends: its exit code, and the error message as text and as JSON."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import typer
from typing_extensions import TypedDict

from explicitfe.platform.errors import InputError, MachineError, RunError
from explicitfe.platform.host import stopping
from explicitfe.platform.host.files import REFUSALS

DONE_EXIT_CODE = 0
INPUT_EXIT_CODE = 2  # as programs that read options use it
NOT_DONE_EXIT_CODE = 3

FailureKind = Literal["input", "simulation", "machine", "fault", "stopped", "check"]
"""Cause of a failure: the input, a simulation that ended early, the machine (disk, memory), an internal error of explicitfe, a
signal, or a check that is not fulfilled."""

LONGEST_MESSAGE_CHARACTERS = 1000  # an error echoes what it was given
LONGEST_FAULT_CHARACTERS = 300
_USAGE_ERROR = typer.BadParameter.__base__ or typer.BadParameter  # of click, which typer brings along under changing names


class CommandFailure(TypedDict):
    """Why a command failed: ``message`` is a sentence for people, ``kind`` is its cause."""

    kind: FailureKind
    message: str
    exit_code: int


class FailureAnswer(TypedDict):
    """Output of a command with ``--json`` that has no other answer."""

    failure: CommandFailure


def command_failure(kind: FailureKind, message: str) -> CommandFailure:
    """A failure with its exit code."""
    if kind == "stopped":
        stop_signal = stopping.asked()
        code = stopping.exit_code(stopping.SIGNALS[0] if stop_signal is None else stop_signal)
    else:
        code = INPUT_EXIT_CODE if kind == "input" else NOT_DONE_EXIT_CODE
    return {"kind": kind, "message": without_middle(message, LONGEST_MESSAGE_CHARACTERS), "exit_code": code}


def failure_of(error: BaseException) -> CommandFailure:
    """The failure to report for an exception that has ended a command."""
    if isinstance(error, InputError):
        return command_failure("input", str(error))
    if isinstance(error, _USAGE_ERROR):
        return command_failure("input", _usage(error))
    if isinstance(error, KeyboardInterrupt):
        reason = str(error) or stopping.described(stopping.SIGNALS[0])
        return command_failure("stopped", f"{reason}; no incomplete file was left, and files stored before are unchanged.")
    if isinstance(error, MachineError):
        return command_failure("machine", str(error))
    if isinstance(error, RunError):
        return command_failure("simulation", str(error))
    at = _worked_on(error)
    if isinstance(error, MemoryError):
        return command_failure("machine", f"not enough memory{at}; use a coarser mesh or fewer samples.")
    if _is_lost_worker(error):
        if stopping.asked() is not None:
            return command_failure("stopped", "interrupted; files stored before are unchanged.")
        return command_failure("machine", f"a worker process was killed{at}, often because memory ran out; use fewer workers.")
    if isinstance(error, FileNotFoundError) and _is_folder_deleted():
        return command_failure("machine", "the current folder has been deleted; change to an existing folder (cd).")
    if isinstance(error, OSError) and error.errno in REFUSALS:
        name = "" if error.filename is None else f"{error.filename}: "
        return command_failure("machine", f"{name}the operating system refused an operation ({error.strerror}){at}.")
    return command_failure(
        "fault",
        f"internal error of explicitfe{at} ({short_name(error)}). Your input may be correct. Please report this error with the "
        "file and with the output of the same command with --debug.",
    )


def without_middle(text: str, most_characters: int) -> str:
    """Shorten a text to at most so many characters by removing its middle."""
    if len(text) <= most_characters:
        return text
    half = (most_characters - 3) // 2
    return f"{text[:half]} … {text[-half:]}"


def _usage(error: BaseException) -> str:
    """One sentence on wrong options, with the command that shows the help."""
    words = " ".join(error.format_message().split()) if hasattr(error, "format_message") else str(error)
    context = getattr(error, "ctx", None)
    command = "explicitfe" if context is None else context.command_path
    words = words if words.endswith("?") else f"{words.rstrip('.')};"
    return f"{words} see `{command} --help`."


def _worked_on(error: BaseException) -> str:
    """The text " while working on FILE", with the first file or folder among the command's arguments."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__package__") == __package__:
            for name in frame.f_code.co_varnames[: frame.f_code.co_argcount]:
                value = frame.f_locals.get(name)
                files = value if isinstance(value, list) else [value]
                if files and all(isinstance(file, Path) for file in files):
                    return f" while working on {', '.join(map(str, files))}"
    return ""


def short_name(error: BaseException) -> str:
    """Type and message of an exception on one line."""
    message = " ".join(str(error).split())
    return without_middle(f"{type(error).__name__}: {message}" if message else type(error).__name__, LONGEST_FAULT_CHARACTERS)


def _is_folder_deleted() -> bool:
    """Whether the current folder does not exist any more."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def _is_lost_worker(error: BaseException) -> bool:
    from concurrent.futures import BrokenExecutor  # not imported before it is needed: it takes time

    return isinstance(error, BrokenExecutor)


def debug_first(words: Sequence[str]) -> list[str]:
    """Move ``--debug``, which is accepted anywhere, to the front, where the options of ``explicitfe`` itself are parsed."""
    end = words.index("--") if "--" in words else len(words)
    options = [word for word in words[:end] if word != "--debug"]
    return ["--debug"] * (len(options) < end) + options + list(words[end:])


def wants_json(words: Sequence[str]) -> bool:
    """Whether the words ask for JSON."""
    return "--json" in words[: words.index("--") if "--" in words else len(words)]
