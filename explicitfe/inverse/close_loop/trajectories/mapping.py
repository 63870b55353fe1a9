"""Fits of vibrating markers by space mapping (Bandler et al. 1995).

Fast answers are corrected to be exact at a model by the difference of their features to those of the simulator there. The fit
with the corrected answers is the next model. Where this no longer helps, because effects do not quite add up, the derivatives of
the features are taken from the simulator once, and the answers that follow keep them up to date (Broyden 1965). Derivatives of
samples would lead nowhere if a vibration were out of phase by half a period.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows, stack
from explicitfe.inverse.close_loop.statistics.refit import BestFit, derivatives, fit_at, refit
from explicitfe.inverse.close_loop.statistics.system import Answer, Hypothesis, Parameter, Series, steps_of
from explicitfe.inverse.close_loop.trajectories.emulator import Emulator, Vibration, add_change, change_of, vibration_of
from explicitfe.inverse.close_loop.trajectories.recordings import Recordings
from explicitfe.platform.errors import RunError

Slopes = Mapping[str, np.ndarray]  # curve -> (f, p) derivatives of its features by the coordinates of a model
# A fit takes at most so many answers of the simulator, without those for derivatives. A step that does not lower chi2 halves the
# next one, a step that does doubles it; below the smallest share of a full step the fit ends.
MOST_ANSWERS, LEAST_SHARE_OF_STEP = 10, 1.0 / 16.0
# Fast derivatives serve as long as each answer lowers chi2 by this share.
WORTHWHILE_DECREASE_SHARE = 0.2
# The simulator's derivatives serve until chi2 has fallen by this share since they were taken.
STALE_DECREASE_SHARE = 0.1
# A fit has ended where the next model would lower chi2 by less than this sum.
ENOUGH_DECREASE, ENOUGH_DECREASE_SHARE = 0.5, 1e-2
START = "start_s"  # name of the time at which a curve starts


@dataclass(frozen=True, eq=False)
class MappedAnswers:
    """Fast answers that are exact at one model, also for models with further terms.

    Attributes
    ----------
    model : where they are exact.
    corrections : curve -> change of the features by the simulator there; see :func:`change_of`.
    slopes : what is to be added to the derivatives of the features by the parameters of the model.
    """

    recordings: Recordings
    emulator: Emulator
    model: Hypothesis
    corrections: Mapping[str, np.ndarray]
    slopes: Slopes | None = None

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

    def features(self, model: Hypothesis, curve: str) -> Vibration:
        """Features of a curve by a model."""
        vibration = add_change(self.emulator.of(model, curve), self.corrections[curve])
        if self.slopes is None:
            return vibration
        return add_change(vibration, self.slopes[curve] @ (model.x[: len(self.model.x)] - self.model.x))

    def derivatives(self) -> np.ndarray:
        """Derivatives (n, p) m of the rows by the coordinates of the model."""
        # from the answer of the features: what they round off would be divided by a small step
        return derivatives(self, self.model, stack(self._answer(self.model)))

    def _answer(self, model: Hypothesis) -> Answer:
        seen = {}
        for curve in self.recordings.curves:
            moved = self.features(model, curve.id).at(curve.time_s - self.recordings.start_time_of(model, curve))
            seen[curve.id] = self.recordings.with_fixed_markers(moved)
        return self.recordings.by_columns(seen)


def map_answers(recordings: Recordings, emulator: Emulator, model: Hypothesis) -> tuple[MappedAnswers, np.ndarray] | None:
    """Fast answers that are exact at a model, and the rows (n,) there; None where it cannot be computed or does not vibrate."""
    corrections, seen = {}, {}
    for curve, run in zip(recordings.curves, recordings.runs.of(recordings.jobs(model)), strict=True):
        if isinstance(run, str):
            return None
        times, moved = np.array(recordings.times(curve)), recordings.marker_coordinates(model, run)
        fast = emulator.of(model, curve.id)
        full = vibration_of(times, moved, fast)
        if full is None:
            return None
        corrections[curve.id] = change_of(fast, full, float(np.abs(moved).max()))
        seen[curve.id] = recordings.seen(model, curve, run)
    return MappedAnswers(recordings, emulator, model, corrections), stack(recordings.by_columns(seen))


def fit_by_mapping(
    recordings: Recordings, emulator: Emulator, start: Hypothesis, covariance: Covariance
) -> tuple[BestFit, MappedAnswers]:
    """The best parameters of a model, never worse than the start, and fast answers that are exact there.

    Raises
    ------
    RunError : the model cannot be computed where the search begins.
    """
    y = measured_rows(recordings.series)
    best: tuple[MappedAnswers, np.ndarray] | None = None
    least, share, model = np.inf, 1.0, start
    slopes: Slopes | None = None
    taken = np.inf  # chi2 where the slopes were taken
    for _ in range(MOST_ANSWERS):
        exact = map_answers(recordings, emulator, model)
        if exact is None and best is None:
            raise RunError("the model cannot be computed where its fit begins.")
        if exact is not None and best is not None and slopes is not None:
            slopes = _secant(replace(best[0], slopes=slopes), exact[0], covariance)
        chi2, before = np.inf if exact is None else _chi2(exact[1], covariance, y), least
        if exact is not None and chi2 < least:
            best, least, share = exact, chi2, min(2.0 * share, 1.0)
        elif slopes is not None:
            share *= 0.5
        assert best is not None
        worthwhile = least < (1.0 - WORTHWHILE_DECREASE_SHARE) * before
        proposed, converged = _next_model(best[0], slopes, covariance, least)
        stale = least < (1.0 - STALE_DECREASE_SHARE) * taken
        if stale and (converged or (slopes is None and not worthwhile)):
            slopes, taken, share = slopes_of_runs(best[0]), least, 1.0
            proposed, converged = _next_model(best[0], slopes, covariance, least)
        if converged or share < LEAST_SHARE_OF_STEP:
            break
        model = best[0].model.at(best[0].model.x + share * (proposed.x - best[0].model.x))
    assert best is not None
    mapped = replace(best[0], slopes=slopes)
    return fit_at(mapped.model, best[1], mapped.derivatives(), covariance, y, converged=converged), mapped


def _next_model(mapped: MappedAnswers, slopes: Slopes | None, covariance: Covariance, least: float) -> tuple[Hypothesis, bool]:
    """The best model by fast answers, and whether it is not noticeably better than ``least``."""
    fit = refit(replace(mapped, slopes=slopes), mapped.model, covariance)
    return fit.model, least - fit.whitened < ENOUGH_DECREASE + ENOUGH_DECREASE_SHARE * least


def slopes_of_runs(mapped: MappedAnswers) -> Slopes:
    """What the derivatives of the features by the simulator have more than those of fast answers, where these are exact.

    A parameter by which the model cannot be computed on either side keeps the fast derivative.
    """
    recordings, here = mapped.recordings, mapped.model
    steps = steps_of(mapped, here, rough=True)
    slopes = {curve.id: np.zeros((len(mapped.corrections[curve.id]), len(steps)), dtype=complex) for curve in recordings.curves}
    todo = [k for k, parameter in enumerate(here.parameters) if parameter.name != START]  # fast answers know the start
    for sign in (1.0, -1.0):
        models = [here.shifted(k, sign * steps[k]) for k in todo]
        runs = iter(recordings.runs.of(job for model in models for job in recordings.jobs(model)))
        failed = []
        for k, model in zip(todo, models, strict=True):
            for curve in recordings.curves:
                run, fast = next(runs), mapped.features(model, curve.id)
                after = None
                if not isinstance(run, str):
                    moved = recordings.marker_coordinates(model, run)
                    after = vibration_of(np.array(recordings.times(curve)), moved, fast)
                if after is None:
                    failed.append(k)
                else:
                    slopes[curve.id][:, k] = change_of(fast, after, float(np.abs(moved).max())) / (sign * steps[k])
        todo = sorted({*failed})
    for k in todo:
        for curve in recordings.curves:
            slopes[curve.id][:, k] = 0.0
    return slopes


def _chi2(answer: np.ndarray, covariance: Covariance, y: np.ndarray) -> float:
    return float(np.sum(covariance.at(answer).whiten(y - answer) ** 2))


def _secant(mapped: MappedAnswers, exact: MappedAnswers, covariance: Covariance) -> Slopes:
    """Slopes with which fast answers agree with a model that was computed (Broyden's update).

    The error is put down to each parameter by how much its step changes the rows.
    """
    assert mapped.slopes is not None
    model = exact.model
    sizes = np.linalg.norm(covariance.whiten(mapped.derivatives()), axis=0)
    run = np.array([p.name != START for p in model.parameters])
    step = np.where(run, (model.x - mapped.model.x) * sizes, 0.0)
    times = {curve.id: np.array(mapped.recordings.times(curve)) for curve in mapped.recordings.curves}
    slopes = {}
    for curve, known in mapped.slopes.items():
        fast, full = mapped.features(model, curve), exact.features(model, curve)
        error = change_of(fast, full, float(np.abs(full.at(times[curve])).max()))
        slopes[curve] = known + np.outer(error, step * sizes) / max(float(step @ step), 1e-300)
    return slopes
