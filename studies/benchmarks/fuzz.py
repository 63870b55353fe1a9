"""Thousands of spoilt inputs of eight kinds over the real command line: the table of docs/explanation/robustness.md.

    python studies/benchmarks/fuzz.py --inputs 6000 --seed 1 --out outputs/fuzz

Inputs are tried in batches, each in a process of its own, so that one that crashes or hangs ends its batch and nothing else.
Where a promise is broken, the first input of each sort is kept in OUT/faults with the command that shows it.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "fuzz")]

BATCH = 200
ONE_IN_CHILD = 50  # of so many inputs one is tried in a process of its own
SILENCE_LIMIT_S = 900.0  # A batch that says nothing for so long hangs in compiled code, which no signal ends.
SECOND_SIGNATURE_WORDS = 12


def batch(kind: str, seed: int, count: int, journal: Path, kept: Path) -> None:
    """Try inputs of a kind, with a line of the journal before and after each."""
    from fuzz_inputs import KINDS, FuzzInput
    from fuzz_verdict import judged
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as seeded

    number = 0
    with journal.open("a", encoding="utf-8") as lines:

        def note(**entry: object) -> None:
            lines.write(json.dumps(entry) + "\n")
            lines.flush()

        @seeded(seed)
        @settings(
            max_examples=count, database=None, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
        )
        @given(KINDS[kind])
        def one(tried: FuzzInput) -> None:
            nonlocal number
            number += 1
            note(begin=number, arguments=tried.arguments)
            folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
            in_child = number % ONE_IN_CHILD == 0
            last = kept / "last"
            _keep(tried, last)
            try:
                verdict = judged(tried, folder, in_child=in_child)
            finally:
                shutil.rmtree(folder, ignore_errors=True)
            for fault in verdict.faults:
                place = kept / signature(kind, fault)
                if not place.exists():
                    _keep(tried, place)
                    (place / "fault.txt").write_text(fault, encoding="utf-8")
            note(end=number, in_child=in_child, **asdict(verdict))

        one()


def _keep(tried: object, place: Path) -> None:
    """Write an input down, with the command."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    for name, raw in tried.files.items():  # type: ignore[attr-defined]
        (place / name).write_bytes(raw)
    (place / "command.sh").write_text("explicitfe " + shlex.join(tried.arguments) + "\n", errors="replace")  # type: ignore[attr-defined]


def signature(kind: str, fault: str) -> str:
    """A name for a sort of fault: its words without numbers and without what was echoed."""
    plain = "".join(c if c.isalpha() or c in " :_." else " " for c in fault)
    return "-".join([kind.replace(" ", "-"), *plain.replace(":", " ").split()[:SECOND_SIGNATURE_WORDS]])[:120]


def tried_in_a_process(kind: str, seed: int, count: int, folder: Path) -> list[dict[str, object]]:
    """The verdicts of a batch; an input that ended its process is one with a fault."""
    journal = folder / f"{kind.replace(' ', '-')}-{seed}.jsonl"
    journal.unlink(missing_ok=True)
    journal.touch()
    call = [sys.executable, __file__, "--batch", kind, str(seed), str(count), str(journal), str(folder / "faults")]
    with (folder / "batch.log").open("ab") as log:
        process = subprocess.Popen(call, stdout=log, stderr=log, cwd=folder, env=os.environ | {"OMP_NUM_THREADS": "1"})
        end = "ended"
        while process.poll() is None:
            time.sleep(0.5)
            if time.time() - journal.stat().st_mtime > SILENCE_LIMIT_S:
                process.kill()
                process.wait()
                end = "hung in compiled code and was killed"
    entries = [json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines()]
    verdicts = [entry for entry in entries if "end" in entry]
    if entries and "begin" in entries[-1]:
        fault = f"crash: the process {end}, exit code {process.returncode}"
        place = folder / "faults" / signature(kind, fault)
        if not place.exists():
            shutil.copytree(folder / "faults" / "last", place)
            (place / "fault.txt").write_text(fault, encoding="utf-8")
        verdicts.append({"kind": kind, "code": None, "seconds": 0.0, "ran": False, "faults": [fault], "in_child": False})
    return verdicts


def table(verdicts: list[dict[str, object]]) -> str:
    """The counts in Markdown."""
    kinds = list(dict.fromkeys(str(v["kind"]) for v in verdicts))
    heads = [
        "kind", "inputs", "in a process of its own", "refused (2)", "answered (0)", "stopped (3)", "left a result",
        "longest", "broken promises",
    ]  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for kind in [*kinds, "all"]:
        of = [v for v in verdicts if kind in (v["kind"], "all")]
        codes = Counter(v["code"] for v in of)
        longest = max((float(v["seconds"]) for v in of if not v["in_child"]), default=0.0)
        cells = [
            kind, len(of), sum(bool(v["in_child"]) for v in of), codes[2], codes[0], codes[3], sum(bool(v["ran"]) for v in of),
            f"{longest:.1f} s", sum(bool(v["faults"]) for v in of),
        ]  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", help="only these")
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "fuzz")
    parser.add_argument("--batch", nargs=5, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.batch:
        kind, seed, count, journal, kept = chosen.batch
        batch(kind, int(seed), int(count), Path(journal), Path(kept))
        return
    from fuzz_inputs import KINDS

    kinds = chosen.kinds or list(KINDS)
    folder = chosen.out.resolve()
    (folder / "faults").mkdir(parents=True, exist_ok=True)
    verdicts: list[dict[str, object]] = []
    for number, kind in enumerate(kinds):
        wanted, seed = -(-chosen.inputs // len(kinds)), chosen.seed * 10_000 + number * 1000
        while wanted > 0:
            of_batch = tried_in_a_process(kind, seed, min(BATCH, wanted), folder)
            if not of_batch:
                raise SystemExit(f"a batch of {kind} did not start; see {folder / 'batch.log'}")
            verdicts += of_batch
            wanted, seed = wanted - len(of_batch), seed + 1
            (folder / "table.md").write_text(table(verdicts), encoding="utf-8")
            print(f"{kind}: {max(wanted, 0)} to go, {sum(bool(v['faults']) for v in verdicts)} broken promises", flush=True)
    counts = Counter(signature(str(v["kind"]), fault) for v in verdicts for fault in v["faults"])  # type: ignore[union-attr]
    (folder / "faults.json").write_text(json.dumps(counts.most_common(), indent=1), encoding="utf-8")
    print(table(verdicts))


if __name__ == "__main__":
    main()
