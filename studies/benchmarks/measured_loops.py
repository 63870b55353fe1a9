"""What the closed loop says of measured data, as a table.

    python studies/benchmarks/measured_loops.py DATASET ... [--constants-by KEY] [--json FILE]

A row a dataset: verdict, errors of fitted and of held-out curves before and after, and the law that was composed where something
is left that no named effect explains. The reference page on close-loop prints what it has shown.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from explicitfe import close_loop
from explicitfe.results.documents.loop_report import LoopReport, MeanError

HEAD = ("dataset", "verdict", "fitted, %", "held out, %", "composed law: held out, left out, %", "s")


def percent(error: MeanError | float | None) -> str:
    value = error.nrmse if isinstance(error, MeanError) else error
    return "–" if value is None else f"{100.0 * value:.2f}"


def row(report: LoopReport, seconds: float) -> tuple[str, ...]:
    """One line of the table."""
    first, last = report.baseline.error, report.final.error
    verdict = f"{report.verdict}: {', '.join(report.effects) or '–'}; left: {report.remainder}"
    law = report.discovered_law
    return (
        str(report.dataset),
        verdict,
        f"{percent(first.fit)} → {percent(last.fit)}",
        f"{percent(first.holdout)} → {percent(last.holdout)}",
        "–" if law is None else f"{percent(law.error_holdout)}, {percent(law.cv_nrmse)}: {law.text}",
        f"{seconds:.0f}",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+")
    parser.add_argument("--constants-by")
    parser.add_argument("--json", help="file for the reports")
    options = parser.parse_args()
    reports = []
    print(f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}", flush=True)
    for dataset in options.datasets:
        begin = time.perf_counter()
        reports.append(close_loop(dataset, constants_by=options.constants_by, processes=1))
        print(f"| {' | '.join(row(reports[-1], time.perf_counter() - begin))} |", flush=True)
    if options.json:
        documents = [json.loads(report.text) for report in reports]
        Path(options.json).write_text(json.dumps(documents), encoding="utf-8")


if __name__ == "__main__":
    main()
