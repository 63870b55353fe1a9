"""A sweep from its scenario to its table: planned, computed, stored row by row, and resumed after an interruption."""

from __future__ import annotations

import json
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import closing
from pathlib import Path
from typing import cast

from explicitfe.platform.errors import InputError, MachineError, Progress, Share, shortened, silent
from explicitfe.platform.host import stopping
from explicitfe.platform.host.files import reason
from explicitfe.results.documents.sweep_summary import ListedMember, SweepMembers, SweepSummary
from explicitfe.results.files import FINISHED
from explicitfe.results.files.folder import remove_unfinished, whole_file
from explicitfe.simulate.sweep.definition import RESULTS_FOLDER, ROWS_FOLDER, Definition, begin
from explicitfe.simulate.sweep.engine import Bundles, Cluster, Engine, Processes
from explicitfe.simulate.sweep.journal import Journal, Stored
from explicitfe.simulate.sweep.members import share_of
from explicitfe.simulate.sweep.rows import (
    MESSAGE,
    NUMBER,
    WITHOUT_RESULT,
    Cell,
    Member,
    Row,
    Task,
    WrittenRow,
    counted_causes,
    is_kept,
    result_name,
)
from explicitfe.simulate.sweep.sensitivity import sensitivity_of
from explicitfe.simulate.sweep.table import write_table

SENSITIVITY_FILE = "sensitivity.json"
KEEP_WORDS = ("none", "all", "failed")
BETWEEN_PARTIAL_TABLES_S = 60.0
SECONDS_PER_MINUTE = 60.0
LARGEST_SHARE_OF_PARTIAL_TABLES = 0.02  # of the time of a sweep


