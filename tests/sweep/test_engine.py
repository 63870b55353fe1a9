"""Whoever computes: bundles, workers that die, members that kill them; real processes, and a Dask cluster."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support import ROOT

import explicitfe
from explicitfe.platform.errors import InputError, MachineError
from explicitfe.simulate.sweep import engine
from explicitfe.simulate.sweep.engine import Bundles, Engine
from explicitfe.simulate.sweep.journal import Stored
from explicitfe.simulate.sweep.rows import Member, Task, written

WORK = Task(Path("s.toml"), "", ("points",), Path())
SCENARIO = str(ROOT / "scenarios" / "vowel-i.toml")
LONGEST_WAIT_S = 300.0  # tests wait for events, which take long on a busy machine
SMALL = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=4"]


class Imagined(Engine):
    """Two workers in the head: some members end the process that computes them, and with it all that is in flight."""

    def __init__(self, killers: dict[int, int], member_s: float = 0.4) -> None:
        self.killers, self.member_s = dict(killers), member_s
        self.sent: list[list[int]] = []
        self.broken, self.waiting = False, []

    breaks_as_a_whole = True

    @property
    def workers(self):
        return 2

    def submit(self, work, members):
        future: Future = Future()
        numbers = [member.number for member in members]
        self.sent.append(numbers)
        for number in numbers:
            if self.killers.get(number, 0) > 0:
                self.killers[number] -= 1
                self.broken = True
        if self.broken:
            future.set_exception(BrokenProcessPool("a process died"))
        else:
            row = {"name": "", "status": "finished", "message": "", "member_s": self.member_s}
            future.set_result([written({"member": number} | row) for number in numbers])
        return future

    def is_death(self, error):
        return isinstance(error, BrokenProcessPool)

    def renew(self):
        self.broken = False

    def close(self):
        """Nothing is open."""


def rows_by(engine: Imagined, count: int) -> dict[int, dict]:
    members = [Member(number, "", ()) for number in range(count)]
    return {line.number: line.row for lines in Bundles(WORK, members, count, engine) for line in lines}


def test_bundles_take_a_second_and_get_smaller_at_the_end():
    imagined = Imagined({}, member_s=0.1)
    assert len(rows_by(imagined, 200)) == 200
    sizes = [len(numbers) for numbers in imagined.sent]
    assert sizes[0] == 1  # it makes the machine code
    assert max(sizes) == 10 and sizes[-1] == 1
    assert sorted(n for numbers in imagined.sent for n in numbers) == list(range(200))


@pytest.mark.parametrize("killer", [0, 1, 7, 19])
def test_a_process_that_dies_once_loses_no_member(killer):
    rows = rows_by(Imagined({killer: 1}), 20)
    assert {row["status"] for row in rows.values()} == {"finished"} and len(rows) == 20


def test_a_member_that_always_kills_is_a_row_and_no_other_is():
    rows = rows_by(Imagined({3: 99, 11: 99}), 20)
    assert [number for number, row in sorted(rows.items()) if row["status"] == "lost"] == [3, 11]
    assert "its process ended each of 2 times" in rows[3]["message"]
    assert len(rows) == 20


def test_many_members_that_kill_are_rows_each():
    """A corner of a grid that needs more memory than there is."""
    rows = rows_by(Imagined(dict.fromkeys(range(10, 25), 99)), 40)
    assert [number for number, row in sorted(rows.items()) if row["status"] == "lost"] == list(range(10, 25)) and len(rows) == 40


def test_where_no_process_can_live_it_says_so():
    imagined = Imagined(dict.fromkeys(range(40), 99))
    with pytest.raises(MachineError, match="ended 3 times before the first row"):
        rows_by(imagined, 40)
    assert imagined.sent == [[0], [1], [2]]  # nobody is blamed, and another member is tried
    with pytest.raises(MachineError, match="50 successive runs ended"):
        rows_by(Imagined(dict.fromkeys(range(5, 400), 99)), 400)


def test_a_pool_that_broke_while_nobody_looked_loses_nothing():
    class Breaking(Imagined):
        def submit(self, work, members):
            if len(self.sent) in (3, 7) and not self.broken:
                self.sent.append([])
                self.broken = True
                raise BrokenProcessPool("a process died before this was sent")
            return super().submit(work, members)

    rows = rows_by(Breaking({}), 40)
    assert {row["status"] for row in rows.values()} == {"finished"} and len(rows) == 40


class Apart(Imagined):
    """Workers of a cluster: a death takes nothing with it but its own bundle."""

    breaks_as_a_whole = False

    def submit(self, work, members):
        future = super().submit(work, members)
        self.broken = False
        return future


def test_a_death_on_a_cluster_leaves_the_others_in_flight():
    apart = Apart({17: 99, 30: 1}, member_s=0.1)
    rows = rows_by(apart, 60)
    assert [number for number, row in rows.items() if row["status"] == "lost"] == [17] and len(rows) == 60
    times = Counter(number for numbers in apart.sent for number in numbers)
    bundles = [numbers for numbers in apart.sent if len(numbers) > 1 and (17 in numbers or 30 in numbers)]
    again = {number for numbers in bundles for number in numbers}
    assert {number for number, count in times.items() if count > 1} <= again  # only those that were in the same bundles


# ---- real ones ----


def started(out: Path, *more: str) -> subprocess.Popen:
    words = [
        "sweep",
        SCENARIO,
        "--vary",
        "muscle.GGp.force_N=0:4:60",
        *SMALL,
        "--out",
        str(out),
        "--processes",
        "2",
        "--json",
        *more,
    ]
    return subprocess.Popen(
        [sys.executable, "-m", "explicitfe", *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT
    )


def stored(out: Path) -> int:
    return len(Stored(out / "rows")) if (out / "rows").is_dir() else 0


def until(condition, seconds: float = LONGEST_WAIT_S) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)


def children(pid: int) -> list[int]:
    """Processes of a pool: those that were spawned by a process, without the one that watches its resources."""
    ids = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            text = (path / "stat").read_text()
            if int(text.rpartition(")")[2].split()[1]) == pid and b"spawn_main" in (path / "cmdline").read_bytes():
                ids.append(int(path.name))
        except OSError:
            continue
    return ids


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")
def test_kill_the_driver_and_a_worker(tmp_path):
    """The table is that of a sweep that nothing has disturbed; nothing that was stored is computed again."""
    whole, out = tmp_path / "whole", tmp_path / "out"
    undisturbed = started(whole)
    assert json.loads(undisturbed.communicate()[0])["complete"]

    driver = started(out)
    until(lambda: stored(out) > 3)
    workers = children(driver.pid)
    driver.kill()
    driver.wait()
    until(
        lambda: not any(Path(f"/proc/{pid}/cmdline").is_file() and Path(f"/proc/{pid}/cmdline").read_bytes() for pid in workers)
    )
    kept = set(Stored(out / "rows").places)
    assert not (out / "table.csv").exists()

    again = started(out)
    until(lambda: stored(out) > len(kept) + 3)
    os.kill(children(again.pid)[0], signal.SIGKILL)
    summary = json.loads(again.communicate()[0])
    assert summary["complete"] and summary["statuses"] == {"finished": 60}
    assert summary["computed"] == 60 - len(kept)
    assert (out / "table.csv").read_bytes() == (whole / "table.csv").read_bytes()


@pytest.mark.slow
def test_a_script_without_its_guard_is_told_so(tmp_path):
    """Its processes read it again, and come to the sweep themselves; no member is blamed."""
    (tmp_path / "script.py").write_text(
        "import explicitfe\n"
        f"for row in explicitfe.sweep({SCENARIO!r}, ['muscle.GGp.force_N=1,2'], settings=['model.cells=[8,4,4]'], out='out'):\n"
        "    print(row)\n"
    )
    done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False)
    assert done.returncode == 1 and done.stdout == ""
    assert 'put the call under  if __name__ == "__main__":' in done.stderr.splitlines()[-1]
    assert stored(tmp_path / "out") == 0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_signal_keeps_what_came_back(tmp_path):
    driver = started(tmp_path)
    until(lambda: stored(tmp_path) > 3)
    driver.terminate()
    answer = json.loads(driver.communicate()[0])
    assert driver.returncode == 143 and answer["failure"]["kind"] == "stopped"
    assert answer["stored"] == stored(tmp_path) and not answer["complete"]
    assert (tmp_path / "table.partial.csv").read_text().count("\n") == answer["stored"] + 1


@contextmanager
def cluster_of(workers: int) -> Iterator[Any]:
    """A Dask cluster whose workers are all registered, however long that takes on a busy machine."""
    import distributed

    with distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster, set_as_default=False) as client:
            client.wait_for_workers(workers)
        yield cluster


@pytest.mark.slow
def test_a_dask_cluster_by_its_address(tmp_path, monkeypatch):
    """Its scheduler is closed with most runs in flight; another one computes them."""
    pytest.importorskip("distributed")
    import dask

    monkeypatch.setattr(engine, "CONNECT_WITHIN_S", LONGEST_WAIT_S)
    with dask.config.set({"distributed.comm.timeouts.connect": f"{LONGEST_WAIT_S:g} s"}):
        compare_cluster_with_processes(tmp_path)


def compare_cluster_with_processes(tmp_path):
    options = {"settings": ["model.cells=[8,4,4]", "analysis.duration_ms=4"], "out": tmp_path / "dask"}

    def rows_by(cluster):
        return explicitfe.sweep(SCENARIO, ["muscle.GGp.force_N=0:4:5"], scheduler=cluster.scheduler_address, **options)

    first = []
    gone = r"the connection to the scheduler at tcp://.* is lost. All finished runs are stored"
    with cluster_of(1) as cluster, pytest.raises(MachineError, match=gone):
        for row in rows_by(cluster):
            first.append(row["member"])
            cluster.close()
    assert set(Stored(options["out"] / "rows").places) >= set(first) and len(first) < 5
    with cluster_of(2) as cluster:
        assert [row["member"] for row in rows_by(cluster)][: len(first)] == first  # the stored rows come first
    assert sorted(Stored(options["out"] / "rows").places) == [0, 1, 2, 3, 4]
    options["out"] = tmp_path / "here"
    list(explicitfe.sweep(SCENARIO, ["muscle.GGp.force_N=0:4:5"], processes=1, **options))
    assert (tmp_path / "dask" / "table.csv").read_bytes() == (tmp_path / "here" / "table.csv").read_bytes()


def test_an_executor_that_gives_up_is_named():
    class Cancelling(Imagined):
        def submit(self, work, members):
            future: Future = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with pytest.raises(MachineError, match="cancelled runs before computing them"):
        rows_by(Cancelling({}), 5)


class Job:
    """What a batch system gives for a bundle: no future, but it can be asked."""

    cancelled = False

    def __init__(self, function, *words):
        self._asked, self._rows = 0, function(*words)

    def done(self):
        self._asked += 1
        return self._asked > 2

    def exception(self):
        return None

    def result(self):
        return self._rows


def test_jobs_of_a_batch_system(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "POLL_FUTURES_S", 0.01)

    class Batch:
        def submit(self, function, *words):
            return Job(function, *words)

    options = {"settings": ["model.cells=[8,4,4]", "analysis.duration_ms=4"], "executor": Batch(), "processes": 2}
    rows = list(explicitfe.sweep(SCENARIO, ["muscle.GGp.force_N=0,1,2"], out=tmp_path, **options))
    assert sorted(row["member"] for row in rows) == [0, 1, 2] and {row["status"] for row in rows} == {"finished"}


def test_an_address_that_nobody_answers(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(engine, "CONNECT_WITHIN_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense"):
        with pytest.raises(InputError, match="no scheduler answers"):
            list(explicitfe.sweep(SCENARIO, ["muscle.GGp.force_N=0,1"], out=tmp_path, scheduler=address))
    assert not list(tmp_path.rglob("*.jsonl"))
