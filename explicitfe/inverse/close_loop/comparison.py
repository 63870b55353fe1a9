"""The comparison of sets of causes with the data of a system."""

from __future__ import annotations

from collections.abc import Sequence

from explicitfe.inverse.close_loop.baseline import Watch, fitted_baseline
from explicitfe.inverse.close_loop.compared import ComparedCauses
from explicitfe.inverse.close_loop.search import Comparing
from explicitfe.inverse.close_loop.statistics.budget import NO_LIMIT, Budget
from explicitfe.inverse.close_loop.statistics.noise import RowNoise
from explicitfe.inverse.close_loop.statistics.system import System


def compare(
    system: System,
    *,
    max_effects: int,
    rows: Sequence[RowNoise] | None = None,
    limit: Budget = NO_LIMIT,
    watch: Watch = lambda stage, share: None,
) -> ComparedCauses:
    """Compare all sets of causes with the data.

    Parameters
    ----------
    max_effects : the largest number of causes of a hypothesis.
    rows : noise of the rows; estimated if left out.
    limit : where it is reached, the other hypotheses keep their estimates.
    watch : called with what is done now and the share of the whole that is done.

    Raises
    ------
    RunError : the baseline cannot be computed.
    """
    system, covariance, fit = fitted_baseline(system, rows, watch)
    return Comparing(system, covariance, fit, max_effects, limit, watch).run()
