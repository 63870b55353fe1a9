"""Enter explicitfe: run ``explicitfe close-loop`` on every case of a set, and write the answers as score.py reads them.

    python enter.py SET --out answers/explicitfe.json --processes 2 --limit 1200

Of the report only the keys verdict, effects, posterior, something_else and final.parameters are read. An interrupted command
resumes. A case that exceeds the limit of seconds counts as failed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from causes import causes_of
from score import OTHER, VERDICTS

from explicitfe.results.files.folder import whole_file

NOTHING_OF_POSTERIOR, OTHER_OF_POSTERIOR = "nothing", ("other", "something else", "something-else")


def answer_of(report: dict[str, Any]) -> dict[str, Any]:
    """The answer that a report of close-loop contains."""
    verdict = report.get("verdict", "failed")
    answer: dict[str, Any] = {"verdict": verdict if verdict in VERDICTS else "failed"}
    answer["causes"] = sorted(causes_of(report.get("effects") or ()))
    sets: dict[frozenset[str], float] = {}
    for label, probability in (report.get("posterior") or {}).items():
        if not isinstance(probability, int | float):
            continue
        if label == NOTHING_OF_POSTERIOR:
            names: frozenset[str] = frozenset()
        elif label in OTHER_OF_POSTERIOR:
            names = frozenset({OTHER})
        else:
            names = causes_of(name.strip() for name in label.split("+"))
        sets[names] = sets.get(names, 0.0) + float(probability)
    ordered = sorted(sets.items(), key=lambda entry: -entry[1])
    answer["probabilities"] = [{"causes": sorted(names), "probability": min(p, 1.0)} for names, p in ordered]
    parameters = ((report.get("final") or {}).get("parameters") or {}).items()
    answer["parameters"] = {
        name: entry["ci95"]
        for name, entry in parameters
        if isinstance(entry, dict) and isinstance(entry.get("ci95"), list) and len(entry["ci95"]) == 2
    }
    return answer


def run_one(case: Path, limit_s: float) -> dict[str, Any]:
    """The answer to one case, from a process of its own."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "explicitfe", "close-loop", str(case), "--out", f"{folder}/report", "--json"]
        try:
            run = subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False, cwd=folder)
            report = json.loads(run.stdout)
            answer = answer_of(report)
        except subprocess.TimeoutExpired:
            answer = {"verdict": "failed", "message": f"no end in {limit_s:g} s"}
        except (ValueError, AttributeError):
            answer = {"verdict": "failed", "message": run.stderr[-500:]}
    return answer | {"seconds": round(time.perf_counter() - begin, 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--limit", type=float, default=1200.0, help="seconds for a case")
    options = parser.parse_args()
    entry: dict[str, Any] = {"program": "explicitfe close-loop", "cases": {}}
    if options.out.exists():
        entry = json.loads(options.out.read_text(encoding="utf-8"))
    cases = sorted(path.parent.resolve() for path in options.set.glob("case-*/dataset.toml"))
    todo = [case for case in cases if case.name not in entry["cases"]]
    with ThreadPoolExecutor(options.processes) as pool:
        futures = {pool.submit(run_one, case, options.limit): case for case in todo}
        for done, future in enumerate(as_completed(futures), start=len(cases) - len(todo) + 1):
            entry["cases"][futures[future].name] = future.result()
            options.out.parent.mkdir(parents=True, exist_ok=True)
            whole_file(options.out, json.dumps(entry, indent=1) + "\n")
            print(f"\r{done} of {len(cases)} cases", end="", flush=True)
    print()


if __name__ == "__main__":
    main()
