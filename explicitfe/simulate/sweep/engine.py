"""Engines that compute runs: local processes, a Dask cluster, or an executor of the user.

Runs are sent in bundles of about a second and return as rows. No run is lost if a worker process ends: its bundle is sent again,
one run at a time. Only a run whose process has ended twice while it computed this run alone gets the status "lost".
"""

from __future__ import annotations

import itertools
import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import current_process

from explicitfe.platform.errors import InputError, MachineError, shortened
from explicitfe.platform.host import stopping
from explicitfe.platform.host.extras import require
from explicitfe.platform.host.worker_pool import WorkerPool
from explicitfe.simulate.sweep.rows import Member, Task, WrittenRow, lost, written, written_rows_of

BUNDLE_S = 1.0  # of one worker's time; what sends and stores a bundle takes milliseconds
MOST_MEMBERS_OF_A_BUNDLE = 1000
BUNDLES_PER_WORKER = 2  # in flight: one is computed, one waits there
LAST_BUNDLES_PER_WORKER = 2  # the remaining runs are divided into so many, so that no worker waits long for another at the end
POLL_FUTURES_S = 0.2  # between two checks of the signals
DEATHS_ALONE = 2  # of a process, with this run as the only one in flight: then it is the run
DEATHS_BEFORE_A_ROW = 3  # of processes that have never given a row: then none can live here
MOST_LOST_IN_A_ROW = 50  # runs, one after another: then it is the machine, and no run
CONNECT_WITHIN_S = 15.0
CLOSE_WITHIN_S = 5.0
BETWEEN_COUNTS_S = 5.0  # the number of workers of a cluster changes
COUNT_WITHIN_S = 2.0  # without a scheduler the call would block until the client has given up to reconnect
LARGEST_SHARE_OF_THE_NEWEST = 0.3  # in the mean time of a run
GUARD = 'worker processes import the script again, so put the call under  if __name__ == "__main__":'


class Engine:
    """Workers that compute bundles: those of an executor, which is not shut down here and manages its workers itself.

    Parameters
    ----------
    executor : of any kind.
    workers : number of its workers; if left out, the executor's own number or else 1.

    Attributes
    ----------
    breaks_as_a_whole : whether the death of one process takes all that is in flight with it.
    """

    breaks_as_a_whole = False

    def __init__(self, executor: Executor, workers: int | None = None) -> None:
        self._executor = executor
        self._workers = workers or int(getattr(executor, "_max_workers", 0)) or 1

    @property
    def workers(self) -> int:
        """Number of workers that compute at the same time."""
        return self._workers

    def submit(self, task: Task, members: Sequence[Member]) -> Future[list[WrittenRow]]:
        """Send a bundle."""
        return self._executor.submit(written_rows_of, task, members)

    def is_death(self, error: BaseException) -> bool:
        """Whether an exception of a future means that the process which computed it ended."""
        return False

    def explained(self, error: BaseException) -> BaseException:
        """The exception to raise for one of a future that no run has caused."""
        if isinstance(error, CancelledError):
            return MachineError(
                "the executor cancelled runs before computing them. All finished runs are stored: check the executor, and rerun "
                "to resume."
            )
        return error

    def renew(self) -> None:
        """Replace the workers after one has ended."""

    def close(self) -> None:
        """Release the workers."""

    def wait(self, futures: Iterable[Future[list[WrittenRow]]]) -> set[Future[list[WrittenRow]]]:
        """The futures that are done, after a short time; other objects, such as jobs of a batch system, are polled one by one."""
        if all(isinstance(future, Future) for future in futures):
            return wait(futures, POLL_FUTURES_S, FIRST_COMPLETED).done
        time.sleep(POLL_FUTURES_S)
        return {future for future in futures if future.done()}


class Processes(Engine):
    """Local worker processes.

    Raises
    ------
    InputError : this process is a worker: the script that started it has no guard.
    """

    breaks_as_a_whole = True

    def __init__(self, workers: int) -> None:
        if getattr(current_process(), "_inheriting", False):  # multiprocessing sets it while a process imports its script again
            raise InputError(f"a worker process tried to start the sweep itself: {GUARD}.")
        self._pool = WorkerPool(workers)
        super().__init__(self._pool, workers)

    def is_death(self, error: BaseException) -> bool:
        """A pool breaks as a whole: all that was in flight is lost with one process."""
        return isinstance(error, BrokenProcessPool)

    def renew(self) -> None:
        """Start a new pool."""
        self.close()
        self._executor = self._pool = WorkerPool(self._workers)

    def close(self) -> None:
        """Terminate the processes; runs that are not finished are computed when the sweep is resumed."""
        self._pool.end()


