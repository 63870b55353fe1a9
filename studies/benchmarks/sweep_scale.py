"""What limits a sweep on many workers: the driver's own code with imagined workers, in imagined time.

    python studies/benchmarks/sweep_scale.py OUT [--sync-ms 50]

What the driver does for a row, and for having rows on the disk, is measured first, on rows of a small sweep in OUT and on this
disk; to send a bundle and get it back takes a millisecond, as Dask says of its tasks. Then bundles go to workers that only wait,
by a clock that is not real, and by the code that sends real ones. The table is that of docs/studies/sweeps.md.
"""

from __future__ import annotations

import argparse
import heapq
import pickle
import shutil
import tempfile
import time
from concurrent.futures import Future
from pathlib import Path

import numpy as np

import explicitfe
from explicitfe.simulate.sweep.engine import Bundles, Engine
from explicitfe.simulate.sweep.journal import Journal, Stored
from explicitfe.simulate.sweep.rows import Member, Task, WrittenRow, written

MEMBERS = {"muscle.GGp.force_N": "0:4:40"}
SPREAD_SHARE = 0.3  # of the times of members, one standard deviation
SIZES = (1, 10, 100, 1000)
BUNDLE_SENT_S = 1e-3
WORKERS = (2, 16, 128, 1000)
MEMBER_S = (0.1, 1.0, 10.0)


class Waiting(Engine):
    """Workers that only wait. The driver has one clock for what it does itself."""

    def __init__(self, workers: int, member_s: float, sync_s: float, row_s: float) -> None:
        self._workers, self.member_s, self.sync_s, self.row_s = workers, member_s, sync_s, row_s
        self.now_s = self.driver_s = self.worked_s = 0.0
        self._free = [0.0] * workers
        self._ends: list[tuple[float, int, Future, list]] = []
        self._rng = np.random.default_rng(1)
        self._count = 0

    @property
    def workers(self):
        return self._workers

    def submit(self, task, members):
        self._spend(BUNDLE_SENT_S)
        future: Future = Future()
        times = self.member_s * np.clip(self._rng.normal(1.0, SPREAD_SHARE, len(members)), 0.1, None)
        begin = max(heapq.heappop(self._free), self.now_s)
        heapq.heappush(self._free, begin + times.sum())
        self.worked_s += times.sum()
        rows = [WrittenRow(m.number, "finished", float(s), "", "") for m, s in zip(members, times, strict=True)]
        heapq.heappush(self._ends, (begin + times.sum(), self._count, future, rows))
        self._count += 1
        return future

    def wait(self, futures):
        done = set()
        self.now_s = max(self.now_s, self._ends[0][0])
        while self._ends and self._ends[0][0] <= self.now_s:
            _, _, future, rows = heapq.heappop(self._ends)
            future.set_result(rows)
            done.add(future)
            self._spend(self.row_s * len(rows))
        self._spend(self.sync_s)
        return done

    def _spend(self, seconds: float) -> None:
        self.now_s += seconds
        self.driver_s += seconds

    def is_death(self, error):
        return False

    def renew(self):
        """Nobody dies."""

    def close(self):
        """Nothing is open."""


def costs(out: Path) -> tuple[float, float, int]:
    """Seconds that it takes the driver to have rows on the disk, and for each row, and bytes of a row in the journal."""
    vary = [f"{key}={values}" for key, values in MEMBERS.items()]
    settings = ["model.resolution=coarse", "analysis.duration_ms=20"]
    list(explicitfe.sweep("vowel-i", vary, out=out, settings=settings))
    lines = [written(row) for row in Stored(out / "rows").rows()]
    seconds = []
    with tempfile.TemporaryDirectory(dir=out) as folder, Journal(Path(folder) / "all.jsonl") as journal:
        for size in SIZES:
            some = (lines * (size // len(lines) + 1))[:size]
            sent = pickle.dumps(some)
            best = np.inf
            for _ in range(20):
                begin = time.perf_counter()
                journal.append(pickle.loads(sent))
                best = min(best, time.perf_counter() - begin)
            seconds.append(best)
    row_s = (seconds[-1] - seconds[0]) / (SIZES[-1] - SIZES[0])
    size = sum(path.stat().st_size for path in (out / "rows").iterdir())
    return float(seconds[0] - row_s), float(row_s), size // len(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--sync-ms", type=float, help="what a slower file system takes to have rows on its disk, instead of this one"
    )
    options = parser.parse_args()
    sync_s, row_s, size = costs(options.out)
    print(f"to have rows on the disk takes {1e3 * sync_s:.2f} ms, a row {1e6 * row_s:.0f} us and {size} bytes")
    sync_s = sync_s if options.sync_ms is None else 1e-3 * options.sync_ms
    print("| workers | a member takes | members | wall time | workers busy | driver busy | rows at a time |")
    print("|---|---|---|---|---|---|---|")
    for workers in WORKERS:
        for member_s in MEMBER_S:
            count = min(1_000_000, max(20_000, int(workers * 600 / member_s)))
            engine = Waiting(workers, member_s, sync_s, row_s)
            members = (Member(number, "", ()) for number in range(count))
            bundles = sum(1 for _ in Bundles(Task(Path(), "", (), Path()), members, count, engine))
            busy = engine.worked_s / (workers * engine.now_s)
            print(
                f"| {workers} | {member_s:g} s | {count} | {engine.now_s / 60:.1f} min | {100 * busy:.0f} % | "
                f"{100 * engine.driver_s / engine.now_s:.0f} % | {count / bundles:.1f} |",
                flush=True,
            )
    shutil.rmtree(options.out, ignore_errors=True)


if __name__ == "__main__":
    main()
