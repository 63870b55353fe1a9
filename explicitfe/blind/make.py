"""A set of blind cases: datasets for the tool, and sealed files with the truth for the scorer only.

OUT/cases/case-0001/dataset.toml, *.csv
OUT/sealed/case-0001.json
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TypedDict

import numpy as np

from explicitfe.blind import homogeneous, under_a_tool
from explicitfe.blind.case import KINDS, LEVELS, CaseRequest, write
from explicitfe.errors import InputError, Progress, silent
from explicitfe.host.stopping import leave_signals_to_the_parent

FAMILIES = {"homogeneous": homogeneous, "indentation": under_a_tool}
KIND_SHARES = {"control": 0.275, "single": 0.55, "double": 0.1, "outside": 0.075}  # where only a number of cases is given
ORDER_SEED = 1_000_003  # With the seed of the set it seeds the order of the cases, apart from what is drawn for each case.
MANIFEST = "made.json"


class Manifest(TypedDict):
    """What was asked for, and how long it took: the file ``made.json``, without anything of the truth."""

    seed: int
    family: str
    count: int
    wall_s: float


def make(
    out: Path | str,
    *,
    seed: int,
    count: int | None = None,
    kinds: Mapping[str, int] | None = None,
    family: str = "homogeneous",
    processes: int = 1,
    progress: Progress = silent,
) -> Manifest:
    """Make cases.

    Parameters
    ----------
    out : a new or empty folder.
    seed : of all random numbers; case k depends on the seed, on k and on its kind.
    count : number of cases, of all kinds together. Give either this or ``kinds``.
    kinds : number of cases of each kind: control, single, double, outside.
    family : homogeneous (milliseconds a test) or indentation (simulated).
    processes : cases that are made at the same time.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    The file ``made.json``.

    Raises
    ------
    InputError : an option that cannot be used.
    """
    begin = time.perf_counter()
    out = Path(out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: this is not an empty folder; name a new one.")
    if family not in FAMILIES:
        raise InputError(f'family = "{family}" is unknown; it can be {" or ".join(FAMILIES)}.')
    requests = plan(seed, numbers(count, kinds, family), family)
    seeds = np.random.SeedSequence(seed).spawn(len(requests))
    jobs = [(str(out), k + 1, family, requests[k], seeds[k]) for k in range(len(requests))]
    for folder in ("cases", "sealed"):
        (out / folder).mkdir(parents=True)
    done = 0
    if processes > 1:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=leave_signals_to_the_parent) as pool:
            for _ in pool.map(_make_one, jobs):
                done += 1
                progress("make", done / len(jobs))
    else:
        for job in jobs:
            _make_one(job)
            done += 1
            progress("make", done / len(jobs))
    summary: Manifest = {"seed": seed, "family": family, "count": len(requests), "wall_s": time.perf_counter() - begin}
    (out / MANIFEST).write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    return summary


def numbers(count: int | None, kinds: Mapping[str, int] | None, family: str) -> dict[str, int]:
    """How many cases of each kind."""
    if (count is None) == (kinds is None):
        raise InputError("give either a count of cases or a number for each kind.")
    possible = KINDS if family == "homogeneous" else KINDS[:2]
    if kinds is None:
        shares = {kind: KIND_SHARES[kind] for kind in possible}
        ends = np.round(count * np.cumsum(list(shares.values())) / sum(shares.values())).astype(int)
        return dict(zip(shares, np.diff(ends, prepend=0).tolist(), strict=True))
    for kind, number in kinds.items():
        if kind not in possible or number < 0:
            raise InputError(f'kinds: "{kind}" = {number} cannot be; kinds of the family {family} are {", ".join(possible)}.')
    return dict(kinds)


def plan(seed: int, kinds: Mapping[str, int], family: str) -> list[CaseRequest]:
    """The requests for all cases, even over effects and noise levels, in an order that reveals nothing."""
    levels = LEVELS[family]
    rng = np.random.default_rng([seed, ORDER_SEED])
    requests = []
    for kind, number in kinds.items():
        choices = FAMILIES[family].choices(kind)
        start = int(rng.integers(len(choices))) if kind == "double" else 0
        for k in range(number):
            turn = k // len(choices)
            requests.append(CaseRequest(kind, choices[(start + k) % len(choices)], levels[(k + turn) % len(levels)]))
    return [requests[k] for k in rng.permutation(len(requests))]


def _make_one(job: tuple[str, int, str, CaseRequest, np.random.SeedSequence]) -> None:
    out, number, family, request, seed = job
    name = f"case-{number:04d}"
    begin = time.perf_counter()
    case = FAMILIES[family].draw(np.random.default_rng(seed), request)
    write(case, Path(out) / "cases" / name, name)
    truth = {"case": name, "family": family} | case.truth | {"made_in_s": time.perf_counter() - begin}
    (Path(out) / "sealed" / f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
