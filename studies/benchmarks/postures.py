"""Many postures: how fast members are computed, what of that is no step, and which muscles are on where a tongue is braced.

    python studies/benchmarks/postures.py pace OUT [--count 2000]  # random postures by one and two processes
    python studies/benchmarks/postures.py braced OUT [--share 0.1]  # 0, 10, 25 % of ten muscles: 59 049 members
    python studies/benchmarks/postures.py braced OUT --compressible   # with the compressibility of Liu et al.
    python studies/benchmarks/postures.py counted OUT                 # the tables of what a braced one has computed so far

The tables that they print are those of docs/studies/sweeps.md. What is computed stays in OUT: given again, it goes on.
"""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections import Counter
from pathlib import Path

import numpy as np
from bracing import bracing

import explicitfe
from explicitfe.simulate.sweep.journal import Stored

SCENARIO = Path(__file__).with_name("postures.toml")
# Largest forces of both sides, N, of the model that Liu et al. (2022) ran, by 22 N/cm2. Their GGP is GGp and GGh here.
LARGEST_N = {
    "GGa": 18.0, "GGm": 12.0, "GGp": 24.7, "GGh": 12.3, "STY": 24.0, "HG": 65.0,
    "VERT": 20.0, "TRANS": 50.0, "IL": 9.0, "SL": 19.0, "MH": 39.0,
}  # fmt: skip
MUSCLES = [name for name in LARGEST_N if name != "GGh"]  # it has the share of GGp
SHARES = (0.0, 0.10, 0.25)
# As Liu et al. had it in one of their two conditions: the jaw 5 mm open, and a hyoid bone that gives way.
AS_PUBLISHED = ["jaw={opening_mm=5}", "hyoid={}"]
# Muscle on in so many %, of their braced postures at 5 and 10 mm.
PUBLISHED = {
    "GGp": "98 to 100", "HG": "0 to 2", "TRANS": "1 to 9", "MH": "86 to 100", "GGa": "51 to 54", "GGm": "77 to 80",
    "VERT": "72 to 75", "IL": "62 to 67", "SL": "87 to 95", "STY": "21 to 36",
}  # fmt: skip
# The tongue of ArtiSynth has a bulk modulus of 10 C10 (HexTongueDemo.java), a Poisson's ratio of 0.406, and stiffens where a
# muscle is active.
COMPRESSIBLE = [
    "model.material={law='yeoh', C10_Pa=1037, C20_Pa=486, poisson=0.406}",
    "model.activation_stiffening=true",
]
LEAST_PLACES = (1, 2, 3, 4, 5, 6)  # of the eleven on either side; one is what they ask
SEED = 2022


def table(out: Path, shares: np.ndarray) -> Path:
    """A table of members, from the share of each of ``MUSCLES``."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "postures.csv"
    of_muscle = dict(zip(MUSCLES, shares.T, strict=True))
    forces = np.column_stack([of_muscle["GGp" if name == "GGh" else name] * force for name, force in LARGEST_N.items()])
    keys = ",".join(f"muscle.{name}.force_N" for name in LARGEST_N)
    path.write_text("\n".join([keys, *(",".join(f"{force:.6g}" for force in line) for line in forces)]) + "\n", encoding="utf-8")
    return path


def pace(out: Path, count: int) -> None:
    rng = np.random.default_rng(SEED)
    shape = (count, len(MUSCLES))
    lines = rng.uniform(0.0, 0.25, shape) * (rng.random(shape) < 0.4)
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


def combinations(share: float) -> np.ndarray:
    """All combinations of ``SHARES`` in an order by chance, or the first of them: what is computed first is a random share."""
    lines = np.array(list(itertools.product(SHARES, repeat=len(MUSCLES))))
    return lines[np.random.default_rng(SEED).permutation(len(lines))[: round(share * len(lines))]]


def braced(out: Path, share: float, duration_ms: float, more: list[str]) -> None:
    sweep = explicitfe.sweep(
        SCENARIO,
        table=table(out, combinations(share)),
        out=out / "sweep",
        settings=[*AS_PUBLISHED, f"analysis.duration_ms={duration_ms:g}", *more],
        measures=["points", "contact", "contour", bracing],
    )
    begin = time.perf_counter()
    for number, _ in enumerate(sweep.computed(), 1):
        if number % 500 == 0:
            print(f"{number} of {len(sweep)}, {60.0 * number / (time.perf_counter() - begin):.0f} a minute", flush=True)
    summary = sweep.finish()
    print(summary["statuses"], summary["failures"])
    counted(out)


def counted(out: Path) -> None:
    """How members ended, and which muscles are on where the tongue is braced: where so many places are touched on either side."""
    rows = list(Stored(out / "sweep" / "rows").rows())
    print(
        dict(Counter(str(row["status"]) for row in rows)),
        f"{sum(bool(row.get('folded_elements')) for row in rows)} have folded elements",
    )
    rows = [row for row in rows if row["status"] == "finished"]
    on = combinations(1.0)[[row["member"] for row in rows]] > 0.0
    touched = np.array([[row[f"bracing.{group}.touched"] for group in ("left", "right", "middle")] for row in rows])
    print(f"{(touched[:, 2] > 0).sum()} touch around the midline in front")
    chosen = {"all": np.ones(len(rows), dtype=bool)}
    chosen |= {f"{places} or more": touched[:, :2].min(axis=1) >= places for places in LEAST_PLACES}
    heads = [f"{name} ({some.sum()}, {100 * some.mean():.1f} %)" for name, some in chosen.items()]
    print(f"| muscle on, % | {' | '.join(heads)} | Liu et al. |\n{'|---' * (len(chosen) + 2)}|")
    for k, name in enumerate(MUSCLES):
        print(f"| {name} | {' | '.join(_percent(on[some, k]) for some in chosen.values())} | {PUBLISHED.get(name, '')} |")


def _percent(on: np.ndarray) -> str:
    """A share with its standard error."""
    return f"{100 * on.mean():.0f} ± {100 * np.sqrt(on.mean() * (1 - on.mean()) / len(on)):.1f}" if len(on) else "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("pace", "braced", "counted"))
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--share", type=float, default=1.0, help="of all combinations, by chance")
    parser.add_argument("--duration-ms", type=float, default=120.0, help="of a braced posture")
    parser.add_argument("--compressible", action="store_true", help="Poisson's ratio 0.406 and stiffening, as in ArtiSynth")
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    if options.what == "pace":
        pace(options.out, options.count)
    elif options.what == "braced":
        braced(options.out, options.share, options.duration_ms, COMPRESSIBLE if options.compressible else [])
    else:
        counted(options.out)


if __name__ == "__main__":
    main()
