"""``explicitfe close-loop``: from a dataset to a verdict, a model file and a report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.report import LoopDocuments
from explicitfe.inverse.close_loop.specimens.close import close_specimens
from explicitfe.inverse.close_loop.specimens.groups import grouping_of, reported_groups
from explicitfe.inverse.close_loop.split import split, with_added
from explicitfe.inverse.close_loop.statistics.time_limit import TimeLimit
from explicitfe.inverse.close_loop.trajectories.close import close_trajectories
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError, Progress, nearest, shortened, silent

# At most so many effects, or terms of one, are added unless the user asks otherwise: each costs about as much time as the first.
USUAL_MAX_EFFECTS = 3


def find_causes(
    dataset_path: Path | str,
    *,
    add: Sequence[Path | str] = (),
    holdout: Sequence[str] = (),
    constants_by: str | None = None,
    effects: Sequence[str] = (),
    max_effects: int = USUAL_MAX_EFFECTS,
    minutes: float | None = None,
    processes: int | None = None,
    progress: Progress = silent,
) -> LoopDocuments:
    """Find which effect a model lacks, from measured curves; see :func:`explicitfe.close_loop`."""
    begin = time.perf_counter()
    dataset = read_dataset(dataset_path)
    for name in effects:
        if dataset.test != "trajectory" and name not in EFFECTS:
            raise InputError(f"`effects` {shortened(name)}: unknown effect; {nearest(name, EFFECTS)}")
    if minutes is not None and not minutes > 0.0:
        raise InputError(f"`minutes` {minutes:g}: must be larger than 0.")
    if max_effects < 0:
        raise InputError(f"`max_effects` {max_effects}: must be 0 or more.")
    if dataset.test == "trajectory" and constants_by is not None:
        raise InputError(f"{dataset.path}: `constants_by` does not apply to trajectories; remove it.")
    grouping = grouping_of(dataset, holdout) if constants_by is None and dataset.test != "trajectory" else None
    if grouping is not None:
        constants_by = grouping.by
    more = [read_dataset(path) for path in add]
    if dataset.test == "trajectory" and more:
        raise InputError(f"{dataset.path}: `add` does not apply to trajectories; remove it.")
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
    return documents
