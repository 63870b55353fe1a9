"""Runs that are killed and stopped at random moments: what is left of them, and whether it goes on to the same end.

    python studies/benchmarks/kills.py --each 40

Two runs, one in time and one of equilibria, are started again and again as a user starts them, and get a SIGKILL, SIGTERM or
SIGINT at a moment drawn at random between their start and their end; some get a second signal up to half a second later. What is
left is then read by h5py, by pyvista and by "explicitfe inspect", its status is compared with what happened, and
"explicitfe run --resume" goes on with it. The end has to be that of the run that was left alone, bit for bit.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from explicitfe.results.files import Result, open_result

ROOT = Path(__file__).resolve().parents[2]
SEED = 1805
SECOND_SIGNAL_SHARE = 0.25  # of the runs that are stopped
LONGEST_WAIT_S = 0.5  # for the second signal
PATIENCE_S = 120.0
RUNS = {
    "in time": ("vowel-i", ("model.cells=[8,4,4]", "analysis.duration_ms=15000", "record.every_ms=25", "analysis.threads=1")),
    "equilibria": ("indentation-rear", ("model.refinement=0.6", "analysis.threads=1")),
}
STATUSES = ("nothing", "running", "interrupted", "finished")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)


class Trial(NamedTuple):
    """What became of one run: its exit code, the status of what was left and what was wrong, if anything."""

    exit_code: int
    left: str
    samples: int
    problems: list[str]


def arguments_of(name: str, out: Path, *more: str) -> list[str]:
    """The command line of a run."""
    scenario, settings = RUNS[name]
    chosen = [word for setting in settings for word in ("--set", setting)]
    command = [sys.executable, "-m", "explicitfe", "run", str(ROOT / f"scenarios/{scenario}.toml"), "--out", str(out)]
    return [*command, *chosen, "--json", *more]


def numbers(result: Result) -> Iterator[tuple[str, np.ndarray]]:
    """Everything that a run has computed."""
    yield "times", result.times
    for name in result.history_names:
        yield f"history {name}", result.history(name)
    for name in result.fields:
        yield f"field {name}", np.array([result.field(name, step) for step in range(len(result.times))])


def trial(name: str, whole: Path, lasts_s: float, number: signal.Signals, rng: np.random.Generator) -> Trial:
    """Start a run, interrupt it, look at what is left, and go on."""
    problems: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        process = subprocess.Popen(arguments_of(name, out), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        time.sleep(rng.uniform(0.1, 1.0) * lasts_s)
        process.send_signal(number)
        twice = number != signal.SIGKILL and rng.uniform() < SECOND_SIGNAL_SHARE
        if twice:
            time.sleep(rng.uniform(0.0, LONGEST_WAIT_S))
            process.send_signal(number)
        words = process.communicate(timeout=PATIENCE_S)[1]
        code = process.returncode
        if "Traceback" in words:
            problems.append(f"traceback: {words[-300:]}")
        if number != signal.SIGKILL and code not in (0, 128 + number, -number):
            problems.append(f"exit code {code}")
        others = [path.name for path in out.iterdir() if not path.name.endswith(".vtkhdf")]
        if others and not (twice or number == signal.SIGKILL):
            problems.append(f"left {others}")
        files = sorted(out.glob("*.vtkhdf"))
        left, samples = "nothing", 0
        for path in files:
            left, samples, seen = looked_at(path, code)
            problems += seen
        done = subprocess.run(arguments_of(name, out, "--resume"), capture_output=True, text=True, timeout=PATIENCE_S)
        if done.returncode:
            problems.append(f"does not go on: {done.stderr[-300:]}")
        else:
            with open_result(json.loads(done.stdout)["result"]) as result, open_result(whole) as wanted:
                theirs = dict(numbers(wanted))
                for key, values in numbers(result):
                    if not np.array_equal(values, theirs.pop(key)):
                        problems.append(f"{key} differs")
                problems += [f"{key} is missing" for key in theirs]
                if result.status != "finished":
                    problems.append(f"ended as {result.status}")
        remains = {path.suffix for path in out.iterdir()} - {".vtkhdf"}
        if len(list(out.glob("*.vtkhdf"))) != 1:
            problems.append(f"left over: {sorted(path.name for path in out.iterdir())}")
        if remains and number != signal.SIGKILL and not twice:
            problems.append(f"left over: {remains}")
    return Trial(code, left, samples, problems)


def looked_at(path: Path, code: int) -> tuple[str, int, list[str]]:
    """Status and samples of what is left, and what is wrong with it."""
    problems = []
    with h5py.File(path) as file:
        file.visititems(lambda _, item: item[()] if isinstance(item, h5py.Dataset) else None)
    seen = subprocess.run([sys.executable, "-m", "explicitfe", "inspect", str(path), "--json"], capture_output=True, text=True)
    if seen.returncode:
        problems.append(f"inspect: {seen.stderr[-300:]}")
    with open_result(path) as result:
        status, samples = result.status, len(result.times)
        if not samples:
            problems.append("a file without a sample")
        elif not np.array_equal(result.mesh_at(step=samples - 1).point_data["displacement"], result.displacement()):
            problems.append("pyvista sees something else")
        if result.live:
            problems.append("said to be live")
    wanted = {0: ("finished",), -9: ("running",)}.get(code, ("interrupted", "running"))
    if status not in wanted and not (code == -9 and status == "finished"):
        problems.append(f'status "{status}" after exit code {code}')
    return status, samples, problems


def main() -> None:
    """Print a table of all trials, and each that went wrong."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--each", type=int, default=40, help="trials of each signal")
    options.add_argument("--signals", nargs="+", default=[number.name for number in SIGNALS], help="which of them")
    chosen = options.parse_args()
    each = chosen.each
    # Started in the background of a script this program ignores Ctrl-C, and what it starts would, too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rng = np.random.default_rng(SEED)
    os.environ["OMP_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        whole: dict[str, Path] = {}
        lasts_s: dict[str, float] = {}
        for name in RUNS:
            for turn in range(2):  # the first makes the machine code
                begin = time.perf_counter()
                out = Path(folder) / name / str(turn)
                done = subprocess.run(arguments_of(name, out), capture_output=True, text=True, check=True)
                lasts_s[name] = time.perf_counter() - begin
            whole[name] = Path(json.loads(done.stdout)["result"])
        print("run lasts", {name: round(s, 1) for name, s in lasts_s.items()}, "s", flush=True)
        row = "{:8} {:12} {:>6} {:>8} {:>8} {:>11} {:>8} {:>6}"
        print(row.format("signal", "run", "trials", *STATUSES, "right"))
        for number in (one for one in SIGNALS if one.name in chosen.signals):
            for name in RUNS:
                trials = [trial(name, whole[name], lasts_s[name], number, rng) for _ in range(each // len(RUNS))]
                left = Counter(one.left for one in trials)
                right = sum(not one.problems for one in trials)
                print(row.format(number.name, name, len(trials), *(left[status] for status in STATUSES), right), flush=True)
                for one in trials:
                    for problem in one.problems:
                        print("   ", problem, flush=True)


if __name__ == "__main__":
    main()
