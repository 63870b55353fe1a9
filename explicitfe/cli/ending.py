"""How a command ends: its exit code, and what went wrong, in words and as JSON."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import typer
from typing_extensions import TypedDict

from explicitfe.errors import InputError, MachineError, RunError
from explicitfe.host import code_cache, stopping
from explicitfe.host.files import REFUSALS

DONE_EXIT_CODE = 0
INPUT_EXIT_CODE = 2  # as programs that read options use it
NOT_DONE_EXIT_CODE = 3

FailureKind = Literal["input", "simulation", "machine", "fault", "stopped", "check"]
"""What is to blame: what the user gave, the simulation that could not go on, the machine (disk, memory), explicitfe itself, or
nobody: a signal has stopped it, or what was to be checked does not hold."""

LONGEST_MESSAGE_CHARACTERS = 1000  # an error echoes what it was given
LONGEST_FAULT_CHARACTERS = 300
_USAGE_ERROR = typer.BadParameter.__base__ or typer.BadParameter  # of click, which typer brings along under changing names


class CommandFailure(TypedDict):
    """Why a command did not do what was asked. ``message`` is a sentence for people, ``kind`` says what is to blame."""

    kind: FailureKind
    message: str
    exit_code: int


class FailureAnswer(TypedDict):
    """What a command prints with ``--json`` when it has no other answer."""

    failure: CommandFailure


def command_failure(kind: FailureKind, message: str) -> CommandFailure:
    """A failure, with the exit code that belongs to it."""
    if kind == "stopped":
        stop_signal = stopping.asked()
        code = stopping.exit_code(stopping.SIGNALS[0] if stop_signal is None else stop_signal)
    else:
        code = INPUT_EXIT_CODE if kind == "input" else NOT_DONE_EXIT_CODE
    return {"kind": kind, "message": without_middle(message, LONGEST_MESSAGE_CHARACTERS), "exit_code": code}


def failure_of(error: BaseException) -> CommandFailure:
    """What an exception that has ended a command means to its user."""
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
        return command_failure("machine", f"the memory of this machine ran out{at}: a coarser mesh or fewer samples need less.")
    if _is_lost_worker(error):
        if stopping.asked() is not None:
            return command_failure("stopped", "stopped; what was stored before is still there")
        return command_failure("machine", f"a process that computed for this command was killed{at}: often memory has run out.")
    if _is_of_kept_code(error):
        return command_failure(
            "machine",
            f"machine code that is kept on disk cannot be read or written ({short_name(error)}): remove that folder, "
            f"{_code_folder(error)}, and it is made again; or name another one that only you can write by {code_cache.VARIABLE}.",
        )
    if isinstance(error, OSError) and error.errno in REFUSALS:
        name = "" if error.filename is None else f"{error.filename}: "
        return command_failure("machine", f"{name}the operating system refuses this ({error.strerror}){at}.")
    return command_failure(
        "fault",
        f"a fault of explicitfe{at} ({short_name(error)}). Your input may well be right: please report this with the file, and "
        f"with what the same command says when --debug is added.",
    )


def without_middle(text: str, most_characters: int) -> str:
    """A text of at most so many characters: a longer one loses its middle."""
    if len(text) <= most_characters:
        return text
    half = (most_characters - 3) // 2
    return f"{text[:half]} … {text[-half:]}"


def _usage(error: BaseException) -> str:
    """Wrong use of options, in one sentence that says where the right use is described."""
    words = " ".join(error.format_message().split()) if hasattr(error, "format_message") else str(error)
    context = getattr(error, "ctx", None)
    command = "explicitfe" if context is None else context.command_path
    words = words if words.endswith("?") else f"{words.rstrip('.')};"
    return f"{words} `{command} --help` shows what can be given."


def _worked_on(error: BaseException) -> str:
    """ " while working on FILE": the first file or folder that the command's function was given."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__package__") == __package__:
            for name in frame.f_code.co_varnames[: frame.f_code.co_argcount]:
                value = frame.f_locals.get(name)
                files = value if isinstance(value, list) else [value]
                if files and all(isinstance(file, Path) for file in files):
                    return f" while working on {', '.join(map(str, files))}"
    return ""


def short_name(error: BaseException) -> str:
    """Kind and message of an exception on one line."""
    message = " ".join(str(error).split())
    return without_middle(f"{type(error).__name__}: {message}" if message else type(error).__name__, LONGEST_FAULT_CHARACTERS)


def _is_of_kept_code(error: BaseException) -> bool:
    """Whether Numba failed at the folder where it keeps machine code."""
    files = [Path(frame.f_code.co_filename).parts[-3:] for frame, _ in traceback.walk_tb(error.__traceback__)]
    return ("numba", "core", "caching.py") in files


def _code_folder(error: BaseException) -> str:
    """The folder in which it failed, as far as it is known."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        folder = getattr(frame.f_locals.get("self"), "_cache_path", None)
        if isinstance(folder, str):
            return folder
    return "__pycache__ beside the package"


def _is_lost_worker(error: BaseException) -> bool:
    from concurrent.futures import BrokenExecutor  # not imported before it is needed: it takes time

    return isinstance(error, BrokenExecutor)


def debug_first(words: Sequence[str]) -> list[str]:
    """The words with ``--debug``, which may stand anywhere, in front, where the options of ``explicitfe`` itself stand."""
    end = words.index("--") if "--" in words else len(words)
    options = [word for word in words[:end] if word != "--debug"]
    return ["--debug"] * (len(options) < end) + options + list(words[end:])


def wants_json(words: Sequence[str]) -> bool:
    """Whether a program is to read the answer."""
    return "--json" in words[: words.index("--") if "--" in words else len(words)]
