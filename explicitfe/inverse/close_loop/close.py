"""``explicitfe close-loop``: from a dataset to a verdict, a model file and a report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.report import LoopDocuments
from explicitfe.inverse.close_loop.specimens.close import close_specimens
from explicitfe.inverse.close_loop.specimens.groups import grouping_of, reported_groups
from explicitfe.inverse.close_loop.specimens.specimens import is_homogeneous
from explicitfe.inverse.close_loop.split import split, with_added
from explicitfe.inverse.close_loop.statistics.budget import Budget, SearchLimits
from explicitfe.inverse.close_loop.trajectories.close import close_trajectories
from explicitfe.inverse.measured.curve import SpecimenDataset, TrajectoryDataset
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError, Progress, nearest, shortened, silent

# At most so many effects, or terms of one, are added unless the user asks otherwise: each costs about as much time as the first.
USUAL_MAX_EFFECTS = 3
# Simulations of homogeneous tests (True), and of bodies with a mesh: two to five minutes of one core.
USUAL_SIMULATIONS = {True: 4000, False: 200}


def find_causes(
    dataset: Path | str,
    *,
    add: Sequence[Path | str] = (),
    holdout: Sequence[str] = (),
    constants_by: str | None = None,
    effects: Sequence[str] = (),
    max_effects: int = USUAL_MAX_EFFECTS,
    simulations: int | Literal["usual"] | None = None,
    minutes: float | None = None,
    processes: int | None = None,
    progress: Progress = silent,
) -> LoopDocuments:
    """Find which effect a model lacks, from measured curves; see :func:`explicitfe.close_loop`."""
    begin = time.perf_counter()
    data = read_dataset(dataset)
    if minutes is not None and not minutes > 0.0:
        raise InputError(f"`minutes` {minutes:g}: must be larger than 0.")
    if max_effects < 0:
        raise InputError(f"`max_effects` {max_effects}: must be 0 or more.")
    if simulations == "usual":
        simulations = USUAL_SIMULATIONS[isinstance(data, SpecimenDataset) and all(map(is_homogeneous, data.curves))]
    if simulations is not None and simulations < 1:
        raise InputError(f"`simulations` {simulations}: must be 1 or more.")
    limits = SearchLimits(max_effects, Budget(simulations, minutes), processes)
    if isinstance(data, TrajectoryDataset):
        for name, value in (("constants_by", constants_by), ("add", add)):
            if value:
                raise InputError(f"{data.path}: `{name}` does not apply to trajectories; remove it.")
        documents = close_trajectories(data, split(data, holdout), effects, limits, progress)
    else:
        unknown = next((name for name in effects if name not in EFFECTS), None)
        if unknown is not None:
            raise InputError(f"`effects` {shortened(unknown)}: unknown effect; {nearest(unknown, EFFECTS)}")
        documents = _specimens(data.specimens("the loop is closed on"), add, holdout, constants_by, effects, limits, progress)
    documents.report.provenance["wall_s"] = time.perf_counter() - begin
    return documents


def _specimens(
    dataset: SpecimenDataset,
    add: Sequence[Path | str],
    holdout: Sequence[str],
    constants_by: str | None,
    effects: Sequence[str],
    limits: SearchLimits,
    progress: Progress,
) -> LoopDocuments:
    grouping = grouping_of(dataset, holdout) if constants_by is None else None
    if grouping is not None:
        constants_by = grouping.by
    more = [read_dataset(path).specimens("what is added are") for path in add]
    if constants_by is not None:
        dataset = dataset.regrouped(constants_by)
        more = [other.regrouped(constants_by) for other in more]
    sides = with_added(split(dataset, holdout), dataset, more)
    documents = close_specimens(dataset, sides, constants_by, effects, limits, progress)
    if grouping is not None and documents.report.verdict != "failed":
        documents.report.groups = reported_groups(grouping, documents.report.final)
        documents.report.warnings = [grouping.text, *documents.report.warnings]
    return documents
