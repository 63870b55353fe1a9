"""``explicitfe close-loop``: from a dataset to a verdict, a model file and a report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from explicitfe.close_loop.report import SUMMARY, write
from explicitfe.close_loop.specimens.close import close_specimens
from explicitfe.close_loop.specimens.groups import grouping_of, reported_groups
from explicitfe.close_loop.split import split, with_added
from explicitfe.close_loop.statistics.time_limit import TimeLimit
from explicitfe.close_loop.trajectories.close import close_trajectories
from explicitfe.effects import EFFECTS
from explicitfe.errors import InputError, Progress, nearest, shortened, silent
from explicitfe.measured.read import read_dataset
from explicitfe.results.folder import checked_target
from explicitfe.results.loop_report import LoopReport

# At most so many effects, or terms of one, are added unless the user asks otherwise: each costs about as much time as the first.
USUAL_MAX_EFFECTS = 3


def close_loop(
    dataset_path: Path | str,
    *,
    out: Path | str | None = None,
    add: Sequence[Path | str] = (),
    holdout: Sequence[str] = (),
    constants_by: str | None = None,
    effects: Sequence[str] = (),
    max_effects: int = USUAL_MAX_EFFECTS,
    minutes: float | None = None,
    processes: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> LoopReport:
    """Find which effect a model lacks, from measured curves.

    Parameters
    ----------
    dataset_path : folder of the dataset, its dataset.toml, or the name of a dataset that comes with the program.
    out : folder for report.html, report.json, pictures and model files; nothing is written if it is left out.
    add : folders of further datasets of the same specimen and machine, whose curves are fitted together with the others,
        such as tests that a report proposed.
    holdout : ids of curves that are only predicted; chosen by the dataset or by a rule if left out.
    constants_by : condition, or "group", by which curves share their constants; as the dataset says if left out, unless equal
        tests on several specimens show that one set cannot serve all of them.
    effects : names of those that are considered; all if left out.
    max_effects : most effects (or terms of one) that are added.
    minutes : the search ends after this time, but fits may take as long as what precedes them; None is no limit. Hypotheses that
        were not fitted keep their estimates, and a warning names them.
    processes : at most so many; one a core if left out.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    What ``report.json`` holds. A fit that cannot be done has the verdict "failed" and a message.

    Raises
    ------
    InputError : a dataset or an option that cannot be used; nothing is written.
    """
    begin = time.perf_counter()
    dataset = read_dataset(dataset_path)
    for name in effects:
        if dataset.test != "trajectory" and name not in EFFECTS:
            raise InputError(f"--effects {shortened(name)}: unknown effect; {nearest(name, EFFECTS)}")
    if minutes is not None and not minutes > 0.0:
        raise InputError(f"--minutes {minutes:g}: must be larger than 0.")
    if max_effects < 0:
        raise InputError(f"--max-effects {max_effects}: must be 0 or more.")
    target = None if out is None else checked_target(Path(out), overwrite, summary=SUMMARY, what="report")
    if dataset.test == "trajectory" and constants_by is not None:
        raise InputError(f"{dataset.path}: --constants-by does not apply to trajectories; remove it.")
    grouping = grouping_of(dataset, holdout) if constants_by is None and dataset.test != "trajectory" else None
    if grouping is not None:
        constants_by = grouping.by
    more = [read_dataset(path) for path in add]
    if dataset.test == "trajectory" and more:
        raise InputError(f"{dataset.path}: --add does not apply to trajectories; remove it.")
    if constants_by is not None:
        dataset = dataset.regrouped(constants_by)
        more = [other.regrouped(constants_by) for other in more]
    sides = with_added(split(dataset, holdout), dataset, more)
    limit = TimeLimit(minutes)
    if dataset.test == "trajectory":
        documents = close_trajectories(dataset, sides, effects, max_effects, limit, processes, progress)
    else:
        documents = close_specimens(dataset, sides, constants_by, effects, max_effects, limit, processes, progress)
    if grouping is not None and documents.report.verdict != "failed":
        documents.report.groups = reported_groups(grouping, documents.report.final)
        documents.report.warnings = [grouping.text, *documents.report.warnings]
    documents.report.provenance["wall_s"] = time.perf_counter() - begin
    if target is not None:
        write(target, documents)
    return documents.report
