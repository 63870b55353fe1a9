"""Simulations in worker processes, which a budget counts and ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.platform.host import stopping
from explicitfe.platform.host.worker_pool import WorkerPool

Job = TypeVar("Job")
Run = TypeVar("Run")


class Workers:
    """At most so many processes, which begin with the second simulation: the first one compiles the kernels, in this process.

    Parameters
    ----------
    budget : its limit on the time ends them too.
    """

    def __init__(self, processes: int, budget: Budget | None = None) -> None:
        self.processes, self.budget = processes, budget or Budget()
        self._pool: WorkerPool | None = None

    def close(self) -> None:
        """End the processes, with what they compute."""
        if self._pool is not None:
            self._pool.end()
            self._pool = None

    def each(self, compute: Callable[[Job], Run], jobs: Sequence[Job], *, together: bool = True) -> Iterator[Run]:
        """Results of jobs in their order; ``together`` computes them in worker processes, which is worth their time on a mesh."""
        done = 0
        if jobs and (self._pool is None or len(jobs) == 1):
            yield compute(jobs[0])
            done = 1
        if self.processes > 1 and together and len(jobs) - done > 1:
            try:
                self._pool = self._pool or WorkerPool(self.processes)
                for run in self._pool.map(compute, jobs[done:], timeout=self.budget.remaining_s()):
                    yield run
                    done += 1
            except (BrokenProcessPool, TimeoutError) as error:  # a script that is read from standard input can start no process
                if isinstance(error, TimeoutError):
                    self.close()
                stopping.check()
                self._pool, self.processes = None, 1
        for job in jobs[done:]:
            stopping.check()
            yield compute(job)
