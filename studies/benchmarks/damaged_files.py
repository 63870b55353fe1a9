"""Result files cut at random lengths and with random bytes changed: a sentence, or a right answer (docs/reference/results.md).

    python studies/benchmarks/damaged_files.py --each 300 --seed 18

Each damaged file is read whole by a process of its own: all that ``inspect`` shows, every field at every step, histories, probes,
bones, restart states, and a mesh for pyvista. The files are small, so that most of their bytes are structure: a finished result,
one whose run was killed, and one of a real run.
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

import numpy as np  # noqa: E402
import pyvista  # noqa: E402, F401
from damage import OUTCOMES, damages, outcome, read_all, readings  # noqa: E402
from tiny_result import add, start  # noqa: E402

import explicitfe  # noqa: E402
from explicitfe.platform.errors import InputError  # noqa: E402
from explicitfe.results.files import FINISHED, open_result  # noqa: E402

KINDS = ("cut", "byte", "structure byte", "structure bytes", "block")
SHORT_RUN = ["model.cells=[8,4,4]", "analysis.duration_ms=4", "record.every_ms=1", "record.fields=['J']"]
SHOWN_CHARACTERS = 1500


def sources(folder: Path) -> dict[str, Path]:
    """The files to be damaged."""
    with start(folder / "finished.vtkhdf") as run:
        for step in range(5):
            add(run, step)
        finished = run.finish(FINISHED, "", {"steps": 5})
    with start(folder / "killed.vtkhdf", expected_samples=2) as run:
        for step in range(5):
            add(run, step)
    real = explicitfe.run(ROOT / "scenarios" / "vowel-i.toml", folder, settings=SHORT_RUN)
    return {"finished": finished, "killed": folder / "killed.running.vtkhdf", "real run": Path(real["result"])}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=300, help="damaged files of each kind and source")
    parser.add_argument("--seed", type=int, default=18)
    options = parser.parse_args()
    begin = time.perf_counter()
    print(f"| file | damage | {' | '.join(OUTCOMES)} |\n|{'---|' * (2 + len(OUTCOMES))}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for source, path in sources(folder).items():
            calls = readings(path)
            truth = read_all(path, calls)
            assert not [value for value in truth.values() if isinstance(value, InputError)]
            with open_result(path) as result:
                older = [None, *result.restart_states()]
            counts: Counter[tuple[str, str]] = Counter()
            damaged = folder / "damaged.vtkhdf"
            for damage in damages(path, np.random.default_rng(options.seed), dict.fromkeys(KINDS, options.each)):
                damaged.write_bytes(damage.data)
                came_to, what = outcome(damaged, calls, truth, older)
                counts[damage.kind, came_to] += 1
                if came_to not in ("right", "sentence"):
                    print(f"{source}, {damage.kind}: {came_to}: {what[-SHOWN_CHARACTERS:]}", file=sys.stderr)
            for kind in KINDS:
                print(f"| {source} | {kind} | {' | '.join(str(counts[kind, one]) for one in OUTCOMES)} |", flush=True)
    print(f"\n{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
