"""Constants and strengths of effects from several curves at once, by least squares.

Unknowns are positive and are sought on a logarithmic scale between bounds; several starts guard against a poor minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict.tissue import Tissue
from explicitfe.platform.errors import RunError

AT_BOUND = 1e-3  # A value this close to a bound, as a share of the logarithmic range, is at the bound.
RELATIVE_STEP = 1e-3  # of an unknown, for its derivative
BROKEN_TEST_RESIDUAL = 1e3  # the residual of a model that cannot be computed through a test
Values = Mapping[str, float]


@dataclass(frozen=True)
class Unknown:
    """A positive number that is sought between bounds."""

    low: float
    high: float
    start: float


@dataclass(frozen=True)
class EffectsFit:
    """The best of several starts.

    Attributes
    ----------
    model, values : the fitted model, and the values of the unknowns.
    nrmse : rms deviation of each curve, relative to its largest measured value.
    at_bound : unknowns that ended at a bound: the data ask for more than is allowed, or do not depend on them.
    costs : sum of squares of each start, increasing. If the first ones are close, the minimum is probably the global one.
    evaluations : number of evaluations of all curves together.
    converged : whether the best start converged.
    """

    model: Tissue
    values: dict[str, float]
    nrmse: dict[str, float]
    at_bound: tuple[str, ...]
    costs: tuple[float, ...]
    evaluations: int
    converged: bool


def series(shares: Sequence[float], tau_s: Sequence[float]) -> Viscoelastic:
    """A Prony series from positive numbers without a limit: the stress of each term relative to the long-term stress."""
    total = 1.0 + sum(shares)
    terms = sorted(zip(tau_s, shares, strict=True))
    return Viscoelastic(g=tuple(s / total for _, s in terms), tau_s=tuple(t for t, _ in terms))


def fit_effects(
    curves: Sequence[Curve],
    unknowns: Mapping[str, Unknown],
    make: Callable[[Values], Tissue],
    answer: Callable[[Sequence[Curve], Tissue], Sequence[np.ndarray]],
    *,
    starts: int = 4,
    seed: int = 0,
    most: int = 60,
    tolerance: float = 1e-6,
    weights: Callable[[Curve], np.ndarray] | None = None,
) -> EffectsFit:
    """Least squares of several curves, each relative to its largest measured value and to its number of rows.

    Parameters
    ----------
    make : gives a model from the values of the unknowns.
    answer : gives the prediction of a model for the curves, in SI at their rows.
    starts : the first starts at the unknowns' own values, the others at random around them.
    most : evaluations of a start, not counting those for derivatives.
    weights : weight of each row of a curve; 1 if left out, 0 leaves a row out.

    Raises
    ------
    RunError : no start gives a model that can be computed.
    """
    names = list(unknowns)
    low, high, first = (np.log([getattr(unknowns[n], key) for n in names]) for key in ("low", "high", "start"))
    count = 0
    rows = [np.ones(len(c.time_s)) if weights is None else weights(c) for c in curves]
    scale = [np.sqrt(w / w.sum()) / np.abs(c.columns[c.predicted]).max() for c, w in zip(curves, rows, strict=True)]

    def residuals(x: np.ndarray) -> np.ndarray:
        nonlocal count
        count += 1
        try:
            answers = answer(curves, make(dict(zip(names, map(float, np.exp(x)), strict=True))))
        except RunError:
            return np.full(sum(len(c.time_s) for c in curves), BROKEN_TEST_RESIDUAL)
        return np.concatenate([s * (y - c.columns[c.predicted]) for s, y, c in zip(scale, answers, curves, strict=True)])

    random = np.random.default_rng(seed)
    results = []
    for number in range(starts):
        begin = first if number == 0 else np.clip(first + 0.15 * (high - low) * random.standard_normal(len(first)), low, high)
        inside = np.clip(begin, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        results.append(
            least_squares(
                residuals,
                inside,
                bounds=(low, high),
                diff_step=RELATIVE_STEP,
                x_scale=1.0,
                max_nfev=most,
                ftol=tolerance,
                xtol=1e-5,
            )
        )
    results.sort(key=lambda r: r.cost)
    best = results[0]
    if best.cost > 0.1 * BROKEN_TEST_RESIDUAL**2:
        raise RunError("no start of the fit gives a model that can be computed; begin with stiffer constants.")
    values = dict(zip(names, map(float, np.exp(best.x)), strict=True))
    parts = np.split(best.fun, np.cumsum([len(c.time_s) for c in curves])[:-1])
    edge = AT_BOUND * (high - low)
    return EffectsFit(
        model=make(values),
        values=values,
        nrmse={c.id: float(np.sqrt((r**2).sum())) for c, r in zip(curves, parts, strict=True)},
        at_bound=tuple(n for n, x, a, b, e in zip(names, best.x, low, high, edge, strict=True) if x <= a + e or x >= b - e),
        costs=tuple(float(2.0 * r.cost) for r in results),
        evaluations=count,
        converged=bool(best.success) and best.status > 0,
    )
