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
from contextlib import contextmanager, suppress

from llvmlite import ir
from numba import typeof
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.extending import intrinsic

from explicitfe.platform.compiled.threads import cores

__all__ = ["Piece", "address_of", "call_at", "compile_pieces", "typeof"]

Piece = tuple[Dispatcher, tuple[types.Type, ...]]
"""A function and the types of its arguments."""
LONGEST_WAIT_S = 300.0  # timeout for a child process, counted from the end of the parent's own compilation


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
    """Load pieces from disk, or compile them in this process and in child processes on free cores."""
    with global_compiler_lock:  # another thread that asks for the same pieces waits for them
        missing = [piece for piece in pieces if not _is_loaded(*piece)]
        others = min(cores(), len(missing)) - 1 if sys.platform == "linux" else 0
        with _queue(len(missing)) as waiting:
            processes = [_compile_in_another_process(missing, waiting) for _ in range(others)]
            _compile_next(missing, waiting)
        for process in processes:
            _await(process)
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


def _compile_next(pieces: Sequence[Piece], waiting: int) -> None:
    """Compile pieces until the queue is empty."""
    while number := os.read(waiting, 1):
        dispatcher, signature = pieces[number[0]]
        dispatcher.compile(signature)


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
        process = os.fork()
    if process == 0:
        try:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            nowhere = os.open(os.devnull, os.O_WRONLY)  # the parent process reports progress and errors
            for stream in (1, 2):
                os.dup2(nowhere, stream)
            _compile_next(pieces, waiting)
        finally:
            os._exit(0)
    return process


def _await(process: int) -> None:
    """Wait until a process has ended; end it if it takes too long."""
    end = time.monotonic() + LONGEST_WAIT_S
    with suppress(ChildProcessError):
        while os.waitpid(process, os.WNOHANG) == (0, 0):
            if time.monotonic() > end:
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)
                return
            time.sleep(0.01)
