"""Threads that compute one step together: each stays inside compiled code for many steps, and they wait for one another there.

A barrier of Python, or one thread pool task a step, would cost more than a step of a small mesh. So the threads meet at a
counter in memory: they spin for a while, then give their core away, and then sleep a little at a time, for where there are more
threads than free cores a spinning thread would keep the one that it waits for from running.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from typing import Any

import llvmlite.ir as ir
import numpy as np
from numba.core import types
from numba.core.extending import intrinsic

from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.errors import InputError, shortened

# Entries of a gate, int64, on cache lines of their own.
WAITING, GENERATION, STOP, ABANDONED, GATE = 0, 8, 16, 24, 32

# Turns of waiting before a core is given away to whoever wants it, and before a thread lies down: where it has to share a core
# with the one that it waits for, the system may go on giving the core back to it for milliseconds.
TURNS_BEFORE_YIELD, TURNS_BEFORE_NAP = 2000, 2500
NAP_us = 20

_I32 = ir.IntType(32)
_I64 = ir.IntType(64)


def gate() -> np.ndarray:
    """A meeting point for the threads of one run."""
    return np.zeros(GATE, dtype=np.int64)


def _entry(context, builder, ty, value, index):
    return builder.gep(context.make_array(ty)(context, builder, value).data, [index])


@intrinsic
def atomic_add(typingctx, array, index, value):
    """Add to an entry of an int64 array, indivisibly; give what was there."""

    def lower(context, builder, sig, args):
        return builder.atomic_rmw("add", _entry(context, builder, sig.args[0], args[0], args[1]), args[2], "seq_cst")

    return types.int64(array, types.intp, types.int64), lower


@intrinsic
def atomic_load(typingctx, array, index):
    """An entry of an int64 array as it is now; nothing before or after moves across."""

    def lower(context, builder, sig, args):
        return builder.load_atomic(_entry(context, builder, sig.args[0], args[0], args[1]), "seq_cst", 8)

    return types.int64(array, types.intp), lower


@intrinsic
def atomic_store(typingctx, array, index, value):
    """Write an entry of an int64 array; nothing before or after moves across."""

    def lower(context, builder, sig, args):
        builder.store_atomic(args[2], _entry(context, builder, sig.args[0], args[0], args[1]), "seq_cst", 8)
        return context.get_dummy_value()

    return types.none(array, types.intp, types.int64), lower


@intrinsic
def give_way(typingctx):
    """Let another thread have the core."""

    def lower(context, builder, sig, args):
        name = "SwitchToThread" if os.name == "nt" else "sched_yield"
        function = builder.module.globals.get(name) or ir.Function(builder.module, ir.FunctionType(_I32, []), name)
        builder.call(function, [])
        return context.get_dummy_value()

    return types.none(), lower


@intrinsic
def nap(typingctx, microseconds):
    """Sleep for about so long, a millisecond at least on Windows."""

    def lower(context, builder, sig, args):
        windows = os.name == "nt"
        name, kind = ("Sleep", ir.VoidType()) if windows else ("usleep", _I32)
        function = builder.module.globals.get(name) or ir.Function(builder.module, ir.FunctionType(kind, [_I32]), name)
        builder.call(function, [ir.Constant(_I32, 1) if windows else builder.trunc(args[0], _I32)])
        return context.get_dummy_value()

    return types.none(types.int64), lower


@intrinsic
def ticks(typingctx):
    """Time of the processor that this process has used, in the units of C's clock()."""

    def lower(context, builder, sig, args):
        kind = _I32 if os.name == "nt" else _I64
        function = builder.module.globals.get("clock") or ir.Function(builder.module, ir.FunctionType(kind, []), "clock")
        return builder.zext(builder.call(function, []), _I64) if os.name == "nt" else builder.call(function, [])

    return types.int64(), lower


@leaf
def wait(gate, count):
    """Go on when all ``count`` threads are here, or when one of them never will be."""
    if count > 1:
        generation = atomic_load(gate, GENERATION)
        if atomic_add(gate, WAITING, 1) == count - 1:
            atomic_store(gate, WAITING, 0)
            atomic_add(gate, GENERATION, 1)
        else:
            turns = 0
            while atomic_load(gate, GENERATION) == generation and atomic_load(gate, ABANDONED) == 0:
                turns += 1
                if turns > TURNS_BEFORE_NAP:
                    nap(NAP_us)
                elif turns > TURNS_BEFORE_YIELD:
                    give_way()


@leaf
def ask_to_stop(gate):
    """Let all threads stop after the step that they are in."""
    atomic_store(gate, STOP, 1)


@leaf
def asked_to_stop(gate):
    """Whether one of them has asked for it."""
    return atomic_load(gate, STOP) != 0


def cores() -> int:
    """Number of cores that this process may use; the environment variable EXPLICITFE_CORES overrides it.

    EXPLICITFE_THREADS is its former name.

    Raises
    ------
    InputError : the variable is not a whole number above 0.
    """
    for name in ("EXPLICITFE_CORES", "EXPLICITFE_THREADS"):
        stated = os.environ.get(name, "")
        if stated:
            if not (stated.isascii() and stated.isdecimal() and 0 < len(stated) < 7 and int(stated) > 0):
                raise InputError(f'{name} is "{shortened(stated)}", but must be a number of cores, such as 4; set or unset it.')
            return int(stated)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def together(tasks: Sequence[Callable[[], Any]], gate: np.ndarray) -> list[Any]:
    """Run tasks that meet at a gate, the first in the caller's thread and each other one in its own; give what they return."""
    if len(tasks) == 1:
        return [tasks[0]()]
    pool = _pool(len(tasks) - 1)
    futures: list[Future[Any]] = []
    first: list[Any] = []  # what the task of this thread returned
    try:
        futures.extend(pool.submit(_guarded, task, gate) for task in tasks[1:])
        first.append(tasks[0]())
        return first + [future.result() for future in futures]
    except BaseException:
        if not first:
            gate[ABANDONED] = 1  # the others would wait for ever
        for future in futures:
            future.exception()
        raise


def _guarded(task: Callable[[], Any], gate: np.ndarray) -> Any:
    """Do a task; if it fails, nobody waits for it."""
    try:
        return task()
    except BaseException:
        gate[ABANDONED] = 1
        raise


@cache
def _pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="explicitfe")
