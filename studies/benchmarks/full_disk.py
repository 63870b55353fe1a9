"""A disk that is full from the n-th question on, for every n: what a run leaves, and whether it goes on.

    python studies/benchmarks/full_disk.py

The run stores five samples with restart states, makes room for more several times, and ends. Every write, reservation, creation,
renaming and synchronisation is a question that the disk can refuse; from then on it refuses all. What is left has to be whole up
to the last sample of which the run was not told that it failed, and to come to the right end when there is room again: from the
file, or in the same process.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests"))

from failing_disk import FullDisk, questions, run_on  # noqa: E402


def main() -> None:
    """Print the table."""
    begin = time.perf_counter()
    count = questions()
    print(
        "| the refused write | room again | tried | refused | stopped, then gone on with | finished |\n|---|---|---|---|---|---|"
    )
    for torn in (False, True):
        for room_at_the_end in (False, True):
            ended: Counter[str] = Counter()
            for left in range(count + 1):
                with tempfile.TemporaryDirectory() as folder:
                    ended[run_on(FullDisk(left, torn), Path(folder), room_at_the_end=room_at_the_end).ended] += 1
            write = "gets half through" if torn else "changes nothing"
            room = "before the run ends" if room_at_the_end else "later"
            cells = [write, room, sum(ended.values()), *(ended[one] for one in ("refused", "stopped", "finished"))]
            print(f"| {' | '.join(map(str, cells))} |", flush=True)
    print(f"\n{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
