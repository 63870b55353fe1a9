"""A system with fast answers near its baseline, from reduced specimens.

Fast answers are multiplied by a polynomial of the answer, fitted to the full answers at the baseline, and the remaining
difference there is added. The polynomial holds for other constants too, where a correction that is linear in them would not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice, product

import numpy as np
from numpy.polynomial import Polynomial

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows, stack
from explicitfe.inverse.close_loop.statistics.refit import BestFit, derivatives
from explicitfe.inverse.close_loop.statistics.system import Answer, Answering, Hypothesis, Parameter, Series, System

# Degree of the ratio of full to fast answers, which changes slowly with the depth.
FACTOR_DEGREE = 3
# Combinations of trials from which a fit may begin.
MOST_STARTS = 40


@dataclass(frozen=True, eq=False)
class Sketch:
    """Fast answers, as a :class:`explicitfe.inverse.close_loop.statistics.system.Answering` that a fit can use.

    Attributes
    ----------
    system : with the full answers.
    baseline : its model without effects at its best; without it only differences between answers mean something.
    """

    system: System
    baseline: BestFit | None = None

    @property
    def series(self) -> Sequence[Series]:
        return self.system.series

    @property
    def base(self) -> tuple[Parameter, ...]:
        return self.system.base

    def exact(self, model: Hypothesis) -> bool:
        return True

    def costly(self, model: Hypothesis) -> bool:
        return True  # a fit need be no more accurate than the answers

    def has_slopes(self, model: Hypothesis) -> bool:
        return False

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """Answers of models; None where one has an effect without a fast answer."""
        known = [all(map(self.system.has_sketch, model.effects)) for model in models]
        fast = iter(self.system.sketched([model for model, k in zip(models, known, strict=True) if k]))
        ends = np.cumsum([len(one.measured) for one in self.series])[:-1]
        answers: list[Answer | None] = []
        for has_all in known:
            answer = next(fast) if has_all else None
            answers.append(None if answer is None else np.split(self._corrected(answer) + self._shift, ends))
        return answers

    def _corrected(self, fast: Answer) -> np.ndarray:
        """Fast answers of all series with their factors (n,)."""
        return np.concatenate([_times(factor, y) for factor, y in zip(self._factors, fast, strict=True)])

    @cached_property
    def _fast_baseline(self) -> Answer | None:
        return None if self.baseline is None else self.system.sketched([self.baseline.model])[0]

    @cached_property
    def _factors(self) -> list[Polynomial | None]:
        """Full over fast answers at the baseline, as a polynomial of the fast answer, one for each series."""
        fast = self._fast_baseline
        if self.baseline is None or fast is None:
            return [None] * len(self.series)
        ends = np.cumsum([len(y) for y in fast])[:-1]
        return [_factor(y, full) for y, full in zip(fast, np.split(self.baseline.answer, ends), strict=True)]

    @cached_property
    def _shift(self) -> np.ndarray | float:
        """Difference between full and corrected fast answers at the baseline (n,) SI."""
        if self.baseline is None or self._fast_baseline is None:
            return 0.0
        return self.baseline.answer - self._corrected(self._fast_baseline)

    def slopes(self, model: Hypothesis) -> np.ndarray | None:
        """Derivatives (n, p) SI at a model, NaN for effects without a fast answer; None if there are none."""
        kept = [self.system.has_sketch(term.effect) for term in model.terms]
        sizes = [len(model.base), *(len(term.parameters) for term in model.terms)]
        finite = np.repeat([True, *kept], sizes)
        fast = Hypothesis(model.base, tuple(term for term, k in zip(model.terms, kept, strict=True) if k), model.x[finite])
        (answer,) = self.answers([fast])
        if answer is None:
            return None
        slopes = np.full((sum(map(len, answer)), len(finite)), np.nan)
        slopes[:, finite] = derivatives(self, fast, stack(answer))
        return slopes

    def best_start(
        self, model: Hypothesis, trials: Mapping[str, Sequence[tuple[float, ...]]], covariance: Covariance
    ) -> Hypothesis:
        """Of a model and all trials of its terms the one whose answers are nearest to the data.

        Only where fast answers follow all effects: elsewhere the model is as near as they can tell.

        Parameters
        ----------
        trials : effect -> the values of its parameters that are tried.
        """
        if not self.system.fast_everywhere:
            return model
        place = len(model.base)
        starts, parameters = [model], model.parameters[place:]
        for values in islice(product(*(trials[term.effect] for term in model.terms)), MOST_STARTS):
            chosen = [p.sought.coordinate(v) for p, v in zip(parameters, chain(*values), strict=True)]
            starts.append(model.at(np.append(model.x[:place], chosen)))
        target = measured_rows(self.series)
        answers = [None if y is None else covariance.whiten(target - stack(y)) for y in self.answers(starts)]
        return starts[int(np.argmin([np.inf if left is None else float(left @ left) for left in answers]))]


def change_by_terms(fast: Answering, model: Hypothesis, before: Hypothesis | None = None) -> np.ndarray:
    """What the terms of a model change (n,) SI, by fast answers; compared with a model ``before`` where this is given."""
    without = Hypothesis(model.base, (), model.x[: len(model.base)]) if before is None else before
    answer, other = fast.answers([model, without])
    if answer is None or other is None:
        return np.zeros(sum(len(one.measured) for one in fast.series))
    return stack(answer) - stack(other)


def _factor(fast: np.ndarray, full: np.ndarray) -> Polynomial:
    """The polynomial p of least squares with fast p(fast) = full (k,)."""
    largest = max(float(np.abs(fast).max()), 1e-300)
    columns = fast[:, None] * (fast[:, None] / largest) ** np.arange(FACTOR_DEGREE + 1)
    return Polynomial(np.linalg.lstsq(columns, full, rcond=None)[0], domain=[-largest, largest], window=[-1.0, 1.0])


def _times(factor: Polynomial | None, fast: np.ndarray) -> np.ndarray:
    """Fast answers (k,) with a factor of the baseline, which is not extrapolated."""
    return fast if factor is None else fast * factor(np.clip(fast, *factor.domain))
