"""Machine code that stands apart from that of its callers: called by its address, and compiled by a process of its own.

A run is compiled in pieces, which two cores make at the same time. Each piece is stored on disk by itself, and there the process
that has asked for it finds what another one has compiled.
"""

from __future__ import annotations

import os
import signal
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from llvmlite import ir
from numba import typeof
from numba.core import event, types
from numba.core.caching import NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.extending import intrinsic

from explicitfe.platform.compiled.threads import cores

__all__ = ["Piece", "address_of", "call_at", "compile_pieces", "typeof"]

Piece = tuple[Dispatcher, tuple[types.Type, ...]]
"""A function and the types of its arguments."""
LONGEST_WAIT_S = 600.0  # timeout for the child processes, after which this process compiles what they have not stored
SECONDS_BETWEEN_POLLS = 0.02


@intrinsic
def call_at(typingctx, address, arguments):
    """What the compiled function at an address returns for a tuple of arguments: a float64."""
    plain = tuple(types.unliteral(argument) for argument in arguments)

    def lower(context, builder, sig, args):
        given = sig.args[1]
        values = [
            context.cast(builder, builder.extract_value(args[1], k), before, after)
            for k, (before, after) in enumerate(zip(given, plain, strict=True))
        ]
        called = context.call_conv.get_function_type(types.float64, plain)
        pointer = builder.inttoptr(args[0], called.as_pointer())
        assert isinstance(called, ir.FunctionType)
        return context.call_conv.call_function(builder, pointer, types.float64, plain, values)[1]

    return types.float64(types.int64, arguments), lower


def address_of(piece: Piece) -> int:
    """Address of a function that has been compiled or loaded."""
    dispatcher, signature = piece
    compiled = dispatcher.overloads[signature]
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def compile_pieces(pieces: Sequence[Piece]) -> None:
    """Load pieces from disk, or compile them in child processes, one for each core, and load what these have stored.

    This process only waits, so that a listener to Numba's event of a compilation can end the work at any time by an exception.
    """
    with global_compiler_lock:  # another thread that asks for the same pieces waits for them
        missing = [piece for piece in pieces if not _is_loaded(*piece)]
        is_stored = not any(isinstance(dispatcher._cache, NullCache) for dispatcher, _ in missing)
        count = min(cores(), len(missing)) if sys.platform == "linux" and is_stored else 0
        with _queue(len(missing)) as waiting:
            processes = [_compile_in_another_process(missing, waiting) for _ in range(count)]
            try:
                _await(processes)
            finally:
                for process in processes:  # those that have not ended
                    os.kill(process, signal.SIGKILL)
                    _is_running(process, options=0)
        for dispatcher, signature in missing:
            dispatcher.compile(signature)  # loads what another process has stored


@contextmanager
def _queue(length: int) -> Iterator[int]:
    """Pipe with the numbers below ``length``; each read of a byte takes the next one."""
    reader, writer = os.pipe()
    os.write(writer, bytes(range(length)))
    os.close(writer)
    try:
        yield reader
    finally:
        os.close(reader)


def _is_loaded(dispatcher: Dispatcher, signature: tuple[types.Type, ...]) -> bool:
    """Whether a function is compiled in this process, or now loaded from disk."""
    if signature not in dispatcher.overloads:
        loaded = dispatcher._cache.load_overload(signature, dispatcher.targetctx)
        if loaded is not None:
            dispatcher._cache_hits[signature] += 1
            dispatcher.add_overload(loaded)
    return signature in dispatcher.overloads


def _compile_in_another_process(pieces: Sequence[Piece], waiting: int) -> int:
    """Number of a process that compiles pieces from the queue, stores them on disk and ends."""
    with warnings.catch_warnings():  # no other thread is within the compiler, where a copy would remain
        warnings.simplefilter("ignore", DeprecationWarning)  # of other threads: the new process needs none of their locks
        parent, process = os.getpid(), os.fork()
    if process == 0:
        try:
            for handled in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                signal.signal(handled, signal.SIG_DFL)
            nowhere = os.open(os.devnull, os.O_WRONLY)  # the parent process reports progress and errors
            for stream in (1, 2):
                os.dup2(nowhere, stream)
            while os.getppid() == parent and (number := os.read(waiting, 1)):
                dispatcher, signature = pieces[number[0]]
                dispatcher.compile(signature)
        finally:
            os._exit(0)
    return process


def _await(processes: list[int]) -> None:
    """Wait until processes have ended, and remove them from the list; leave those that take too long."""
    end = time.monotonic() + LONGEST_WAIT_S
    while processes and time.monotonic() < end:
        with event.trigger_event("numba:compile"):
            time.sleep(SECONDS_BETWEEN_POLLS)
        processes[:] = [process for process in processes if _is_running(process)]


def _is_running(process: int, options: int = os.WNOHANG) -> bool:
    try:
        return os.waitpid(process, options) == (0, 0)
    except ChildProcessError:  # the system has removed it, as this program was started to ignore its children
        return False
