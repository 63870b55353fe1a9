"""Who computes members: processes of this machine, a Dask cluster, or an executor of the user's.

Members go out in bundles of about a second, and come back as rows. A process that dies takes no member with it: what it may have
had goes out again, one member at a time, and only one that was alone each time that its process ended is given up.
"""

from __future__ import annotations

import itertools
import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import current_process

from explicitfe.errors import InputError, MachineError, shortened
from explicitfe.host import stopping
from explicitfe.host.extras import require
from explicitfe.host.worker_pool import WorkerPool
from explicitfe.sweep.rows import Member, Task, WrittenRow, lost, written, written_rows_of

BUNDLE_S = 1.0  # of one worker's time; what sends and stores a bundle takes milliseconds
MOST_MEMBERS_OF_A_BUNDLE = 1000
BUNDLES_PER_WORKER = 2  # in flight: one is computed, one waits there
LAST_BUNDLES_PER_WORKER = 2  # into so many what is left is shared, so that no worker waits long for another at the end
POLL_FUTURES_S = 0.2  # between two looks at the signals
DEATHS_ALONE = 2  # of a process, with this member as the only one in flight: then it is the member
DEATHS_BEFORE_A_ROW = 3  # of processes that have never given a row: then none can live here
MOST_LOST_IN_A_ROW = 50  # members, one after another: then it is the machine, and no member
CONNECT_WITHIN_S = 15.0
BETWEEN_COUNTS_S = 5.0  # of the workers of a cluster: they come and go
LARGEST_SHARE_OF_THE_NEWEST = 0.3  # in the mean time of a member
GUARD = 'processes read a script again, so put the call under  if __name__ == "__main__":'


class Engine(ABC):
    """Workers that compute bundles.

    Attributes
    ----------
    breaks_as_a_whole : whether the death of one process takes all that is in flight with it.
    """

    breaks_as_a_whole = False

    @property
    @abstractmethod
    def workers(self) -> int:
        """How many compute at a time."""

    @abstractmethod
    def submit(self, task: Task, members: Sequence[Member]) -> Future[list[WrittenRow]]:
        """Send a bundle."""

    @abstractmethod
    def is_death(self, error: BaseException) -> bool:
        """Whether an exception of a future means that the process which computed it ended."""

    def explained(self, error: BaseException) -> BaseException:
        """What to raise for an exception of a future that no member is to blame for."""
        if isinstance(error, CancelledError):
            return MachineError("the executor gave bundles back without computing them; what was computed before is stored.")
        return error

    @abstractmethod
    def renew(self) -> None:
        """Have workers again after one has died."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the workers."""

    def wait(self, futures: Iterable[Future[list[WrittenRow]]]) -> set[Future[list[WrittenRow]]]:
        """Those that are done, after a short while at most."""
        return wait(futures, POLL_FUTURES_S, FIRST_COMPLETED).done


class Processes(Engine):
    """Processes of this machine.

    Raises
    ------
    InputError : this is one of them: a script that starts them has no guard.
    """

    breaks_as_a_whole = True

    def __init__(self, workers: int) -> None:
        if getattr(current_process(), "_inheriting", False):  # multiprocessing says so while a process reads its script again
            raise InputError(f"a process that computes members came to the sweep itself: {GUARD}.")
        self._workers = workers
        self._pool = WorkerPool(workers)

    @property
    def workers(self) -> int:
        """The number that was given."""
        return self._workers

    def submit(self, task: Task, members: Sequence[Member]) -> Future[list[WrittenRow]]:
        """Send a bundle."""
        return self._pool.submit(written_rows_of, task, members)

    def is_death(self, error: BaseException) -> bool:
        """A pool breaks as a whole: all that was in flight is lost with one process."""
        return isinstance(error, BrokenProcessPool)

    def renew(self) -> None:
        """Start a new pool."""
        self.close()
        self._pool = WorkerPool(self._workers)

    def close(self) -> None:
        """Terminate the processes; runs that are not finished are computed when the sweep is resumed."""
        self._pool.end()


class Given(Engine):
    """An executor of the user's, of any kind; it stays the user's, and is not shut down.

    Parameters
    ----------
    workers : how many it has; asked of it, if left out, and else 1.
    """

    def __init__(self, executor: Executor, workers: int | None = None) -> None:
        self._executor = executor
        self._workers = workers or int(getattr(executor, "_max_workers", 0)) or 1

    @property
    def workers(self) -> int:
        """As many as were said, or as it has."""
        return self._workers

    def submit(self, task: Task, members: Sequence[Member]) -> Future[list[WrittenRow]]:
        """Send a bundle."""
        return self._executor.submit(written_rows_of, task, members)

    def is_death(self, error: BaseException) -> bool:
        """Nobody here can start its workers again."""
        return False

    def renew(self) -> None:
        """Nothing is to be renewed."""

    def close(self) -> None:
        """It stays the user's."""

    def wait(self, futures: Iterable[Future[list[WrittenRow]]]) -> set[Future[list[WrittenRow]]]:
        """Those that are done; futures of another make, such as jobs of a batch system, are asked one by one."""
        if all(isinstance(future, Future) for future in futures):
            return super().wait(futures)
        time.sleep(POLL_FUTURES_S)
        return {future for future in futures if future.done()}