class Cluster(Engine):
    """A Dask cluster, by the address of its scheduler; its nannies restart its workers.

    Raises
    ------
    InputError : no scheduler answers, it has no workers, or distributed is not installed.
    """

    def __init__(self, address: str) -> None:
        require("cluster", "a sweep on a cluster")
        from distributed import Client

        self._address = address
        try:
            self._client = Client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
        except (OSError, ValueError, TypeError, TimeoutError) as error:
            raise InputError(
                f"`scheduler` {shortened(address)}: no scheduler answers ({type(error).__name__}). Give the address that "
                "dask scheduler prints, such as tcp://127.0.0.1:8786."
            ) from None
        self._counted, self._counted_at = 0, 0.0
        until = time.monotonic() + CONNECT_WITHIN_S
        while not self.workers:  # workers that were started together with the scheduler register later
            stopping.check()
            if time.monotonic() > until:
                self._client.close()
                raise InputError(
                    f"`scheduler` {shortened(address)}: the scheduler has no workers. Start some with: dask worker {address}"
                )
            time.sleep(POLL_FUTURES_S)
        self._executor = self._client.get_executor(pure=False)

    @property
    def workers(self) -> int:
        """Number of threads of its workers at present."""
        if not self._counted or time.monotonic() > self._counted_at + BETWEEN_COUNTS_S:
            with suppress(OSError, RuntimeError):  # the futures report a failure of the scheduler
                self._counted = sum(self._client.nthreads(callback_timeout=COUNT_WITHIN_S).values())
            self._counted_at = time.monotonic()
        return self._counted

    def wait(self, futures: Iterable[Future[list[WrittenRow]]]) -> set[Future[list[WrittenRow]]]:
        """The futures that are done; MachineError if the connection is lost, as the client has cancelled all futures then."""
        done = super().wait(futures)
        if not done and self._client.status != "running":
            raise self.explained(CancelledError())
        return done

    def is_death(self, error: BaseException) -> bool:
        """The scheduler itself sends a bundle to another worker, and gives up after several deaths."""
        from distributed import KilledWorker

        return isinstance(error, KilledWorker)

    def explained(self, error: BaseException) -> BaseException:
        """A lost scheduler cancels its futures."""
        from distributed.comm import CommClosedError

        if isinstance(error, (CancelledError, CommClosedError)):
            return MachineError(
                f"the connection to the scheduler at {self._address} is lost. All finished runs are stored: rerun the command "
                "with the address of a new scheduler to resume."
            )
        return super().explained(error)

    def close(self) -> None:
        """Disconnect; the cluster keeps running."""
        self._executor.shutdown(wait=False)
        self._client.close(timeout=CLOSE_WITHIN_S)


