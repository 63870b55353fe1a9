"""A system with fast answers near its baseline: what a full model changes is computed by a reduced one, or is linear.

Fast answers are multiplied by a polynomial of the answer, fitted to the full answers at the baseline, and the remaining
difference there is added. The polynomial holds for other constants too, where a correction that is linear in them would not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

from explicitfe.close_loop.statistics.covariance import stack
from explicitfe.close_loop.statistics.refit import BestFit, derivatives
from explicitfe.close_loop.statistics.system import Answer, Hypothesis, Parameter, Series, System

# Degree of the ratio of full to fast answers, which changes slowly with the depth.
FACTOR_DEGREE = 3


@dataclass(frozen=True, eq=False)
class Sketch:
    """Fast answers, as a :class:`explicitfe.close_loop.statistics.system.Answering` that a fit can use.

    Attributes
    ----------
    system : with the full answers.
    baseline : its model without effects at its best; without it only differences between answers mean something.
    secants : effect -> change (n,) SI by a unit of the coordinate of its strength, for those that have no fast answer.
    """

    system: System
    baseline: BestFit | None = None
    secants: Mapping[str, np.ndarray] = field(default_factory=dict)

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
        """Answers of models; None where one has an effect without a fast answer and without a secant."""
        parts = [_split(model, self.system.has_sketch) for model in models]
        fast = self.system.sketched([part for part, _ in parts])
        lengths = np.cumsum([len(one.measured) for one in self.series])
        answers: list[Answer | None] = []
        for (_, others), answer in zip(parts, fast, strict=True):
            if answer is None or not set(others) <= set(self.secants):
                answers.append(None)
                continue
            linear = sum((x * self.secants[name] for name, x in others.items()), np.zeros(lengths[-1]))
            answers.append(np.split(self._corrected(answer) + self._shift + linear, lengths[:-1]))
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
        (answer,) = self.answers([model])
        if answer is None:
            return None
        slopes = derivatives(self, model, stack(answer))
        at = len(model.base)
        for term in model.terms:
            if not self.system.has_sketch(term.effect):
                slopes[:, at : at + len(term.parameters)] = np.nan
            at += len(term.parameters)
        return slopes

    def of_terms(self, model: Hypothesis) -> np.ndarray:
        """What the terms of a model change (n,) SI."""
        bare = Hypothesis(model.base, (), model.x[: len(model.base)])
        answer, before = self.answers([model, bare])
        if answer is None or before is None:
            return np.zeros(sum(len(one.measured) for one in self.series))
        return stack(answer) - stack(before)


def _factor(fast: np.ndarray, full: np.ndarray) -> Polynomial:
    """The polynomial p of least squares with fast p(fast) = full (k,)."""
    largest = max(float(np.abs(fast).max()), 1e-300)
    columns = fast[:, None] * (fast[:, None] / largest) ** np.arange(FACTOR_DEGREE + 1)
    return Polynomial(np.linalg.lstsq(columns, full, rcond=None)[0], domain=[-largest, largest], window=[-1.0, 1.0])


def _times(factor: Polynomial | None, fast: np.ndarray) -> np.ndarray:
    """Fast answers (k,) with a factor of the baseline, which is not extrapolated."""
    return fast if factor is None else fast * factor(np.clip(fast, *factor.domain))


def _split(model: Hypothesis, has_sketch: Callable[[str], bool]) -> tuple[Hypothesis, dict[str, float]]:
    """The model with the terms that have a fast answer, and the strengths of the others less those of no effect."""
    x, kept, others, at = list(model.x[: len(model.base)]), [], {}, len(model.base)
    for term in model.terms:
        own = model.x[at : at + len(term.parameters)]
        at += len(term.parameters)
        if has_sketch(term.effect):
            kept.append(term)
            x += list(own)
        else:
            strength = term.parameters[0].sought
            others[term.effect] = float(own[0]) - strength.coordinate(strength.none)
    return Hypothesis(model.base, tuple(kept), np.array(x)), others
