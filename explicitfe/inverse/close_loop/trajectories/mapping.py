"""Fits of vibrating markers by space mapping (Bandler et al. 1995).

Fast answers are corrected to be exact at a model by the difference of their features to those of the simulator there. The fit
with the corrected answers is the next model. Where this no longer helps, because effects do not quite add up, derivatives are
taken from the simulator once, and the answers that follow keep them up to date (Broyden 1965). A fit that began with
derivatives of samples would lead nowhere if a vibration were out of phase by half a period.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows, stack
from explicitfe.inverse.close_loop.statistics.refit import BestFit, derivatives, fit_at, refit
from explicitfe.inverse.close_loop.statistics.system import Answer, Hypothesis, Parameter, Series
from explicitfe.inverse.close_loop.statistics.time_limit import TimeLimit
from explicitfe.inverse.close_loop.trajectories.emulator import Emulator, add_change, change_of, vibration_of
from explicitfe.inverse.close_loop.trajectories.recordings import Recordings
from explicitfe.platform.errors import RunError

Slopes = Callable[[Hypothesis, np.ndarray], np.ndarray]  # derivatives (n, p) m of a model whose answer is (n,) m
# A fit takes at most so many answers of the simulator, without those for derivatives. A step that does not lower chi2 halves the
# next one, a step that does doubles it; below the smallest share of a full step the fit ends.
MOST_ANSWERS, LEAST_SHARE_OF_STEP = 10, 1.0 / 16.0
# Fast derivatives serve as long as each answer lowers chi2 by this share.
WORTHWHILE_DECREASE_SHARE = 0.2
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
    slopes : (n, p) m, what is to be added to the derivatives of all rows by the parameters of the model.
    """

    recordings: Recordings
    emulator: Emulator
    model: Hypothesis
    corrections: Mapping[str, np.ndarray]
    slopes: np.ndarray | None = None

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
            moved = vibration.at(curve.time_s - self.recordings.start_time_of(model, curve))
            seen[curve.id] = self.recordings.with_fixed_markers(moved)
        answer = self.recordings.by_columns(seen)
        if self.slopes is None:
            return answer
        ends = np.cumsum([len(y) for y in answer])[:-1]
        more = np.split(self.slopes @ (model.x[: len(self.model.x)] - self.model.x), ends)
        return [y + d for y, d in zip(answer, more, strict=True)]


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
    recordings: Recordings,
    emulator: Emulator,
    simulated: Slopes,
    start: Hypothesis,
    covariance: Covariance,
    limit: TimeLimit,
) -> BestFit:
    """The best parameters of a model; never worse than the start.

    Parameters
    ----------
    simulated : derivatives by the simulator.

    Raises
    ------
    RunError : the model cannot be computed where the search begins.
    """
    y = measured_rows(recordings.series)
    best: tuple[MappedAnswers, np.ndarray] | None = None
    least, share, converged, model = np.inf, 1.0, False, start
    slopes: np.ndarray | None = None  # what the simulator's derivatives have more than the fast ones
    for _ in range(MOST_ANSWERS):
        exact = map_answers(recordings, emulator, model)
        if exact is None and best is None:
            raise RunError("the model cannot be computed where its fit begins.")
        if exact is not None and best is not None and slopes is not None:
            slopes = slopes + _secant(replace(best[0], slopes=slopes), model, exact[1])
        chi2, before = np.inf if exact is None else _chi2(exact[1], covariance, y), least
        if exact is not None and chi2 < least:
            best, least, share = exact, chi2, min(2.0 * share, 1.0)
        elif slopes is not None:
            share *= 0.5
        assert best is not None
        if slopes is None and not least < (1.0 - WORTHWHILE_DECREASE_SHARE) * before:
            slopes = simulated(best[0].model, best[1]) - derivatives(best[0], best[0].model, best[1])
        proposed = refit(replace(best[0], slopes=slopes), best[0].model, covariance)
        converged = least - proposed.whitened < ENOUGH_DECREASE + ENOUGH_DECREASE_SHARE * least
        if converged and slopes is None:
            slopes = simulated(best[0].model, best[1]) - derivatives(best[0], best[0].model, best[1])
            proposed = refit(replace(best[0], slopes=slopes), best[0].model, covariance)
            converged = least - proposed.whitened < ENOUGH_DECREASE + ENOUGH_DECREASE_SHARE * least
        if converged or share < LEAST_SHARE_OF_STEP or limit.reached():
            break
        model = best[0].model.at(best[0].model.x + share * (proposed.model.x - best[0].model.x))
    assert best is not None
    mapped, answer = best
    now = derivatives(replace(mapped, slopes=slopes), mapped.model, answer)
    return fit_at(mapped.model, answer, now, covariance, y, converged=converged)


def _chi2(answer: np.ndarray, covariance: Covariance, y: np.ndarray) -> float:
    return float(np.sum(covariance.at(answer).whiten(y - answer) ** 2))


def _secant(mapped: MappedAnswers, model: Hypothesis, answer: np.ndarray) -> np.ndarray:
    """Change (n, p) of the slopes with which the mapped answers agree with one that was computed (Broyden's update)."""
    typical = np.array([p.typical for p in model.parameters])
    run = [p.name != START for p in model.parameters]  # fast answers know the time of the start
    step = np.where(run, (model.x - mapped.model.x) / typical, 0.0)
    error = answer - stack(mapped.answers([model])[0] or [])
    return np.outer(error, step / typical) / max(float(step @ step), 1e-300)