class Bundles:
    """Runs that are being computed: an iterator over their rows.

    Parameters
    ----------
    task, members : the ``count`` runs to compute; ``members`` is consumed as they are sent.
    engine : computes them; it is not closed here.
    """

    def __init__(self, task: Task, members: Iterable[Member], count: int, engine: Engine) -> None:
        self._task, self._engine = task, engine
        self._todo, self._left = iter(members), count
        self._suspects: deque[Member] = deque()  # they may have been computed when a process died
        self._in_flight: dict[Future[list[WrittenRow]], Sequence[Member]] = {}
        self._deaths_alone: Counter[int] = Counter()
        self._deaths_before_a_row = self._lost_in_a_row = 0
        self._member_s = 0.0  # mean time of a run; 0 until one is known

    def __iter__(self) -> Iterator[list[WrittenRow]]:
        """Lists of rows: those of all bundles that have finished since the last list.

        Raises
        ------
        Stopped : a signal has requested to stop.
        MachineError : a worker cannot write a result file, or worker processes cannot run on this machine.
        """
        while self._left or self._suspects or self._in_flight:
            stopping.check()
            is_broken = not self._send()
            deaths: list[Sequence[Member]] = []
            done = self._engine.wait(self._in_flight)
            stopping.check()
            lines: list[WrittenRow] = []
            wrong: BaseException | None = None
            for future in done:
                members = self._in_flight.pop(future)
                # jobs of batch systems are no futures, and are never cancelled here
                error = CancelledError() if isinstance(future, Future) and future.cancelled() else future.exception()
                if error is None:
                    lines += future.result()
                elif self._engine.is_death(error):
                    deaths.append(members)
                else:
                    wrong = error
            if lines:
                self._note(lines)
                yield lines
            if wrong is not None:
                raise self._engine.explained(wrong)
            if deaths or is_broken:
                yield from self._after_deaths(deaths)

    def _send(self) -> bool:
        """Keep enough bundles in flight; False if the workers have ended.

        The first run is sent alone: it compiles the kernels for the others. So is a run that may have ended a process.
        """
        alone = self._member_s == 0.0 or (bool(self._suspects) and self._engine.breaks_as_a_whole)
        while len(self._in_flight) < (1 if alone else BUNDLES_PER_WORKER * self._engine.workers):
            members = self._next()
            if not members:
                break
            try:
                self._in_flight[self._engine.submit(self._task, members)] = members
            except Exception as error:
                if not self._engine.is_death(error):
                    raise self._engine.explained(error) from None
                self._todo, self._left = itertools.chain(members, self._todo), self._left + len(members)
                return False
        return True

    def _next(self) -> Sequence[Member]:
        """The next bundle. Until a run has returned a row, other runs are sent before one is repeated."""
        if self._suspects and (self._member_s or not self._left):
            return [self._suspects.popleft()]
        members = list(itertools.islice(self._todo, min(self._size(), self._left)))
        self._left -= len(members)
        return members

    def _size(self) -> int:
        if self._member_s == 0.0:
            return 1
        share = -(-self._left // (LAST_BUNDLES_PER_WORKER * self._engine.workers))
        return max(1, min(round(BUNDLE_S / self._member_s), MOST_MEMBERS_OF_A_BUNDLE, share))

    def _note(self, lines: Sequence[WrittenRow]) -> None:
        """Update the mean time of a run; the first run, which includes compilation, soon loses its weight."""
        self._lost_in_a_row = 0
        taken = sum(line.seconds for line in lines) / len(lines)
        weight = LARGEST_SHARE_OF_THE_NEWEST if 0.0 < self._member_s < 2.0 * taken else 1.0
        self._member_s = max(weight * taken + (1.0 - weight) * self._member_s, 1e-6)

    def _after_deaths(self, deaths: Sequence[Sequence[Member]]) -> Iterator[list[WrittenRow]]:
        """Send the runs of ended processes again, one at a time; give up a run that always ends its process."""
        unfinished, guilty = list(deaths), len(deaths) > 0
        if self._engine.breaks_as_a_whole:  # all futures come back so, some of them a moment later
            unfinished += self._in_flight.values()
            self._in_flight.clear()
            guilty = len(unfinished) == 1
        self._engine.renew()
        if self._member_s == 0.0:
            self._deaths_before_a_row += 1
            if self._deaths_before_a_row >= DEATHS_BEFORE_A_ROW:
                raise MachineError(
                    f"the worker processes ended {DEATHS_BEFORE_A_ROW} times before the first row. Check the free memory and "
                    f"reduce `processes`; in Python, {GUARD}."
                )
            guilty = False
        for members in unfinished:
            if guilty and len(members) == 1:
                yield from self._after_death_of(members[0])
            else:
                self._suspects.extend(members)

    def _after_death_of(self, member: Member) -> Iterator[list[WrittenRow]]:
        """A process ended that computed this run alone: repeat the run at once, or give it up."""
        self._deaths_alone[member.number] += 1
        if self._deaths_alone[member.number] < DEATHS_ALONE:
            self._suspects.appendleft(member)
            return
        self._lost_in_a_row += 1
        yield [written(lost(member, f"its process ended each of {DEATHS_ALONE} times, often because memory ran out"))]
        if self._lost_in_a_row >= MOST_LOST_IN_A_ROW:
            raise MachineError(
                f"the processes of {MOST_LOST_IN_A_ROW} successive runs ended, often because memory runs out. These runs have "
                "the status lost: reduce `processes`, and add `retry` failed to recompute them."
            )