class Cluster(Engine):
    """A Dask cluster, by the address of its scheduler.

    Raises
    ------
    InputError : nobody answers there, or no worker is there; or distributed is not installed.
    """

    def __init__(self, address: str) -> None:
        require("cluster", "a sweep on a cluster")
        from distributed import Client

        self._address = address
        try:
            self._client = Client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
        except (OSError, ValueError, TypeError, TimeoutError) as error:
            raise InputError(
                f"--scheduler {shortened(address)}: nobody answers there ({type(error).__name__}); give the address that "
                "dask scheduler prints, such as tcp://127.0.0.1:8786."
            ) from None
        self._counted, self._counted_at = 0, 0.0
        until = time.monotonic() + CONNECT_WITHIN_S
        while not self.workers:  # those that were started together with the scheduler come a moment later
            stopping.check()
            if time.monotonic() > until:
                self._client.close()
                raise InputError(f"--scheduler {shortened(address)}: no worker is there; start some with: dask worker {address}")
            time.sleep(POLL_FUTURES_S)
        self._executor = self._client.get_executor(pure=False)

    @property
    def workers(self) -> int:
        """As many threads as its workers have by now."""
        if not self._counted or time.monotonic() > self._counted_at + BETWEEN_COUNTS_S:
            with suppress(OSError, RuntimeError):  # bundles tell what is wrong with a scheduler
                self._counted = sum(self._client.nthreads().values())
            self._counted_at = time.monotonic()
        return self._counted

    def submit(self, task: Task, members: Sequence[Member]) -> Future[list[WrittenRow]]:
        """Send a bundle."""
        return self._executor.submit(written_rows_of, task, members)

    def is_death(self, error: BaseException) -> bool:
        """The scheduler sends a bundle to another worker by itself, and gives it up after some deaths."""
        from distributed import KilledWorker

        return isinstance(error, KilledWorker)

    def explained(self, error: BaseException) -> BaseException:
        """A scheduler that is gone cancels what it had."""
        from distributed.comm import CommClosedError

        if isinstance(error, (CancelledError, CommClosedError)):
            return MachineError(
                f"the scheduler at {self._address} is gone; all rows that came back are stored: give the same command to go on, "
                "with the address of a new one."
            )
        return super().explained(error)

    def renew(self) -> None:
        """The cluster's own nannies start workers again."""

    def close(self) -> None:
        """Leave the cluster as it is."""
        self._executor.shutdown(wait=False)
        self._client.close(timeout=CONNECT_WITHIN_S)


class Bundles:
    """Members on their way: gives rows as they come back.

    Parameters
    ----------
    task, members : what is to be computed, ``count`` members; they are asked for as they are sent.
    engine : who does it; it is not closed here.
    """

    def __init__(self, task: Task, members: Iterable[Member], count: int, engine: Engine) -> None:
        self._task, self._engine = task, engine
        self._todo, self._left = iter(members), count
        self._suspects: deque[Member] = deque()  # they may have been computed when a process died
        self._in_flight: dict[Future[list[WrittenRow]], Sequence[Member]] = {}
        self._deaths_alone: Counter[int] = Counter()
        self._deaths_before_a_row = self._lost_in_a_row = 0
        self._member_s = 0.0  # mean time of a member; 0 until one is known

    def __iter__(self) -> Iterator[list[WrittenRow]]:
        """Rows as soon as they are there: those of all bundles that are done by then, to be stored at once.

        Raises
        ------
        Stopped : a signal has asked to stop.
        MachineError : a worker cannot write what is to be kept, or no process can live here.
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
        """Have enough in flight; False where the workers turned out to be dead.

        The first member goes alone, and makes the machine code for the others; so do suspects, where a death takes all with it.
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
        """The next bundle. Until some member has given a row none is tried again before others were."""
        if self._suspects and (self._member_s or not self._left):
            return [self._suspects.popleft()]
        members = list(itertools.islice(self._todo, min(self._size(), self._left)))
        self._left -= len(members)
        return members

    def _size(self) -> int:
        """Of the next bundle."""
        if self._member_s == 0.0:
            return 1
        share = -(-self._left // (LAST_BUNDLES_PER_WORKER * self._engine.workers))
        return max(1, min(round(BUNDLE_S / self._member_s), MOST_MEMBERS_OF_A_BUNDLE, share))

    def _note(self, lines: Sequence[WrittenRow]) -> None:
        """Learn how long members take; the first one compiles and is forgotten soon."""
        self._lost_in_a_row = 0
        taken = sum(line.seconds for line in lines) / len(lines)
        weight = LARGEST_SHARE_OF_THE_NEWEST if 0.0 < self._member_s < 2.0 * taken else 1.0
        self._member_s = max(weight * taken + (1.0 - weight) * self._member_s, 1e-6)

    def _after_deaths(self, deaths: Sequence[Sequence[Member]]) -> Iterator[list[WrittenRow]]:
        """Send again what dead processes may have had, one member at a time; give up a member that always kills its process."""
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
                    f"the processes that compute members ended {DEATHS_BEFORE_A_ROW} times before the first row: often memory "
                    f"has run out; in Python, {GUARD}."
                )
            guilty = False
        for members in unfinished:
            if guilty and len(members) == 1:
                yield from self._after_death_of(members[0])
            else:
                self._suspects.extend(members)

    def _after_death_of(self, member: Member) -> Iterator[list[WrittenRow]]:
        """A process ended that had this member only: it is tried again at once, or given up."""
        self._deaths_alone[member.number] += 1
        if self._deaths_alone[member.number] < DEATHS_ALONE:
            self._suspects.appendleft(member)
            return
        self._lost_in_a_row += 1
        yield [written(lost(member, f"its process ended each of {DEATHS_ALONE} times: often memory has run out"))]
        if self._lost_in_a_row >= MOST_LOST_IN_A_ROW:
            raise MachineError(
                f"the processes of {MOST_LOST_IN_A_ROW} members one after another ended: it is this machine that cannot compute "
                "them, often for want of memory; their rows say lost, and --retry failed computes them again."
            )
