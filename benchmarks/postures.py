"""Many postures: how fast members are computed, what of that is no step, and which muscles are on where a tongue is braced.

    python benchmarks/postures.py pace OUT [--count 2000]     # random postures by one process, then by two, and by this one
    python benchmarks/postures.py braced OUT [--share 0.1]    # 0, 10 and 25 % of the largest force of ten muscles: 59 049 members

The tables that they print are those of docs/studies/sweeps.md. What is computed stays in OUT: given again, it goes on.
"""

from __future__ import annotations

import argparse
import itertools
import os
import time
from pathlib import Path

import numpy as np

import explicitfe
from explicitfe.sweep.journal import Stored

SCENARIO = Path(__file__).with_name("postures.toml")
# Largest forces of both sides, N, of the model that Liu et al. (2022) ran, by 22 N/cm2; GGp with its horizontal part.
LARGEST_N = {
    "GGa": 18.0, "GGm": 12.0, "GGp": 37.0, "STY": 24.0, "HG": 65.0,
    "VERT": 20.0, "TRANS": 50.0, "IL": 9.0, "SL": 19.0, "MH": 39.0,
}  # fmt: skip
SHARES = (0.0, 0.10, 0.25)
KEYS = [f"muscle.{name}.force_N" for name in LARGEST_N]
SEED = 2022


def table(out: Path, lines: np.ndarray) -> Path:
    """A table of members."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "postures.csv"
    text = "\n".join([",".join(KEYS), *(",".join(f"{force:.6g}" for force in line) for line in lines)])
    path.write_text(text + "\n", encoding="utf-8")
    return path


def pace(out: Path, count: int) -> None:
    rng = np.random.default_rng(SEED)
    lines = rng.uniform(0.0, 0.25, (count, len(KEYS))) * list(LARGEST_N.values()) * (rng.random((count, len(KEYS))) < 0.4)
    members = table(out, lines)
    print("| processes | members | seconds | a minute |\n|---|---|---|---|")
    for processes in (2, 1):
        few = members if processes == 2 else table(out / "half", lines[: count // 2])
        # the first member of a process loads what the others have: it is not counted
        sweep = explicitfe.sweep(SCENARIO, table=few, out=out / f"by-{processes}", processes=processes)
        begin, done = time.perf_counter(), 0
        for number, _ in enumerate(sweep.computed()):
            if number == 0:
                begin = time.perf_counter()
            done = number
        seconds = time.perf_counter() - begin
        sweep.finish()
        print(f"| {processes} | {done} | {seconds:.1f} | {60.0 * done / max(seconds, 1e-9):.0f} |", flush=True)
    for processes in (1, 2):
        rows = list(Stored(out / f"by-{processes}" / "rows").rows())
        kept = [row for row in rows if row["status"] == "finished"][1:]
        member_s, course_s = (np.array([row[name] for row in kept], dtype=float) for name in ("member_s", "course_s"))
        print(
            f"{processes}: a member takes {1e3 * np.median(member_s):.1f} ms, its steps {1e3 * np.median(course_s):.1f} ms; "
            f"{100 * (1 - course_s.sum() / member_s.sum()):.0f} % is spent beside them"
        )
        statuses = [str(row["status"]) for row in rows]
        print({status: statuses.count(status) for status in set(statuses)})


def braced(out: Path, share: float) -> None:
    lines = np.array(list(itertools.product(*([part * force for part in SHARES] for force in LARGEST_N.values()))))
    if share < 1.0:
        lines = lines[np.sort(np.random.default_rng(SEED).permutation(len(lines))[: round(share * len(lines))])]
    sweep = explicitfe.sweep(
        SCENARIO, table=table(out, lines), out=out / "sweep", measures=["contact", "constriction", "points", "grooves"]
    )
    begin = time.perf_counter()
    for number, _ in enumerate(sweep.computed(), 1):
        if number % 500 == 0:
            print(f"{number} of {len(sweep)}, {60.0 * number / (time.perf_counter() - begin):.0f} a minute", flush=True)
    summary = sweep.finish()
    print(summary["statuses"], summary["failures"])
    rows = [row for row in Stored(out / "sweep" / "rows").rows() if row["status"] == "finished"]
    finished = [row["member"] for row in rows]
    is_braced = np.array([_is_braced(row) for row in rows])
    on = lines[finished] > 0.0
    print(f"{is_braced.sum()} of {len(finished)} are braced with a free midline")
    print("| muscle | on, of the braced | on, of all |\n|---|---|---|")
    for k, name in enumerate(LARGEST_N):
        print(f"| {name} | {100 * on[is_braced, k].mean():.0f} % | {100 * on[:, k].mean():.0f} % |")


def _is_braced(row: dict) -> bool:
    """Both sides touch the palate in the middle or at the back, and nothing touches within 3 mm of the midline."""
    sides = [
        max(row[f"contact.palate.cells.{side}.{depth}.area_mm2"] for depth in ("middle", "back")) > 0.0
        for side in ("left", "right")
    ]
    return all(sides) and bool(row["contact.palate.midline_free"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("pace", "braced"))
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--share", type=float, default=0.1)
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    if options.what == "pace":
        pace(options.out, options.count)
    else:
        braced(options.out, options.share)


if __name__ == "__main__":
    main()
