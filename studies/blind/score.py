"""Run the tool on every case and score it: the sealed files are opened only when all reports are written."""

from __future__ import annotations

import json
import multiprocessing
import os
import shlex
import time
import traceback
from contextlib import suppress
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import cast

from typing_extensions import TypedDict

from explicitfe.inverse.close_loop.report import SUMMARY
from explicitfe.platform.errors import InputError, Progress, counted, silent
from explicitfe.platform.host import stopping
from explicitfe.results.files.folder import whole_file, whole_folder
from studies.blind.folder import alone_in, manifest_of, table_of
from studies.blind.outcome import outcome
from studies.blind.reliability import reliability_picture
from studies.blind.report import ScoredCase, ToolReport
from studies.blind.tables import Tables, markdown, picture, tables_of
from studies.blind.truth import Truth

POLL_INTERVAL_S = 0.2  # between two looks at the processes
LONGEST_PROBLEM_CHARACTERS = 10_000  # of the reason why a case failed: its end says it


# A case in ``score.json``; one of its keys, ``found``, is no name for an attribute.
BriefCase = TypedDict(  # noqa: UP013
    "BriefCase",
    {
        "case": str,
        "outcome": str,
        "kind": str,
        "sub": str | None,
        "true": list[str],
        "identifiable": bool | None,
        "protocol": str,
        "noise": float,
        "verdict": str | None,
        "remainder": str | None,
        "found": list[str] | None,
        "ambiguous_with": list[str] | None,
        "problem": str | None,
        "wall_s": float | None,
    },
)


class StudyScore(TypedDict):
    """The file ``score.json``."""

    tables: Tables
    cases: list[BriefCase]


class CaseRun(TypedDict):
    """How the run of a case ended that left no report: the file ``case-0001.run.json``."""

    wall_s: float
    problem: str


def score(
    directory: Path | str,
    *,
    processes: int = 2,
    max_effects: int = 3,
    limit_s: float | None = None,
    pages: bool = True,
    progress: Progress = silent,
) -> StudyScore:
    """Close the loop on every case that has no report yet, then score all of them.

    Parameters
    ----------
    directory : a folder of :func:`studies.blind.make.make`; receives ``reports/``, score.json, score.md,
        confusion.png and reliability.png.
    processes : cases at the same time, each in a process of its own.
    max_effects : the largest number of effects that ``close-loop`` may add.
    limit_s : a case that takes longer is stopped, and counts as failed.
    pages : whether each report is written with its page and pictures, or as report.json only, which takes much less time.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    score.json: ``tables`` and ``cases``.

    Raises
    ------
    InputError : the folder holds no cases.
    """
    directory = Path(directory)
    names = _cases(directory)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the processes are the parallel part
    try:
        with alone_in(directory):
            (directory / "reports").mkdir(exist_ok=True)
            _run(directory, names, processes, max_effects, limit_s, pages, progress)
            return _score(directory, names)
    except OSError as error:
        raise InputError(f"{directory}: cannot be written ({error.strerror}).") from None


def _cases(directory: Path) -> list[str]:
    """The names of all cases.

    Raises
    ------
    InputError : there are none, or not all that were asked for.
    """
    names: list[str] = []
    with suppress(OSError, ValueError):  # No folder, or a name that none can have.
        names = sorted(path.name for path in (directory / "cases").iterdir() if path.name.startswith("case-") and path.is_dir())
    if not names:
        raise InputError(f"{directory}: this folder contains no cases; create them with python -m studies.blind make.")
    asked = manifest_of(directory)
    if asked is not None and len(names) < asked["count"]:
        again = f"{shlex.quote(str(directory))} --seed {asked['seed']} --count {asked['count']} --family {asked['family']}"
        raise InputError(f"{directory}: {len(names)} of {asked['count']} cases exist; create the others with `make {again}`.")
    return names


def _score(directory: Path, names: list[str]) -> StudyScore:
    """Open what was sealed, and count."""
    rows: list[ScoredCase] = []
    for name in names:
        report, wall_s = _result(directory, name)
        truth = cast(Truth, table_of(directory / "sealed" / f"{name}.json", Truth.__required_keys__))
        rows.append({"case": name, "truth": truth, "report": report, "outcome": outcome(report, truth), "wall_s": wall_s})
    result: StudyScore = {"tables": tables_of(rows), "cases": [_brief(row) for row in rows]}
    whole_file(directory / "confusion.png", picture(result["tables"]["confusion"]))
    whole_file(directory / "reliability.png", reliability_picture(result["tables"]["reliability"]))
    whole_file(directory / "score.md", markdown(result["tables"]))
    whole_file(directory / "score.json", json.dumps(result, indent=1) + "\n")
    return result


