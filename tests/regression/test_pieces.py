"""Machine code that stands apart from its callers: it is called by its address, and another process may compile it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from explicitfe.platform.compiled import pieces
from explicitfe.platform.compiled.jit import bind
from explicitfe.platform.compiled.pieces import address_of, call_at, compile_pieces
from explicitfe.platform.host import stopping
from explicitfe.platform.host.compilation import announcing


class Pair(NamedTuple):
    """An array and a number."""

    values: np.ndarray
    factor: float


def scale(pair, first):
    """Multiply the values from ``first`` on; give their sum."""
    total = 0.0
    for k in range(first, len(pair.values)):
        pair.values[k] *= pair.factor
        total += pair.values[k]
    return total


def scale_twice(address, pair, first):
    """Call what stands at an address, with an integer that is a constant and with one that is not."""
    return call_at(address, (pair, 1)) + call_at(address, (pair, first))


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use a separate kernel cache for this test."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))


def piece(pair: Pair) -> pieces.Piece:
    """The function that scales, apart, which no process has compiled."""
    return bind(scale, apart=True), (numba.typeof(pair), numba.int64)


@pytest.mark.parametrize("cores", [1, 2])
def test_a_function_is_called_by_its_address(cores: int, stored: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Child processes compile the functions, and this process loads their machine code."""
    monkeypatch.setattr(pieces, "cores", lambda: cores)
    pair = Pair(np.array([1.0, 2.0, 3.0]), 2.0)
    apart = piece(pair)
    caller = bind(scale_twice)
    compile_pieces([(caller, (numba.int64, numba.typeof(pair), numba.int64)), apart])
    assert sum(apart[0].stats.cache_hits.values()) == sum(caller.stats.cache_hits.values()) == 1
    assert caller(address_of(apart), pair, 0) == (4.0 + 6.0) + (2.0 + 8.0 + 12.0)
    np.testing.assert_array_equal(pair.values, [2.0, 8.0, 12.0])


@pytest.mark.usefixtures("stored")
def test_a_signal_ends_the_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    """A signal that is noted while child processes compile ends them, and the work at once."""
    here = os.getpid()
    monkeypatch.setattr(pieces, "cores", lambda: 2)
    monkeypatch.setattr(
        numba.core.dispatcher.Dispatcher, "compile", lambda *args: time.sleep(60.0 if os.getpid() != here else 0.0)
    )
    forked, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    pair = Pair(np.array([1.0]), 2.0)
    with stopping.watching(), announcing("tests", lambda: os.kill(here, signal.SIGTERM)), pytest.raises(stopping.Stopped):
        compile_pieces([piece(pair)])
    assert forked
    for child in forked:
        with pytest.raises(ChildProcessError):
            os.waitpid(child, os.WNOHANG)


@pytest.mark.usefixtures("stored")
@pytest.mark.parametrize("end", ["dies", "hangs"])
def test_a_process_that_ends_early_is_replaced(
    end: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The parent compiles what a child process has not stored, and kills a child that hangs. The child prints nothing."""
    monkeypatch.setattr(pieces, "cores", lambda: 2)
    monkeypatch.setattr(pieces, "LONGEST_WAIT_S", 0.1)
    here = os.getpid()
    compile_one = numba.core.dispatcher.Dispatcher.compile

    def fails_elsewhere(dispatcher: Any, signature: Any) -> Any:
        while os.getpid() != here:
            os.write(2, b"written elsewhere")
            if end == "dies":
                os._exit(1)
        return compile_one(dispatcher, signature)

    monkeypatch.setattr(numba.core.dispatcher.Dispatcher, "compile", fails_elsewhere)
    pair = Pair(np.array([1.0]), 2.0)
    apart, caller = piece(pair), bind(scale_twice)
    compile_pieces([(caller, (numba.int64, numba.typeof(pair), numba.int64)), apart])
    assert capfd.readouterr() == ("", "")
    assert sum(apart[0].stats.cache_hits.values()) == 0
    assert caller(address_of(apart), pair, 0) == 2.0
