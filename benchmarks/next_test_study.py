"""What proposed tests are worth: cases of a blind set that were not settled, with up to two tests that the report proposes, and
with random ones of the same cost.

    python benchmarks/next_test_study.py FOLDER [--most 20] [--seed 0] [--tests 2]

FOLDER is a homogeneous set that `explicitfe blind score` has scored. Each case with an effect that did not come out right gets a
further test of the same truth, and the loop is closed on both; then once more, unless an effect was found that leaves no more
than noise. Beside it stands the same with tests that are drawn from all that are possible, until they have cost as many minutes.
Controls get the same, so that false alarms show.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from explicitfe.blind.again import measure_again
from explicitfe.blind.outcome import ALARMS, outcome
from explicitfe.close_loop.close import close_loop
from explicitfe.close_loop.next_test import reported_programme
from explicitfe.close_loop.proposals import proposals
from explicitfe.measured.read import read_dataset
from explicitfe.measured.rig import RigLimits

UNSETTLED = ("ambiguous, true named", "ambiguous, true not named", "ambiguous", "missed", "unexplained", "one, said to be all")
SETTLED = ("right", "both")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--most", type=int, default=20, help="cases, and as many controls")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", type=int, default=2)
    options = parser.parse_args()
    scored = json.loads((options.folder / "score.json").read_text(encoding="utf-8"))["cases"]
    effects = [c["case"] for c in scored if c["kind"] in ("single", "double") and c["outcome"] in UNSETTLED]
    controls = [c["case"] for c in scored if c["kind"] == "control" and c["outcome"] not in ALARMS]
    rows = []
    for kind, names in (("unsettled", effects), ("control", controls)):
        for name in names[: options.most]:
            rows.append({"case": name, "kind": kind} | _compare(options.folder, name, options.seed, options.tests))
            print(rows[-1], flush=True)
            (options.folder / "next-tests.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    for kind in ("unsettled", "control"):
        group = [row for row in rows if row["kind"] == kind]
        for plan in ("proposed", "random"):
            words = [row[plan][-1] if row[plan] else row["before"] for row in group]
            settled = sum(word in SETTLED or (kind == "control" and word not in ALARMS) for word in words)
            print(f"{kind}, {plan}: {settled} of {len(group)}")


def _compare(folder: Path, name: str, seed: int, tests: int) -> dict[str, object]:
    """Outcome after each added test, by the proposals and at random."""
    truth = json.loads((folder / "sealed" / f"{name}.json").read_text(encoding="utf-8"))
    case = folder / "cases" / name
    before = close_loop(case, processes=1)
    words: dict[str, list[str]] = {"proposed": [], "random": []}
    minutes = 0.0
    for plan in words:
        rng = np.random.default_rng([seed, int(name[-4:])])
        spent, report = 0.0, before
        with tempfile.TemporaryDirectory() as base:
            added: list[Path] = []
            while True:
                if added and report.verdict == "effect-found" and report.remainder == "at-floor":
                    break
                if plan == "proposed":
                    if len(added) == tests or not report.proposed_tests:
                        break
                    proposal = report.proposed_tests[0]
                    minutes += proposal.minutes or 0.0
                else:
                    possible = list(proposals(read_dataset(case).curves, RigLimits()))
                    choice = possible[rng.integers(len(possible))]
                    proposal = reported_programme(choice, 1)
                    if spent >= minutes:
                        break
                    spent += choice.minutes(RigLimits())
                like = f"added-{len(added) + 1}"
                measure_again(rng, truth, proposal, Path(base) / like, like)
                added.append(Path(base) / like)
                report = close_loop(case, add=added, processes=1)
                words[plan].append(outcome(report.document, truth))
    return {"true": sorted(truth["effects"]), "before": outcome(before.document, truth), **words, "minutes": minutes}


if __name__ == "__main__":
    main()
