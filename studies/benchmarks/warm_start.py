"""How long a command takes that has run before: wall and CPU seconds, and what a second run of vowel [i] spends them on.

    python studies/benchmarks/warm_start.py [--times 5] [--package FOLDER ...]

Each command runs in processes of its own, the first time uncounted: it compiles kernels and stores what later runs load. Commands
and checkouts of the package take turns, so that other work on the machine meets all of them; the table holds medians.
``--package`` names the top folder of another checkout, such as that of an earlier version.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[2]
RUN = ("run", "vowel-i", "--overwrite", "--json")
COMMANDS = (("--help",), ("list", "scenarios"), ("check", "vowel-i"), RUN)
PARTS = {
    "steps": lambda summary: summary["loop_s"],
    "stability checks": lambda summary: summary["look_s"],
    "samples": lambda summary: summary["sample_s"],
    "kernels": lambda summary: summary["compile_s"],
    "model and files": lambda summary: (
        summary["total_s"] - sum(summary[f"{part}_s"] for part in ("loop", "look", "sample", "compile"))
    ),
}


def timed(package: Path, words: tuple[str, ...]) -> dict[str, float]:
    """Wall and CPU seconds of a command, by part where it tells them."""
    environment = {**os.environ, "PYTHONPATH": str(package)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package has its bytecode
    code = [sys.executable, "-c", "from explicitfe.app.cli.main import entry; entry()", *words]
    before, begin = os.times(), time.perf_counter()
    done = subprocess.run(code, capture_output=True, text=True, check=True, cwd=package, env=environment)
    wall_s, after = time.perf_counter() - begin, os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    seconds = {"wall": wall_s, "CPU": cpu_s}
    if words[: len(RUN)] == RUN:
        summary = json.loads(done.stdout)
        seconds |= {name: part(summary) for name, part in PARTS.items()}
        seconds["imports and tables"] = wall_s - summary["total_s"]
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--package", type=Path, action="append", default=[])
    arguments = parser.parse_args()
    packages = [ROOT, *arguments.package]
    measured: dict[tuple[Path, tuple[str, ...]], list[dict[str, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(arguments.times + 1):
            for words, package in product(COMMANDS, packages):
                seconds = timed(package, (*words, "--out", folder) if words == RUN else words)
                if turn:
                    measured.setdefault((package, words), []).append(seconds)
    print(f"Medians of {arguments.times}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.\n")
    print("| command | package | wall | CPU | of the wall time |\n|---|---|---|---|---|")
    for (package, words), runs in measured.items():
        seconds = {name: median(run[name] for run in runs) for name in runs[0]}
        parts = ", ".join(f"{name} {seconds[name]:.2f} s" for name in seconds if name not in ("wall", "CPU"))
        print(f"| `{' '.join(words)}` | {package} | {seconds['wall']:.2f} s | {seconds['CPU']:.2f} s | {parts} |")


if __name__ == "__main__":
    main()