def _brief(row: ScoredCase) -> BriefCase:
    truth, report = row["truth"], row["report"]
    return {
        "case": row["case"],
        "outcome": row["outcome"],
        "kind": truth["kind"],
        "sub": truth["sub"],
        "true": sorted(truth["effects"]),
        "identifiable": truth["identifiable"],
        "protocol": truth["protocol"],
        "noise": truth["noise"]["level"],
        "verdict": report.get("verdict"),
        "remainder": report.get("remainder"),
        "found": report.get("effects"),
        "ambiguous_with": report.get("ambiguous_with"),
        "problem": report.get("problem"),
        "wall_s": row["wall_s"],
    }


# ---- running ----


def _run(
    directory: Path,
    names: list[str],
    processes: int,
    max_effects: int,
    limit_s: float | None,
    pages: bool,
    progress: Progress,
) -> None:
    """Close the loop on all cases without a report, each in a process of its own: a crash stops nothing else."""
    reports = directory / "reports"
    left = [name for name in names if not (reports / name / SUMMARY).is_file()]
    context = multiprocessing.get_context("spawn")
    running: dict[str, tuple[SpawnProcess, float]] = {}
    todo = left[::-1]
    done = len(names) - len(left)
    progress("close-loop", counted(done, len(names), "case"))
    try:
        while todo or running:
            while todo and len(running) < processes:
                name = todo.pop()
                for old in (f"{name}.traceback", f"{name}.run.json"):
                    (reports / old).unlink(missing_ok=True)
                job = context.Process(target=_close, args=(str(directory), name, max_effects, pages))
                job.start()
                running[name] = job, time.perf_counter()
            time.sleep(POLL_INTERVAL_S)
            stopping.check()  # A case that was stopped with all others has not failed.
            for name, (job, begin) in list(running.items()):
                taken = time.perf_counter() - begin
                late = limit_s is not None and taken > limit_s
                if job.is_alive() and not late:
                    continue
                job.kill()
                job.join()
                del running[name]
                if not (reports / name / SUMMARY).is_file():
                    _record(reports, name, taken, f"stopped after {taken:.0f} s" if late else f"ended with {job.exitcode}")
                done += 1
                progress("close-loop", counted(done, len(names), "case"))
    finally:
        for job, _ in running.values():
            job.kill()
            job.join()


def _close(directory: str, name: str, max_effects: int, pages: bool) -> None:
    """One case, in its own process."""
    stopping.leave_signals_to_the_parent()
    reports = Path(directory) / "reports"
    try:
        from explicitfe.app.api.inverse import close_loop

        case, out = Path(directory) / "cases" / name, reports / name
        if pages:
            close_loop(case, out=out, max_effects=max_effects, processes=1, overwrite=True)
        else:
            report = close_loop(case, max_effects=max_effects, processes=1)
            with whole_folder(out) as folder:
                (folder / SUMMARY).write_text(report.text, encoding="utf-8")
    except BaseException:
        (reports / f"{name}.traceback").write_text(traceback.format_exc(), encoding="utf-8")
        raise SystemExit(1) from None


def _record(reports: Path, name: str, taken: float, end: str) -> None:
    """Write down how the run of a case without a report ended."""
    trace = reports / f"{name}.traceback"
    run: CaseRun = {
        "wall_s": taken,
        "problem": trace.read_text(encoding="utf-8")[-LONGEST_PROBLEM_CHARACTERS:] if trace.is_file() else end,
    }
    trace.unlink(missing_ok=True)
    whole_file(reports / f"{name}.run.json", json.dumps(run, indent=1) + "\n")


def _result(directory: Path, name: str) -> tuple[ToolReport, float | None]:
    """The report of a case, or of its crash, and the seconds that it took, if they are known."""
    reports = directory / "reports"
    path = reports / name / SUMMARY
    if path.is_file():
        report = cast(ToolReport, table_of(path, {"verdict"}))
        return report, report.get("provenance", {}).get("wall_s")
    ran = reports / f"{name}.run.json"
    run = cast(CaseRun, table_of(ran, CaseRun.__required_keys__))
    return {"verdict": "failed", "effects": [], "problem": run["problem"]}, run["wall_s"]
