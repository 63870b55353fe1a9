"""What proposed tests are worth: cases of blind sets that were not settled, with up to two tests that the report proposes, and
with random ones of the same cost.

    python studies/benchmarks/next_test_study.py FOLDER... [--most 20] [--seed 0] [--tests 2]

Each FOLDER is a set of homogeneous cases, of either family, that the blind study has scored. A case with an effect that
came out ambiguous, missed or unexplained gets a further test of the same truth, and the loop is closed on all of them; then once
more, unless an effect was found that leaves no more than noise. Beside it stands the same with random tests: programmes drawn as
those of the sets are, within the same room, until they have cost as many minutes. Controls get the same.

Not every case can be settled. One can be if all possible tests together, with as many rows as two of them made five times, keep
the truth 25 away from the law alone and from every rival: by the generator's numerics, before the tool sees any of them. The
others are counted apart.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from explicitfe.app.api.inverse import close_loop
from explicitfe.inverse.close_loop.next_test import TRIED_REPEATS, reported_programme
from explicitfe.inverse.close_loop.proposals import ProposedCurve, proposals, room_of
from explicitfe.inverse.close_loop.specimens.series import rest_of
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.tables import RigLimits
from explicitfe.results.documents.loop_report import LoopReport
from studies.blind.again import distance_with, measure_again
from studies.blind.identifiable import SMALLEST_IDENTIFIABLE_DISTANCE
from studies.blind.outcome import ALARMS, outcome
from studies.blind.protocols import draw_protocol
from studies.blind.tables import proportion

UNSETTLED = ("ambiguous, true named", "ambiguous, true not named", "ambiguous", "missed", "unexplained")
SETTLED = ("right", "both")
RIG = RigLimits()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--most", type=int, default=20, help="cases of a folder, and as many controls")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", type=int, default=2)
    options = parser.parse_args()
    rows = []
    for folder in options.folders:
        scored = json.loads((folder / "score.json").read_text(encoding="utf-8"))["cases"]
        effects = [c["case"] for c in scored if c["kind"] in ("single", "double") and c["outcome"] in UNSETTLED]
        controls = [c["case"] for c in scored if c["kind"] == "control" and c["outcome"] not in ALARMS]
        for name in [*effects[: options.most], *controls[: options.most]]:
            rows.append(compared(folder, name, options.seed, options.tests))
            print(json.dumps(rows[-1]), flush=True)
            (folder / "next-tests.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(table(rows))


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown: how many came out right, with binomial 95 % intervals."""
    groups = {
        "unsettled, two tests could settle it": [r for r in rows if r["kind"] != "control" and r["possible"]],
        "unsettled, they could not": [r for r in rows if r["kind"] != "control" and not r["possible"]],
        "controls (silent)": [r for r in rows if r["kind"] == "control"],
    }
    lines = [
        "| cases | number | after one proposed test | after two | after random tests of the same cost |",
        "|---|---|---|---|---|",
    ]
    for words, group in groups.items():
        if group:
            ends = [[row["proposed"][:1], row["proposed"], row["random"]] for row in group]
            cells = [_share(column, group) for column in zip(*ends, strict=True)]
            lines.append(f"| {words} | {len(group)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _share(ends: tuple[list[str], ...], group: list[dict[str, Any]]) -> str:
    """How many are right by the last of their outcomes, or silent."""
    words = [(end or [row["before"]])[-1] for end, row in zip(ends, group, strict=True)]
    good = sum(
        word in SETTLED or (row["kind"] == "control" and word not in ALARMS) for word, row in zip(words, group, strict=True)
    )
    share = proportion(good, len(words))
    low, high = share["ci95"]
    return f"{good} ({100.0 * share['share']:.0f} %, {100.0 * low:.0f} to {100.0 * high:.0f})"


def compared(folder: Path, name: str, seed: int, tests: int) -> dict[str, Any]:
    """Outcome after each added test, by the proposals and at random."""
    truth = json.loads((folder / "sealed" / f"{name}.json").read_text(encoding="utf-8"))
    case = folder / "cases" / name
    begin = time.perf_counter()
    before = close_loop(case, processes=1)
    curves = read_dataset(case).curves
    fitted = [c for c in curves if c.id in before.split.fit]
    row: dict[str, Any] = {"case": name, "kind": truth["kind"], "true": sorted(truth["effects"]), "mode": truth["mode"]}
    row |= {"protocol": truth["protocol"], "family": truth["family"], "before": outcome(before.document, truth)}
    if truth["kind"] != "control":
        possible = [p.curve for p in proposals(tuple(fitted), RIG)]
        distance = distance_with(truth, fitted, possible, tests * max(TRIED_REPEATS) / len(possible))
        row |= {"distance": distance, "possible": distance >= SMALLEST_IDENTIFIABLE_DISTANCE}
    row |= _proposed(case, truth, before, np.random.default_rng([seed, int(name[-4:])]), tests)
    row |= _random(case, truth, before, np.random.default_rng([seed + 1, int(name[-4:])]), row["minutes"], tuple(fitted))
    return row | {"wall_s": time.perf_counter() - begin}


def _settled(report: LoopReport) -> bool:
    return report.verdict == "effect-found" and report.remainder == "at-floor"


def _proposed(case: Path, truth: Any, report: LoopReport, rng: np.random.Generator, tests: int) -> dict[str, Any]:
    words: list[str] = []
    names: list[str] = []
    minutes = 0.0
    with tempfile.TemporaryDirectory() as base:
        added: list[Path] = []
        while len(added) < tests and report.proposed_tests and not (added and _settled(report)):
            proposal = report.proposed_tests[0]
            minutes += proposal.minutes or 0.0
            names.append(f"{proposal.protocol}: {proposal.information_bits:.2f} bits")
            like = f"added-{len(added) + 1}"
            measure_again(rng, truth, proposal, Path(base) / like, like)
            added.append(Path(base) / like)
            report = close_loop(case, add=added, processes=1)
            words.append(outcome(report.document, truth))
    named = [*report.effects, *report.ambiguous_with]
    return {"proposed": words, "tests": names, "minutes": minutes, "named": named, "sure": report.sure}


def _random(
    case: Path, truth: Any, report: LoopReport, rng: np.random.Generator, minutes: float, curves: tuple[Curve, ...]
) -> dict[str, Any]:
    """The outcome with as many random tests as cost the same; the last of them may cost a little more."""
    if minutes == 0.0:
        return {"random": []}
    spent = 0.0
    with tempfile.TemporaryDirectory() as base:
        added: list[Path] = []
        while spent < minutes:
            test = ProposedCurve("random", random_curve(rng, truth, curves))
            spent += test.minutes(RIG)
            like = f"added-{len(added) + 1}"
            measure_again(rng, truth, reported_programme(test, 1), Path(base) / like, like)
            added.append(Path(base) / like)
        report = close_loop(case, add=added, processes=1)
    return {"random": [outcome(report.document, truth)], "random_tests": len(added)}


def random_curve(rng: np.random.Generator, truth: Any, curves: tuple[Curve, ...]) -> Curve:
    """A curve drawn as those of the sets are, at most at the load of the room, on the specimen of one of the curves."""
    source = curves[rng.integers(len(curves))]
    room = room_of(curves, RIG)
    while True:
        protocol = draw_protocol(rng, platen=truth["mode"] == "platen")
        if (protocol.mode, protocol.test) == (truth["mode"], truth["test"]):
            break
    run = protocol.plan[rng.integers(len(protocol.plan))]
    rest = rest_of(source)
    own = programme_of(source) - rest
    height_m = 1e-3 * source.specimen.height_mm if source.specimen is not None and source.specimen.height_mm else 1.0
    load = np.abs(run.imposed - rest) * (height_m / run.height_m if truth["mode"] == "platen" else 1.0)
    load *= min(1.0, room.load / float(load.max()))
    imposed = rest + np.sign(own[np.argmax(np.abs(own))]) * load
    columns = {name: imposed if name == source.imposed else load for name in source.columns}  # what is predicted is not read
    return replace(source, time_s=run.time_s, columns=columns)


if __name__ == "__main__":
    main()
