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
from typing import Any

import numpy as np

from explicitfe.blind import homogeneous as cases
from explicitfe.blind import under_a_tool as indentation
from explicitfe.blind.case import KINDS, LEVELS, Wanted, write
from explicitfe.errors import InputError, Progress, silent

DRAWN = {"homogeneous": cases, "indentation": indentation}
SHARES = {"control": 0.275, "single": 0.55, "double": 0.1, "outside": 0.075}  # where only a number of cases is given
PLAN = 1_000_003  # beside the seed: the order of the cases is drawn by itself
MANIFEST = "made.json"


def make(
    out: Path | str,
    *,
    seed: int,
    count: int | None = None,
    kinds: Mapping[str, int] | None = None,
    family: str = "homogeneous",
    processes: int = 1,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Make cases.

    Parameters
    ----------
    out : a new or empty folder.
    seed : of all that is drawn; case k depends on the seed, on k and on what kind it is to be.
    count : cases, of all kinds; or
    kinds : kind -> number of cases: control, single, double, outside.
    family : homogeneous (milliseconds a test) or indentation (simulated).
    processes : cases that are made at the same time.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    JSON-able: the request and its wall time. Nothing of the truth.

    Raises
    ------
    InputError : an option that cannot be used.
    """
    begin = time.perf_counter()
    out = Path(out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: this is not an empty folder; name a new one.")
    if family not in DRAWN:
        raise InputError(f'family = "{family}" is unknown; it can be {" or ".join(DRAWN)}.')
    wanted = plan(seed, numbers(count, kinds, family), family)
    seeds = np.random.SeedSequence(seed).spawn(len(wanted))
    jobs = [(str(out), k + 1, family, wanted[k], seeds[k]) for k in range(len(wanted))]
    for folder in ("cases", "sealed"):
        (out / folder).mkdir(parents=True)
    done = 0
    if processes > 1:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            for _ in pool.map(_make_one, jobs):
                done += 1
                progress("make", done / len(jobs))
    else:
        for job in jobs:
            _make_one(job)
            done += 1
            progress("make", done / len(jobs))
    summary = {"seed": seed, "family": family, "count": len(wanted), "wall_s": time.perf_counter() - begin}
    (out / MANIFEST).write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    return summary


def numbers(count: int | None, kinds: Mapping[str, int] | None, family: str) -> dict[str, int]:
    """How many cases of each kind."""
    if (count is None) == (kinds is None):
        raise InputError("give either a count of cases or a number for each kind.")
    possible = KINDS if family == "homogeneous" else KINDS[:2]
    if kinds is None:
        shares = {kind: SHARES[kind] for kind in possible}
        ends = np.round(count * np.cumsum(list(shares.values())) / sum(shares.values())).astype(int)
        return dict(zip(shares, np.diff(ends, prepend=0).tolist(), strict=True))
    for kind, number in kinds.items():
        if kind not in possible or number < 0:
            raise InputError(f'kinds: "{kind}" = {number} cannot be; kinds of the family {family} are {", ".join(possible)}.')
    return dict(kinds)


def plan(seed: int, kinds: Mapping[str, int], family: str) -> list[Wanted]:
    """What each case is to be: evenly over effects and noise levels, in an order that tells nothing."""
    levels = LEVELS[family]
    rng = np.random.default_rng([seed, PLAN])
    wanted = []
    for kind, number in kinds.items():
        choices = DRAWN[family].choices(kind)
        start = int(rng.integers(len(choices))) if kind == "double" else 0
        for k in range(number):
            turn = k // len(choices)
            wanted.append(Wanted(kind, choices[(start + k) % len(choices)], levels[(k + turn) % len(levels)]))
    return [wanted[k] for k in rng.permutation(len(wanted))]


def _make_one(job: tuple[str, int, str, Wanted, np.random.SeedSequence]) -> None:
    out, number, family, wanted, seed = job
    name = f"case-{number:04d}"
    begin = time.perf_counter()
    case = DRAWN[family].draw(np.random.default_rng(seed), wanted)
    write(case, Path(out) / "cases" / name, name)
    truth = {"case": name, "family": family} | case.truth | {"made_in_s": time.perf_counter() - begin}
    (Path(out) / "sealed" / f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
