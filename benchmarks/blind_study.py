"""The blind study: cases with a sealed truth, the loop closed on each, and the tables.

    python benchmarks/blind_study.py OUT [--seed 2026] [--processes 2] [--limit 1800] [--small] [--only homogeneous]

OUT receives a folder for each family, with its cases, reports, score.json, score.md and confusion.png; tables.md holds all
families. Cases and reports that exist are kept, so that a stopped study goes on. Making the cases takes about half an hour for
each family on one core; the tables say how long the tool takes.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from explicitfe.blind.make import MANIFEST, make
from explicitfe.blind.score import score

STUDY = {
    "homogeneous": {"control": 100, "single": 300, "double": 30, "outside": 24},
    "indentation": {"control": 16, "single": 26},
    "foreign": {"control": 100, "single": 184, "double": 33, "outside": 110},
}
FEWER_CASES = 10  # A small study has so many times fewer cases.


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--limit", type=float, default=None, help="seconds after which a case is stopped")
    parser.add_argument("--small", action="store_true", help=f"{FEWER_CASES} times fewer cases")
    parser.add_argument("--only", choices=STUDY)
    options = parser.parse_args()
    texts = []
    for family, kinds in STUDY.items():
        if options.only not in (None, family):
            continue
        folder = options.out / family
        if options.small:
            kinds = {kind: max(number // FEWER_CASES, 1) for kind, number in kinds.items()}
        progress = _progress(family)
        if not (folder / MANIFEST).is_file():
            make(folder, seed=options.seed, kinds=kinds, family=family, processes=options.processes, progress=progress)
        score(folder, processes=options.processes, limit_s=options.limit, progress=progress)
        texts.append(f"<!-- {family}, seed {options.seed} -->\n{(folder / 'score.md').read_text(encoding='utf-8')}")
    (options.out / "tables.md").write_text("\n".join(texts), encoding="utf-8")


def _progress(family: str):
    return lambda stage, share: print(f"{family}: {stage} {100.0 * share:.0f} %", flush=True)


if __name__ == "__main__":
    main()
