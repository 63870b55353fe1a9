"""A set of blind cases: datasets for the tool, and sealed files with the truth for the scorer only.

OUT/made.json                       what was asked for
OUT/cases/case-0001/dataset.toml, *.csv
OUT/sealed/case-0001.json

A case is there as a whole or not at all, and its sealed file before it. So a command that was killed goes on with the next case
when it is given again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import numpy as np

from explicitfe.platform.errors import InputError, Progress, counted, nearest, shortened, silent
from explicitfe.platform.host.compilation import announcing
from explicitfe.platform.host.worker_pool import WorkerPool
from explicitfe.results.files.folder import whole_file, whole_folder
from studies.blind import homogeneous, under_a_tool
from studies.blind.case import KINDS, LEVELS, CaseRequest, write
from studies.blind.folder import MANIFEST, Manifest, alone_in, manifest_of
from studies.blind.foreign import family as foreign

FAMILIES = {"homogeneous": homogeneous, "indentation": under_a_tool, "foreign": foreign}
KIND_SHARES = {"control": 0.275, "single": 0.55, "double": 0.1, "outside": 0.075}  # where only a number of cases is given
ORDER_SEED = 1_000_003  # With the seed of the set it seeds the order of the cases, apart from what is drawn for each case.
MOST_CASES_OF_A_SET = 9999  # their names have four digits
LARGEST_SEED = 2**63 - 1  # what fits into the whole numbers of other programs that read the manifest


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
    """Create blind test cases, or resume an interrupted creation; existing cases are not changed.

    Parameters
    ----------
    out : a new or empty folder, or one with an interrupted creation of the same cases.
    seed : random seed; case k depends on the seed, on k and on its kind.
    count : total number of cases. Give either this or ``kinds``.
    kinds : number of cases of each kind: control, single, double, outside.
    family : homogeneous (milliseconds per test), indentation (simulated), or foreign (closed forms and an implicit solver that
        share no code with the simulator; the solver needs scikit-fem).
    processes : number of worker processes.
    progress : called with the stage and its completed share.

    Returns
    -------
    The file ``made.json``.

    Raises
    ------
    InputError : a parameter is invalid.
    """
    out = Path(out)
    if family not in FAMILIES:
        raise InputError(f'family = "{shortened(family)}" is unknown; {nearest(family, FAMILIES)}')
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"seed = {shortened(str(seed))} is out of range; give an integer from 0 to {LARGEST_SEED}.")
    requests = plan(seed, numbers(count, kinds, family), family)
    order = hashlib.sha256(repr(requests).encode()).hexdigest()
    wanted: Manifest = {"seed": seed, "family": family, "count": len(requests), "order": order}
    try:
        if out.exists() and not out.is_dir():
            raise InputError(f"{out}: this is a file; give the path of a folder.")
        if out.is_dir() and any(not path.name.startswith(f".{MANIFEST}.") for path in out.iterdir()):
            begun = manifest_of(out)
            if begun is None:
                raise InputError(f"{out}: this folder contains other files; give a new or an empty folder.")
            if begun != wanted:
                raise InputError(
                    f"{out}: this folder contains {begun['count']} cases of the family {begun['family']} with seed "
                    f"{begun['seed']}; use the same count, family and seed to resume, or give another folder."
                )
        out.mkdir(parents=True, exist_ok=True)
        with alone_in(out):
            if not (out / MANIFEST).is_file():
                whole_file(out / MANIFEST, json.dumps(wanted, indent=1) + "\n")
            for folder in (out / "cases", out / "sealed"):
                folder.mkdir(exist_ok=True)
            _make_missing(out, wanted, requests, processes, progress)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}).") from None
    return wanted


def _make_missing(out: Path, wanted: Manifest, requests: list[CaseRequest], processes: int, progress: Progress) -> None:
    """Make the cases that are not there yet."""
    seeds = np.random.SeedSequence(wanted["seed"]).spawn(len(requests))
    jobs = [_Job(out, k + 1, wanted["family"], requests[k], seeds[k]) for k in range(len(requests))]
    missing = [job for job in jobs if not job.dataset.is_dir()]
    done = len(jobs) - len(missing)
    progress("make", counted(done, len(jobs), "case"))
    pool = None
    if processes > 1 and len(missing) > 1:
        pool = WorkerPool(processes)
    with pool or nullcontext():
        for _ in (pool.map if pool else map)(_make_one, missing):
            done += 1
            progress("make", counted(done, len(jobs), "case"))


def numbers(count: int | None, kinds: Mapping[str, int] | None, family: str) -> dict[str, int]:
    """How many cases of each kind."""
    if (count is None) == (kinds is None):
        raise InputError("give either count or kinds, not both.")
    possible = KINDS[:2] if family == "indentation" else KINDS
    asked = sum(kinds.values()) if count is None and kinds is not None else count
    if asked is None or not 1 <= asked <= MOST_CASES_OF_A_SET:
        raise InputError(f"count = {shortened(str(asked))} is out of range; give an integer from 1 to {MOST_CASES_OF_A_SET}.")
    if kinds is None:
        shares = {kind: KIND_SHARES[kind] for kind in possible}
        ends = np.round(count * np.cumsum(list(shares.values())) / sum(shares.values())).astype(int)
        return dict(zip(shares, np.diff(ends, prepend=0).tolist(), strict=True))
    for kind, number in kinds.items():
        if kind not in possible or number < 0:
            raise InputError(f'kinds: "{kind}" = {number} is invalid; the family {family} has the kinds {", ".join(possible)}.')
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


class _Job(NamedTuple):
    """One case that is to be made: its number from 1 on, what it is to be, and the seed of what is drawn for it."""

    out: Path
    number: int
    family: str
    request: CaseRequest
    seed: np.random.SeedSequence

    @property
    def name(self) -> str:
        return f"case-{self.number:04d}"

    @property
    def dataset(self) -> Path:
        """The folder of its dataset: it is the last of its files to appear."""
        return self.out / "cases" / self.name


def _make_one(job: _Job) -> None:
    with announcing(f"simulated tests of the family {job.family}"):
        case = FAMILIES[job.family].draw(np.random.default_rng(job.seed), job.request)
    truth = {"case": job.name, "family": job.family} | case.truth
    whole_file(job.out / "sealed" / f"{job.name}.json", json.dumps(truth, indent=1) + "\n")
    with whole_folder(job.dataset) as folder:
        write(case, folder, job.name)
