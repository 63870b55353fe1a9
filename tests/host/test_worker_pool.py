"""Pools of worker processes: no thread outlives one, a torn result does not block its end, compilations are reported."""

from __future__ import annotations

import subprocess
import sys
import threading
from operator import add

import pytest

from explicitfe.platform.host import compilation
from explicitfe.platform.host.worker_pool import WorkerPool
from explicitfe.simulate.sweep.engine import Processes

TORN = """
import threading
from explicitfe.platform.host.worker_pool import WorkerPool
if __name__ == "__main__":
    pool = WorkerPool(1)
    future = pool.submit(bytes, 400_000_000)
    assert pool._result_queue._reader.poll(60)  # its worker sends now, which takes a good part of a second
    pool.end()
    assert future.exception() is not None
    print("ended")
"""


def test_no_thread_of_a_finished_sweep_is_alive():
    """At exit Python writes into the pipe of each pool whose thread is alive; the pipe may be closed by then."""
    before = set(threading.enumerate())
    engine = Processes(2)
    assert engine._pool.submit(add, 1, 2).result() == 3
    started = [thread for thread in set(threading.enumerate()) - before if "_forward" not in thread.name]
    assert started
    engine.close()
    assert not any(thread.is_alive() for thread in started)


def test_a_worker_that_is_terminated_while_it_sends_a_result(tmp_path):
    (tmp_path / "script.py").write_text(TORN)
    done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False)
    assert done.stdout == "ended\n", done.stderr


def compile_a_kernel(number: int) -> int:
    """A kernel that no cache holds."""
    import numba

    with compilation.announcing("kernels of a test"):
        return int(numba.njit(lambda x: 3 * x)(number))


def test_compilations_of_workers_are_reported_here():
    reports: list[str] = []
    told = threading.Event()

    def report(what: str) -> None:
        reports.append(what)
        told.set()

    with compilation.listening(report), WorkerPool(1) as pool:
        assert pool.submit(compile_a_kernel, 2).result() == 6
        assert told.wait(60)
    assert reports == ["kernels of a test"]


def test_a_block_that_compiles_nothing_reports_nothing():
    with compilation.listening(lambda what: pytest.fail(what)), compilation.announcing("nothing"):
        pass
