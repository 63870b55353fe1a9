"""Runs close-loop on sealed cases and judges the verdicts.

    python -m studies.moving.judge CASES [--minutes 4] [--only case-03 ...]

Each case has MINUTES of CPU time of one core.

A verdict is right if it names the hidden cause and no other, ambiguous with the true one if the hidden cause is among those that
it names or leaves undecided, silent if a control ends without an effect, missed if nothing is claimed where something is hidden
or something is left unexplained, and wrong if it claims only causes that are not hidden. CASES/verdicts.json has all of them.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from explicitfe.inverse.close_loop.close import find_causes
from explicitfe.platform.errors import InputError, RunError


def judged(verdict: str, named: set[str], undecided: set[str], hidden: str) -> str:
    """The judgement of one verdict."""
    if hidden == "none":
        if verdict == "effect-found":
            return "wrong"
        return "silent" if not named else "ambiguous"
    if verdict == "effect-found":
        return "right" if named == {hidden} else "ambiguous" if hidden in named else "wrong"
    if verdict == "ambiguous":
        return "ambiguous" if hidden in named | undecided else "missed"
    return "missed"


def run_case(folder: Path, hidden: str, minutes: float) -> dict[str, object]:
    """The verdict on one case."""
    # The limit is one of CPU time: other work on the machine changes no verdict.
    time.perf_counter = time.process_time
    begin = time.perf_counter()
    try:
        report = find_causes(folder, processes=1, minutes=minutes).report
    except (InputError, RunError) as error:
        return {"verdict": "failed", "judgement": "missed", "message": str(error), "seconds": time.perf_counter() - begin}
    present = {name for name, one in report.causes.items() if one.decision == "present"}
    undecided = {name for name, one in report.causes.items() if one.decision == "undecided"}
    errors = {
        side: {k: getattr(v, "nrmse", None) for k, v in getattr(report, side).error.curves.items()}
        for side in ("baseline", "final")
    }
    return {
        "verdict": report.verdict,
        "present": sorted(present),
        "undecided": sorted(undecided),
        "judgement": judged(str(report.verdict), present, undecided, hidden),
        "sure": report.sure,
        "posterior": dict(list(report.posterior.items())[:4]),
        "something_else": report.something_else,
        "final": {name: getattr(e, "value", None) for name, e in report.final.parameters.items()},
        "errors": errors,
        "seconds": time.perf_counter() - begin,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=Path)
    parser.add_argument("--minutes", type=float, default=4.0)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    truth = json.loads((options.cases / "truth.json").read_text(encoding="utf-8"))
    wanted = options.only or list(truth)
    path = options.cases / "verdicts.json"
    verdicts = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    with ProcessPoolExecutor(options.processes) as pool:
        jobs = {pool.submit(run_case, options.cases / name, truth[name]["cause"], options.minutes): name for name in wanted}
        for job in as_completed(jobs):
            name, one = jobs[job], job.result()
            verdicts[name] = one
            path.write_text(json.dumps(verdicts, indent=1) + "\n", encoding="utf-8")
            print(
                f"{name} {truth[name]['kind']:18} {truth[name]['strength']:8.3g}  {one['judgement']:10} {one['verdict']:18} "
                f"{one.get('present')} {one.get('undecided')} {one['seconds']:.0f} s",
                flush=True,
            )
    print(Counter(one["judgement"] for name, one in verdicts.items() if name in wanted))


if __name__ == "__main__":
    main()
