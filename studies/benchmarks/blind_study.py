"""The blind study: cases with a sealed truth, the loop closed on each, and the tables.

    python studies/benchmarks/blind_study.py OUT [--seed 2026] [--processes 2] [--limit 1800] [--small] [--only homogeneous]

OUT receives a folder for each set, with its cases, reports, score.json, score.md and confusion.png; tables.md holds all of them.
Cases and reports that exist are kept, so that a stopped study goes on. The family "foreign" is two sets, its closed forms and its
solver, because a case of the solver takes ten times as long to make and to judge. Of their cases with an effect only those are
judged that the generator's own numerics can tell from all rivals (--all judges the others too). Making the cases takes about
half an hour for each set on one core, an hour and a half for the solver; the tables say how long the tool takes.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.foreign import family as foreign
from studies.blind.make import make
from studies.blind.score import score

STUDY = {
    "homogeneous": {"control": 100, "single": 300, "double": 30, "outside": 24},
    "indentation": {"control": 16, "single": 26},
    "foreign-closed": {"control": 60, "single": 90, "double": 21, "outside": 100},
    "foreign-solver": {"control": 48, "single": 90, "double": 4, "outside": 9},
}
EVERY_CHOICE = foreign.choices
FEWER_CASES = 10  # A small study has so many times fewer cases.


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--limit", type=float, default=None, help="seconds after which a case is stopped")
    parser.add_argument("--small", action="store_true", help=f"{FEWER_CASES} times fewer cases")
    parser.add_argument("--only", choices=STUDY)
    parser.add_argument("--all", action="store_true", help="judge also what the data cannot tell")
    options = parser.parse_args()
    texts = []
    for family, kinds in STUDY.items():
        if options.only not in (None, family):
            continue
        folder = options.out / family
        if options.small:
            kinds = {kind: max(number // FEWER_CASES, 1) for kind, number in kinds.items()}
        progress = _progress(family)
        name, _, source = family.partition("-")
        foreign.choices = _choices_of(source)
        make(folder, seed=options.seed, kinds=kinds, family=name, processes=options.processes, progress=progress)
        judged = folder if options.all or not source else _that_can_be_told(folder)
        score(judged, processes=options.processes, limit_s=options.limit, pages=False, progress=progress)
        texts.append(f"<!-- {family}, seed {options.seed} -->\n{(judged / 'score.md').read_text(encoding='utf-8')}")
    (options.out / "tables.md").write_text("\n".join(texts), encoding="utf-8")


def _choices_of(source: str) -> Callable[[str], list[tuple[str, ...]]]:
    """What the foreign family can hide, in tests by the solver, by closed forms, or by both."""
    by_solver = {"solver": (True,), "closed": (False,)}.get(source, (True, False))
    return lambda kind: [one for one in EVERY_CHOICE(kind) if one[0].startswith(foreign.TOOL_PREFIX) in by_solver]


def _that_can_be_told(folder: Path) -> Path:
    """A copy of the cases without those singles and doubles that nobody could tell from something else."""
    judged = folder / "judged"
    for sealed in sorted((folder / "sealed").glob("case-*.json")):
        case = judged / "cases" / sealed.stem
        if json.loads(sealed.read_text(encoding="utf-8"))["identifiable"] is not False and not case.is_dir():
            (judged / "sealed").mkdir(parents=True, exist_ok=True)
            shutil.copy(sealed, judged / "sealed")
            shutil.copytree(folder / "cases" / sealed.stem, case)
    return judged


def _progress(family: str):
    return lambda stage, share: print(f"{family}: {stage} {100.0 * share:.0f} %", flush=True)


if __name__ == "__main__":
    main()
