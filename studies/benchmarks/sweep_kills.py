"""Sweeps that are killed at random moments (drivers, workers, a Dask scheduler), or shared: what is lost or computed again.

    python studies/benchmarks/sweep_kills.py [--members 120] [--kills 5]

Among the members are one whose elements invert and one that is refused. What is left after each kill is counted; then the same
command is given again. At the end the table has to be that of a sweep that nobody disturbed, byte for byte, and the journal has
to hold each member once.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from explicitfe.simulate.sweep.journal import Stored

ROOT = Path(__file__).resolve().parents[2]
SEED = 21
PATIENCE_S = 300.0
STEP = ("muscle.GGp.profile=step", "muscle.GGp.rise_ms=0", "muscle.GGp.distribution=ends")
SETTINGS = ("model.resolution=coarse", "analysis.duration_ms=40", *STEP)
INVERTS_N, REFUSED_N = 400.0, -1.0


def command(members: Path, out: Path, *more: str) -> list[str]:
    settings = [word for setting in SETTINGS for word in ("--set", setting)]
    words = ["sweep", "vowel-i", "--table", str(members), "--out", str(out), *settings, "--json", *more]
    return [sys.executable, "-m", "explicitfe", *words]


def start(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def stored(out: Path) -> int:
    return len(Stored(out / "rows")) if (out / "rows").is_dir() else 0


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            raise SystemExit("it did not happen")
        time.sleep(0.01)


def children_of(pid: int) -> list[int]:
    """Processes that compute for a driver."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == pid and b"spawn_main" in (path / "cmdline").read_bytes():
                found.append(int(path.name))
        except OSError:
            continue
    return found


def rows_written(out: Path) -> int:
    """Rows in the journals of a sweep; a member that was computed and stored twice counts twice."""
    texts = (path.read_text(encoding="utf-8") for path in (out / "rows").glob("*.jsonl"))
    return sum(line.startswith("[") for text in texts for line in text.splitlines())


def killed_drivers(members: Path, out: Path, count: int, kills: int, moments: random.Random) -> None:
    at = sorted(moments.sample(range(3, count - 8), kills))
    for number, rows in enumerate(at, 1):
        driver = start(*command(members, out, "--processes", "2"))
        wait_for(lambda rows=rows: stored(out) >= rows)
        time.sleep(moments.uniform(0.0, 0.3))
        driver.kill()
        driver.wait()
        print(f"kill {number} of a driver at {rows} rows: {stored(out)} of {count} are stored")
    driver = start(*command(members, out, "--processes", "2"))
    before = stored(out)
    wait_for(lambda: len(children_of(driver.pid)) == 2 and stored(out) > before)
    os.kill(children_of(driver.pid)[0], signal.SIGKILL)
    finish(driver, out, "a worker was killed")


def killed_scheduler(members: Path, out: Path, count: int) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    for number, dies in enumerate((True, False)):
        scheduler = start(sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", address, "--no-dashboard")
        workers = [
            start(
                sys.executable,
                "-m",
                "distributed.cli.dask_worker",
                address,
                "--nthreads",
                "1",
                "--no-dashboard",
                "--death-timeout",
                "5",
            )
            for _ in range(2)
        ]
        time.sleep(8.0)
        driver = start(*command(members, out, "--scheduler", address))
        if dies:
            wait_for(lambda: stored(out) > count // 3)
            scheduler.kill()
            answer, errors = driver.communicate(timeout=PATIENCE_S)
            said = json.loads(answer).get("failure") if answer.strip() else errors.strip().splitlines()[-1]
            print(f"the scheduler was killed: exit {driver.returncode}, {stored(out)} of {count} are stored; {said}")
        else:
            finish(driver, out, f"a new scheduler, attempt {number}")
        for process in (scheduler, *workers):
            process.kill()
            process.wait()


def shares_at_a_time(members: Path, out: Path, parts: int = 4) -> None:
    """Each share by a process of its own, all at the same time; whoever ends last writes the table."""
    commands = [command(members, out, "--processes", "1", "--only", f"{number}/{parts}") for number in range(1, parts + 1)]
    processes = [start(*words) for words in commands]
    answers = [json.loads(process.communicate(timeout=PATIENCE_S)[0]) for process in processes]
    computed, complete = ([answer[key] for answer in answers] for key in ("computed", "complete"))
    print(f"{parts} shares at a time: {computed} computed; complete {complete}")


def finish(driver: subprocess.Popen[str], out: Path, what: str) -> None:
    summary = json.loads(driver.communicate(timeout=PATIENCE_S)[0])
    print(f"{what}: complete {summary['complete']}, {summary['computed']} computed, {summary['statuses']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--members", type=int, default=120)
    parser.add_argument("--kills", type=int, default=5)
    options = parser.parse_args()
    moments = random.Random(SEED)
    forces = [0.02 * number for number in range(options.members)]
    forces[options.members // 3], forces[options.members // 2] = INVERTS_N, REFUSED_N
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        members = work / "members.csv"
        members.write_text("muscle.GGp.force_N\n" + "".join(f"{force}\n" for force in forces), encoding="utf-8")
        finish(start(*command(members, work / "whole", "--processes", "2")), work / "whole", "undisturbed")
        killed_drivers(members, work / "drivers", options.members, options.kills, moments)
        killed_scheduler(members, work / "scheduler", options.members)
        shares_at_a_time(members, work / "shares")
        whole = (work / "whole" / "table.csv").read_bytes()
        for name in ("drivers", "scheduler", "shares"):
            same = (work / name / "table.csv").read_bytes() == whole
            print(f"{name}: {rows_written(work / name)} rows for {options.members} members; the table is the same: {same}")


if __name__ == "__main__":
    main()
