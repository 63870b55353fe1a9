"""Pools of worker processes: how they start, what they report, and how they end."""

from __future__ import annotations

import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection

from explicitfe.platform.host import compilation, stopping


class WorkerPool(ProcessPoolExecutor):
    """Spawned processes that leave signals to this process, and report to it what they compile.

    Parameters
    ----------
    workers : number of processes.
    """

    def __init__(self, workers: int) -> None:
        context = get_context("spawn")
        reader, self._reports = context.Pipe(duplex=False)
        super().__init__(workers, mp_context=context, initializer=_begin_worker, initargs=(self._reports,))
        threading.Thread(target=_forward, args=(reader,), daemon=True).start()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See ``concurrent.futures.Executor.shutdown``."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._reports.close()

    def end(self) -> None:
        """Terminate the processes, with the tasks that they compute, and wait until the pool is closed.

        Python wakes the thread of each open pool at exit. If that thread closes its pipe at the same moment, Python prints
        "OSError: Bad file descriptor", so the thread must end before.
        """
        results = self._result_queue
        for process in list((self._processes or {}).values()):
            process.terminate()
        if results is not None:  # else the thread would wait for the rest of a result whose sender is terminated
            results._writer.close()  # type: ignore[attr-defined]
        self.shutdown(cancel_futures=True)


def _begin_worker(reports: Connection) -> None:
    stopping.leave_signals_to_the_parent()

    def report(what: str) -> None:
        with suppress(OSError):  # the pool is being closed
            reports.send(what)

    compilation.set_listener(report)


def _forward(reader: Connection) -> None:
    """Announce in this process what workers report, until all of them have ended."""
    with reader, suppress(EOFError, OSError):
        while True:
            compilation.announce(reader.recv())
