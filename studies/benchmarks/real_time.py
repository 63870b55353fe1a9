"""How fast vowel [i] is computed against real time: meshes, speeds, lanes of a vector and threads, each run several times.

    python studies/benchmarks/real_time.py [--times 5] [--scenario vowel-i]

All combinations take turns, each in a process of its own, so that other work on the machine meets all of them; the table holds
medians of simulated time over the time of steps and stability checks, and in brackets the slowest and the fastest. The first turn
does not count: it compiles kernels.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[2]
LANES, THREADS = ("8", "4"), (1, 2)
MODELS = tuple(product(("medium", "coarse"), ("accurate", "interactive")))


def speed(scenario: str, model: tuple[str, str], lanes: str, threads: int, folder: str) -> float:
    """Simulated time over the time of steps and stability checks."""
    resolution, kind = model
    settings = (f"model.resolution={resolution}", f"model.speed={kind}", f"analysis.threads={threads}")
    words = [word for setting in settings for word in ("--set", setting)]
    code = [sys.executable, "-c", "from explicitfe.app.cli.main import entry; entry()", "run", scenario, *words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "EXPLICITFE_LANES": lanes}
    done = subprocess.run(
        [*code, "--overwrite", "--json", "--out", folder], capture_output=True, text=True, check=True, cwd=ROOT, env=environment
    )
    summary = json.loads(done.stdout)
    return float(summary["simulated_s"] / (summary["loop_s"] + summary["look_s"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--scenario", default="vowel-i")
    arguments = parser.parse_args()
    cases = list(product(MODELS, LANES, THREADS))
    measured: dict[tuple[tuple[str, str], str, int], list[float]] = {case: [] for case in cases}
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(arguments.times + 1):
            for case in cases:
                fast = speed(arguments.scenario, *case, folder)
                if turn:
                    measured[case].append(fast)
    print(f"{arguments.scenario}, times real time; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.\n")
    columns = list(product(LANES, THREADS))
    print(
        "| mesh | speed | "
        + " | ".join(f"{lanes} lanes, {threads} thread{'s' * (threads > 1)}" for lanes, threads in columns)
        + " |"
    )
    print("|---" * (2 + len(columns)) + "|")
    for model in MODELS:
        cells = [measured[model, *column] for column in columns]
        print(f"| {' | '.join(model)} | " + " | ".join(f"{median(c):.2f} ({min(c):.2f} to {max(c):.2f})" for c in cells) + " |")


if __name__ == "__main__":
    main()