class Sweep:
    """The runs of one scenario. Iteration yields the stored rows, then those of the missing runs as they finish.

    Attributes
    ----------
    definition, out : the runs, and the folder.
    statuses : number of each run that has a row -> its status.

    Parameters
    ----------
    keep : result files to keep: "none", "all", "failed", or "every:N". A run that has a row but lacks such a file is computed
        again.
    retry : whether runs that did not finish are computed again.
    only : K/N, a share of the runs; all if left out.
    engine : creates the engine for a number of runs.

    Raises
    ------
    InputError : the folder contains other files, or an option is invalid.
    """

    def __init__(
        self, definition: Definition, out: Path, engine: Callable[[int], Engine], *, keep: str, retry: bool, only: str | None
    ) -> None:
        if keep not in KEEP_WORDS and not re.fullmatch(r"every:[1-9]\d{0,8}", keep):
            raise InputError(f"`keep` {shortened(keep)}: valid values are none, all, failed and every:N, such as every:100.")
        self.definition, self.out, self.only = definition, out, only
        self._numbers = range(len(definition.members)) if only is None else share_of(definition.members, only)
        begin(out, definition)
        for folder in (out, out / RESULTS_FOLDER):
            remove_unfinished(folder)
        stored = Stored(out / ROWS_FOLDER, len(definition.members))
        self.statuses = {number: place.status for number, place in stored.places.items()}
        folder = (out / RESULTS_FOLDER).absolute()

        def is_missing(number: int) -> bool:
            """Whether a run has no row, an unfinished one with ``retry``, or lacks a result file that ``keep`` requests."""
            status = self.statuses.get(number)
            if status is None or (retry and status != FINISHED):
                return True
            return status not in WITHOUT_RESULT and is_kept(keep, number, status) and not (folder / result_name(number)).exists()

        self._todo = [number for number in self._numbers if is_missing(number)]
        self._task = Task(definition.path.absolute(), definition.text, definition.parts, folder, keep, definition.own)
        self._engine = engine
        self._given: set[int] = set()
        self._computed, self._worker_s, self._workers, self._wall_s, self._rate = 0, 0.0, 0, 0.0, 0.0

    def __iter__(self) -> Iterator[Row]:
        """The rows of all runs, with the values that vary; the table is written at the end."""
        stored = Stored(self.out / ROWS_FOLDER, len(self.definition.members))
        missing = set(self._todo) - self._given
        old = [number for number in self._numbers if number in stored.places and number not in missing]
        for number, row in zip(old, stored.rows(old), strict=True):
            yield self._with_varied(number, row)
        for line in self.computed():
            yield self._with_varied(line.number, line.row)
        self.finish()

    def _with_varied(self, number: int, row: Row) -> Row:
        members = self.definition.members
        varied = dict(zip(members.keys, cast(tuple[Cell, ...], members.values[number]), strict=True))
        return {NUMBER: number} | varied | row

    def __len__(self) -> int:
        """Number of rows that iteration yields."""
        return len(self._numbers)

    def members(self) -> Iterator[Member]:
        """The runs to compute."""
        return (Member(number, self.definition.name_of(number), self.definition.settings_of(number)) for number in self._todo)

    def listed(self) -> SweepMembers:
        """The runs to compute, as ``explicitfe sweep --list`` shows them."""
        entries: list[ListedMember] = [
            {"member": member.number, "name": member.name, "settings": list(member.settings)} for member in self.members()
        ]
        return {"sweep": str(self.out), "members": entries}

    def computed(self, progress: Progress = silent) -> Iterator[WrittenRow]:
        """Rows as runs finish; each is stored before it is yielded.

        Raises
        ------
        MachineError : the disk is full, or worker processes cannot run on this machine.
        InputError : another command is computing these runs, or there are no workers.
        Stopped : a signal has requested to stop; finished runs are stored.
        """
        self._todo = [number for number in self._todo if number not in self._given]
        if self._todo:
            with stopping.watching(), closing(self._engine(len(self._todo))) as engine:
                yield from self._computed_by(engine, progress)

    def _computed_by(self, engine: Engine, progress: Progress) -> Iterator[WrittenRow]:
        name = "all" if self.only is None else self.only.replace("/", "-of-")
        total, stored = len(self._todo), 0
        begun_at = time.perf_counter()
        table_at, table_s = begun_at, 0.0
        failed = 0
        self._workers = engine.workers
        with Journal(self.out / ROWS_FOLDER / f"{name}.jsonl") as journal:
            progress("sweep", Share(0.0, f"0 of {total}; the first run loads or compiles the kernels"))
            for lines in Bundles(self._task, self.members(), total, engine):
                journal.append(lines)
                for line in lines:
                    self.statuses[line.number] = line.status
                    self._given.add(line.number)
                    failed += line.status != FINISHED
                    self._worker_s += line.seconds
                stored += len(lines)
                self._computed, self._wall_s = stored, time.perf_counter() - begun_at
                self._rate = SECONDS_PER_MINUTE * stored / self._wall_s
                yield from lines
                progress("sweep", Share(stored / total, f"{stored} of {total}, {self._rate:.0f} per minute, {failed} failed"))
                since_s = time.perf_counter() - table_at
                if since_s > max(BETWEEN_PARTIAL_TABLES_S, table_s / LARGEST_SHARE_OF_PARTIAL_TABLES) and stored < total:
                    table_at = time.perf_counter()
                    write_table(self.out, self.out / ROWS_FOLDER, self.definition.members)
                    table_s = time.perf_counter() - table_at

    def finish(self) -> SweepSummary:
        """Write the table and the sensitivity indices; give the summary of the sweep.

        Raises
        ------
        MachineError : a file cannot be written.
        """
        # including the rows of other commands
        stored, files = write_table(self.out, self.out / ROWS_FOLDER, self.definition.members)
        complete = len(stored) == len(self.definition.members)
        self.statuses = {number: place.status for number, place in stored.places.items()}
        failed = (number for number, status in sorted(self.statuses.items()) if status != FINISHED)
        if complete and self.definition.design in ("sobol", "morris"):
            indices = sensitivity_of(
                self.definition.design, self.definition.factors, self.definition.members, stored, self.definition.seed
            )
            try:
                whole_file(self.out / SENSITIVITY_FILE, json.dumps(indices, indent=1) + "\n")
            except OSError as error:
                raise MachineError(
                    f"{self.out / SENSITIVITY_FILE}: cannot be written ({reason(error)}). Free disk space, and rerun the command."
                ) from None
            files.append(str(self.out / SENSITIVITY_FILE))
        return {
            "sweep": str(self.out),
            "scenario": str(self.definition.path),
            "members": len(self.definition.members),
            "stored": len(stored),
            "computed": self._computed,
            "complete": complete,
            "statuses": dict(Counter(self.statuses.values()).most_common()),
            "failures": counted_causes(str(row.get(MESSAGE, "")) for row in stored.rows(failed)),
            "added_muscles": list(self.definition.added_muscles),
            "workers": self._workers,
            "wall_s": self._wall_s,
            "worker_s": self._worker_s,
            "members_per_minute": self._rate,
            "files": files,
        }


def engine_for(processes: int | None, executor: Executor | None, scheduler: str | None, members: int) -> Engine:
    """The engine for a number of runs; see ``explicitfe.app.api.sweep``."""
    if scheduler is not None and (processes is not None or executor is not None):
        raise InputError(
            "`scheduler`: the scheduler has its own workers; remove `processes` (in Python, processes and executor)."
        )
    if processes is not None and processes < 1:
        raise InputError(f"`processes` {processes}: the smallest value is 1.")
    if executor is not None:
        return Engine(executor, processes)
    if scheduler is not None:
        return Cluster(scheduler)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Processes(max(1, min(processes or cores, members)))
