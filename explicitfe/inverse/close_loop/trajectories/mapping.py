"""Fits of vibrating markers by space mapping (Bandler et al. 1995).

Fast answers are corrected to be exact at a model: their features by the difference to those of the simulator there, and what a
damped vibration leaves is added. The fit with the corrected answers is the next model. So a fit takes a few answers of the
simulator, and no derivatives of them. Derivatives of samples would lead nowhere if a vibration is out of phase by half a period.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows, stack
from explicitfe.inverse.close_loop.statistics.refit import BestFit, derivatives, fit_at, refit
from explicitfe.inverse.close_loop.statistics.system import Answer, Hypothesis, Parameter, Series
from explicitfe.inverse.close_loop.statistics.time_limit import TimeLimit
from explicitfe.inverse.close_loop.trajectories.emulator import Emulator, add_change, change_of, vibration_of
from explicitfe.inverse.close_loop.trajectories.recordings import Recordings
from explicitfe.platform.errors import RunError

# Answers of the simulator that a fit takes at most, and those in a row that may be no better: each halves the step.
MOST_ANSWERS, MOST_HALVED_STEPS = 8, 3
# A fit has ended where the next model would lower chi2 by less than this sum.
ENOUGH_DECREASE, ENOUGH_DECREASE_SHARE = 0.5, 5e-3


@dataclass(frozen=True, eq=False)
class MappedAnswers:
    """Fast answers that are exact at one model.

    Attributes
    ----------
    corrections : curve -> change of the features by the simulator there; see :func:`change_of`.
    remainders : curve -> coordinates beside the vibration, as functions of the time since the start.
    """

    recordings: Recordings
    emulator: Emulator
    corrections: Mapping[str, np.ndarray]
    remainders: Mapping[str, CubicSpline]

    @property
    def series(self) -> Sequence[Series]:
        return self.recordings.series

    @property
    def base(self) -> tuple[Parameter, ...]:
        return self.emulator.centre.base

    def exact(self, model: Hypothesis) -> bool:
        return True

    def costly(self, model: Hypothesis) -> bool:
        return False

    def has_slopes(self, model: Hypothesis) -> bool:
        return False

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """Answers of models."""
        return [self._answer(model) for model in models]

    def _answer(self, model: Hypothesis) -> Answer:
        seen = {}
        for curve in self.recordings.curves:
            vibration = add_change(self.emulator.of(model, curve.id), self.corrections[curve.id])
            since = curve.time_s - self.recordings.start_time_of(model, curve)
            left = self.remainders[curve.id]
            moved = vibration.at(since) + np.where((since > 0.0)[:, None], left(np.clip(since, 0.0, left.x[-1])), 0.0)
            seen[curve.id] = moved.reshape(len(moved), -1, 3)
        return self.recordings.by_columns(seen)


def map_answers(recordings: Recordings, emulator: Emulator, model: Hypothesis) -> MappedAnswers | None:
    """Fast answers that are exact at a model; None where it cannot be computed or does not vibrate."""
    corrections, remainders = {}, {}
    for curve, run in zip(recordings.curves, recordings.runs.of(recordings.jobs(model)), strict=True):
        if isinstance(run, str):
            return None
        times, moved = np.array(recordings.times(curve)), recordings.marker_coordinates(model, run)
        fast = emulator.of(model, curve.id)
        full = vibration_of(times, moved, fast)
        if full is None:
            return None
        corrections[curve.id] = change_of(fast, full, float(np.abs(moved).max()))
        remainders[curve.id] = CubicSpline(times, moved - add_change(fast, corrections[curve.id]).at(times), axis=0)
    return MappedAnswers(recordings, emulator, corrections, remainders)


def fit_by_mapping(
    recordings: Recordings, emulator: Emulator, start: Hypothesis, covariance: Covariance, limit: TimeLimit
) -> BestFit:
    """The best parameters of a model; never worse than the start.

    Raises
    ------
    RunError : the model cannot be computed where the search begins.
    """
    y = measured_rows(recordings.series)
    best: tuple[Hypothesis, MappedAnswers, np.ndarray] | None = None
    least, halved, converged, model = np.inf, 0, False, start
    for _ in range(MOST_ANSWERS):
        mapped = map_answers(recordings, emulator, model)
        answer = None if mapped is None else stack(mapped.answers([model])[0] or [])
        left = None if answer is None else covariance.at(answer).whiten(y - answer)
        chi2 = np.inf if left is None else float(left @ left)
        if mapped is not None and answer is not None and chi2 < least:
            best, least, halved = (model, mapped, answer), chi2, 0
            proposed = refit(mapped, model, covariance)
            converged = chi2 - proposed.whitened < ENOUGH_DECREASE + ENOUGH_DECREASE_SHARE * chi2
            model = proposed.model
        elif best is None:
            raise RunError("the model cannot be computed where its fit begins.")
        else:
            halved += 1
            model = model.at(0.5 * (model.x + best[0].x))
        if converged or halved > MOST_HALVED_STEPS or limit.reached():
            break
    assert best is not None
    model, mapped, answer = best
    return fit_at(model, answer, derivatives(mapped, model, answer), covariance, y, converged=converged)
