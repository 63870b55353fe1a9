"""Many processes in one folder, for one result: nothing of anybody else is touched (docs/reference/results.md).

    python studies/benchmarks/abused_folder.py --attempts 200 --at-once 16 --rounds 5

Runs, with and without --overwrite, some refused or killed on their way or gone on with; a user who takes the result away; links,
foreign files, folders, pipes and files without permission that are put where runs write, each for a while.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests"))

from abuse import KINDS, abuse  # noqa: E402


def main() -> None:
    """Print how the attempts of each kind ended."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--attempts", type=int, default=200)
    parser.add_argument("--at-once", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--seed", type=int, default=18)
    options = parser.parse_args()
    begin = time.perf_counter()
    counts: Counter[tuple[str, str]] = Counter()
    for number in range(options.rounds):
        with tempfile.TemporaryDirectory() as folder:
            counts += abuse(Path(folder), options.attempts, options.at_once, options.seed + number)
    print("| attempt | ended | times |\n|---|---|---|")
    for kind in KINDS:
        for (one, answer), times in sorted(counts.items()):
            if one == kind:
                print(f"| {kind} | {answer} | {times} |")
    print(f"\n{sum(counts.values())} attempts, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
