"""The elastic baseline at its best, and the covariance of the rows near a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, stack
from explicitfe.inverse.close_loop.statistics.noise import RowNoise, Scatter, row_noise, row_noise_beside, scatter
from explicitfe.inverse.close_loop.statistics.refit import BestFit, Slopes, refit, renewed, settled
from explicitfe.inverse.close_loop.statistics.sketch import Sketch
from explicitfe.inverse.close_loop.statistics.system import Answering, Hypothesis, System

# Systematic errors of assumed quantities have names that begin so; the others are of the numerics and of the protocol.
ASSUMED = "assumed "
# Shares of the search at which its first stages begin.
BASELINE_PROGRESS, SYSTEMATIC_PROGRESS = 0.02, 0.1

Watch = Callable[[str, float], None]


@runtime_checkable
class FitsByMapping(Protocol):
    """A system that fits models by fast answers which the simulator corrects."""

    def fit_by_mapping(self, start: Hypothesis, covariance: Covariance) -> BestFit | None:
        """The fit of a model; None where an effect has no fast answers."""

    def beside(self, fit: BestFit) -> Answering | None:
        """Fast answers that are exact at a fitted model, for models with further terms; None where there are none."""


def fitted_baseline(system: System, rows: Sequence[RowNoise] | None, watch: Watch) -> tuple[System, Covariance, BestFit]:
    """The system with the forward model that is best at the baseline, the covariance there, and the fit.

    Parameters
    ----------
    rows : noise of the rows; estimated if None.

    Raises
    ------
    RunError : the baseline cannot be computed.
    """
    watch("fit of the elastic model", BASELINE_PROGRESS)
    estimated = rows is None
    rows = row_noise(system.series) if rows is None else rows
    spread = scatter(system.series, rows)
    by_tests = Covariance(system.series, rows, spread, system.systematic())
    start = system.start()
    renew = None if system.exact(start) else Sketch(system).slopes
    fit = settled(system, refit(system, start, by_tests, renew=renew), by_tests, renew)
    system, fit = renewed(system, fit, by_tests, renew=renew)
    if estimated:
        rows = row_noise_beside(system.series, rows, fit.answer)
        spread = scatter(system.series, rows)
    watch("systematic errors", SYSTEMATIC_PROGRESS)
    assumed = {f"{ASSUMED}{name}": stack(answer) - fit.answer for name, answer in system.assumptions(fit.model).items()}
    covariance = covariance_of(system, fit.model, rows, spread, assumed)
    fit = refit(system, fit.model, covariance, slopes=fit.slopes, renew=renew)
    if renew is not None:
        fit = refit(system, fit.model, covariance)  # with derivatives by the simulator at the end
    fit = settled(system, fit, covariance, renew)
    return system, covariance, fit


def with_own_numerics(
    system: System, covariance: Covariance, fit: BestFit, renew: Slopes | None
) -> tuple[System, Covariance, BestFit]:
    """A fit with the numerical error of its own model, which was so far that of the baseline.

    Raises
    ------
    RunError : the model cannot be computed so.
    """
    assumed = {name: d for name, d in covariance.floors.items() if name.startswith(ASSUMED)}
    system, fit = renewed(system, fit, covariance, times=1)
    covariance = covariance_of(system, fit.model, covariance.rows, covariance.scatter, assumed)
    return system, covariance, fit_of(system, fit.model, covariance, renew, fit.slopes)


def fit_of(
    system: System,
    start: Hypothesis,
    covariance: Covariance,
    renew: Slopes | None,
    slopes: np.ndarray | None = None,
) -> BestFit:
    """The best fit of a model, by fast answers that the simulator corrects where there are some for all its effects.

    Raises
    ------
    RunError : the model cannot be computed where its fit begins.
    """
    mapped = system.fit_by_mapping(start, covariance) if isinstance(system, FitsByMapping) else None
    return mapped or refit(system, start, covariance, slopes=slopes, renew=renew)


def covariance_of(
    system: System, model: Hypothesis, rows: Sequence[RowNoise], spread: Scatter, assumed: Mapping[str, np.ndarray]
) -> Covariance:
    """Covariance at a model: noise of rows, scatter between tests, numerical errors, and what is assumed (name -> (n,) SI)."""
    (answer,) = system.answers([model])
    assert answer is not None
    base = stack(answer)
    numerical = {name: stack(other) - base for name, other in system.checks(model).items()}
    return Covariance(system.series, rows, spread, {**numerical, **system.systematic(), **assumed})
