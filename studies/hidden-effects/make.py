"""Make sealed cases: datasets with one hidden effect, a pair, a law outside the library, or nothing.

    python make.py OUT --cases 550 --seed 1 --processes 2

OUT/case-0001/dataset.toml, *.csv    what a participant gets
OUT/truth.json                       what is hidden; for the scorer only
OUT/made.json                        what was asked for

The command resumes what was interrupted. Case k depends on the seed, on k and on its request only.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the processes are the parallel part

import numpy as np
from sealed import Request

from explicitfe.platform.errors import InputError, RunError
from explicitfe.results.files.folder import whole_file, whole_folder
from studies.blind.case import write

KIND_SHARES = {"control": 0.30, "single": 0.45, "pair": 0.10, "outside": 0.15}
FAMILY_SHARES = {"closed": 0.60, "press": 0.14, "glued": 0.18, "febio": 0.08}
TRUTH, MANIFEST = "truth.json", "made.json"
ORDER_SEED = 1_000_003
DRAWS_OF_A_CASE = 5  # a case that a solver cannot follow is drawn again, so often at most


class Job(NamedTuple):
    """One case: its folder, what it is to be, and the seed of what is drawn for it."""

    folder: Path
    request: Request
    seed: np.random.SeedSequence


def family_of(name: str) -> ModuleType:
    """The module of a family."""
    if name == "closed":
        import homogeneous

        return homogeneous
    if name == "press":
        import press

        return press
    if name == "glued":
        import glued

        return glued
    import febio

    return febio


def plan(cases: int, seed: int, families: dict[str, float], kinds: dict[str, float]) -> list[Request]:
    """The requests of all cases, in an order that reveals nothing.

    Each family has the same shares of the kinds, and the subjects of a kind take turns.
    """
    rng = np.random.default_rng([seed, ORDER_SEED])
    requests: list[Request] = []
    for family, of_family in _shared(cases, families).items():
        for kind, number in _shared(of_family, kinds).items():
            subjects = family_of(family).choices(kind)
            order = rng.permutation(len(subjects))
            requests += [Request(family, kind, subjects[order[k % len(subjects)]]) for k in range(number)]
    return [requests[k] for k in rng.permutation(len(requests))]


def _shared(number: int, shares: dict[str, float]) -> dict[str, int]:
    """A number of cases divided by shares, each rounded so that the sum is kept."""
    ends = np.round(number * np.cumsum(list(shares.values())) / sum(shares.values())).astype(int)
    return dict(zip(shares, np.diff(ends, prepend=0).tolist(), strict=True))


def make_one(job: Job) -> dict[str, Any]:
    """Write the dataset of a case, and return its truth.

    Raises
    ------
    RunError : the solver follows none of the draws.
    """
    rng = np.random.default_rng(job.seed)
    for attempt in range(DRAWS_OF_A_CASE):
        try:
            sealed = family_of(job.request.family).draw(rng, job.request)
            break
        except RunError:
            if attempt == DRAWS_OF_A_CASE - 1:
                raise
    if job.folder.exists():
        shutil.rmtree(job.folder)
    with whole_folder(job.folder) as folder:
        write(sealed.case, folder, job.folder.name)
    return sealed.truth


def make(
    out: Path,
    cases: int,
    seed: int,
    families: dict[str, float],
    kinds: dict[str, float] | None = None,
    processes: int = 1,
    show: bool = False,
) -> dict[str, dict[str, Any]]:
    """Make the missing cases of a set; returns the truth of all.

    Raises
    ------
    InputError : the folder holds another set.
    """
    kinds = kinds or KIND_SHARES
    asked = {"cases": cases, "seed": seed, "families": families, "kinds": kinds}
    out.mkdir(parents=True, exist_ok=True)
    manifest = out / MANIFEST
    if manifest.exists() and json.loads(manifest.read_text(encoding="utf-8")) != asked:
        raise InputError(f"{out}: this folder contains another set; give its options to resume it, or another folder.")
    whole_file(manifest, json.dumps(asked, indent=1) + "\n")
    path = out / TRUTH
    truth: dict[str, dict[str, Any]] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    requests = plan(cases, seed, families, kinds)
    seeds = np.random.SeedSequence(seed).spawn(cases)
    jobs = [Job(out / f"case-{k + 1:04d}", request, seeds[k]) for k, request in enumerate(requests)]
    possible = [job for job in jobs if _available(job.request.family)]
    if show and len(possible) < len(jobs):
        print(f"skipped: {len(jobs) - len(possible)} cases of the family febio, because FEBio was not found (see README.md)")
    todo = [job for job in possible if job.folder.name not in truth or not job.folder.is_dir()]
    begin = time.perf_counter()
    for done, (job, made) in enumerate(_computed(todo, processes), start=1):
        if isinstance(made, dict):
            truth[job.folder.name] = made
            whole_file(path, json.dumps(dict(sorted(truth.items())), indent=1) + "\n")
        elif show:
            print(f"\n{job.folder.name}: not made: {made}", file=sys.stderr)
        if show:
            pace = (time.perf_counter() - begin) / done
            print(f"\r{len(truth)} of {len(possible)} cases, {pace:.1f} s each      ", end="", flush=True)
    if show:
        print()
    return truth


def _available(family: str) -> bool:
    if family != "febio":
        return True
    from febio import executable

    return executable() is not None


def _computed(jobs: list[Job], processes: int) -> Iterator[tuple[Job, dict[str, Any] | RunError]]:
    """Each job with its truth, or with the reason why it cannot be made, as they end."""
    if processes <= 1:
        for job in jobs:
            yield job, _attempted(job)
        return
    with ProcessPoolExecutor(processes) as pool:
        futures = {pool.submit(_attempted, job): job for job in jobs}
        for future in as_completed(futures):
            yield futures[future], future.result()


def _attempted(job: Job) -> dict[str, Any] | RunError:
    try:
        return make_one(job)
    except RunError as error:
        return error


def counts(truth: dict[str, dict[str, Any]]) -> str:
    """How many cases of each family and kind there are, as a table."""
    kinds = list(KIND_SHARES)
    number = Counter((entry["family"], entry["kind"]) for entry in truth.values())
    lines = ["| family | " + " | ".join(kinds) + " |", "|---" * (1 + len(kinds)) + "|"]
    for family in FAMILY_SHARES:
        if any(number[family, kind] for kind in kinds):
            lines.append(f"| {family} | " + " | ".join(str(number[family, kind]) for kind in kinds) + " |")
    return "\n".join(lines)


def _shares(text: str, known: Iterable[str]) -> dict[str, float]:
    """Shares as the command line states them: "closed=3,press=1"."""
    shares = {name: float(value or 1.0) for name, _, value in (part.partition("=") for part in text.split(","))}
    unknown = set(shares) - set(known)
    if unknown:
        raise SystemExit(f"unknown: {', '.join(sorted(unknown))}; choose from {', '.join(known)}")
    return shares


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--cases", type=int, default=550)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--families", default="", help="such as closed=3,press=1 [default: all]")
    parser.add_argument("--kinds", default="", help="such as control=1,single=2 [default: all]")
    options = parser.parse_args()
    families = _shares(options.families, FAMILY_SHARES) if options.families else FAMILY_SHARES
    kinds = _shares(options.kinds, KIND_SHARES) if options.kinds else None
    truth = make(options.out, options.cases, options.seed, families, kinds, options.processes, show=True)
    print(counts(truth))


if __name__ == "__main__":
    main()
