"""Write the report of one or several results as one HTML file, which needs neither a network nor other files."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from typing_extensions import TypedDict

from explicitfe.app.view.heading import labels_of
from explicitfe.app.view.page.frame import page_text
from explicitfe.app.view.page.page_file import page_file, write_page
from explicitfe.app.view.page.run.charts import charts_of
from explicitfe.app.view.page.run.parts import RunOnPage, differences, run_on_page, table_of_runs
from explicitfe.app.view.page.tables import PageTable, table
from explicitfe.platform.errors import InputError, Progress, silent
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.steps import last_step

# More results would be too narrow to be seen, and more animations than a browser draws.
MOST_RESULTS = 8


class ReportedRun(TypedDict):
    """One result of a report.

    ``checks_passed`` is true if the run finished and its checks gave no warning; ``reasons`` are the checks that failed.
    ``quotable`` is the earlier name of ``checks_passed``.
    """

    result: str
    checks_passed: bool
    quotable: bool
    reasons: list[str]
    frames: int


class ReportAnswer(TypedDict):
    """What ``explicitfe report`` wrote: ``differing_keys`` are keys whose values differ between the scenarios, in their order."""

    report: str
    size_MB: float
    results: list[ReportedRun]
    differing_keys: list[str]


def write_report(
    paths: Sequence[Path], out: Path | None = None, *, overwrite: bool = False, progress: Progress = silent
) -> ReportAnswer:
    """Write the report of results.

    Parameters
    ----------
    paths : the results, of runs that finished, failed or were killed.
    out : the page; ``<stem>-report.html`` in the folder of the first result by default.
    overwrite : replace an existing page.
    progress : called with the stage and the completed share of it.

    Raises
    ------
    InputError : a result cannot be read or has no sample that can be drawn; the page exists, or its folder cannot be written.
    MachineError : the disk is full.
    """
    paths = [Path(path) for path in paths]
    if len(paths) > MOST_RESULTS:
        raise InputError(f"a report shows at most {MOST_RESULTS} results side by side, not {len(paths)}; leave out some of them.")
    target = page_file(paths[0].with_name(f"{paths[0].stem}-report.html"), out, overwrite)
    with ExitStack() as opened:
        page = _page([opened.enter_context(open_result(path)) for path in paths], progress)
    size_MB = write_page(target, page.text)
    progress("draw", 1.0)
    return {
        "report": str(target),
        "size_MB": size_MB,
        "results": [
            {
                "result": str(path),
                "checks_passed": run.checks.all_passed,
                "quotable": run.checks.all_passed,
                "reasons": run.checks.failed,
                "frames": run.frames,
            }
            for path, run in zip(paths, page.runs, strict=True)
        ],
        "differing_keys": [str(row.cells[0]) for row in page.differing.rows] if page.differing else [],
    }


def report_text(results: Sequence[Result]) -> str:
    """The HTML page of open results.

    Raises
    ------
    InputError : a result has no sample that can be drawn.
    """
    return _page(results, silent).text


class _Page(NamedTuple):
    """The page, and what the answer of the command needs of it."""

    text: str
    runs: list[RunOnPage]
    differing: PageTable | None


def _page(results: Sequence[Result], progress: Progress) -> _Page:
    runs: list[RunOnPage] = []
    measured = [measures_of(one, last_step(one)) if kind_of(one.model) == "transient" else None for one in results]
    labels, charts = labels_of([result.path for result in results]), charts_of(results, measured)
    for result, measures, label, own in zip(results, measured, labels, charts, strict=True):
        progress("draw", len(runs) / len(results))
        runs.append(run_on_page(result, measures, label, own, 1.0 / len(results)))
    differing = differences([result.model.get("scenario", {}) for result in results], [run.label for run in runs])
    text = page_text(
        "page/run/page.html.j2",
        styles=["page/run/run.css"],
        scripts=["page/run/three/three.min.js", "page/run/scene.js", "page/run/player.js"],
        title=runs[0].title if len(runs) == 1 else f"{len(runs)} runs side by side: {', '.join(run.label for run in runs)}",
        runs=runs,
        differing=differing,
        facts=table_of_runs(runs, [run.facts if run.speech else {**run.facts, **run.numerical} for run in runs]),
        numerical=[table(("", ""), list(run.numerical.items()), "tt") for run in runs],
        provenance=table_of_runs(runs, [run.provenance for run in runs]),
    )
    return _Page(text, runs, differing)
