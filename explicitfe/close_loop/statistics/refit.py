"""Weighted least squares with bounds, intervals, and cross-validation by whole curves.

Every evaluation may be a finite-element run, so derivatives are taken once, all at a time, and then kept up to date from the
steps themselves (Broyden 1965, Schubert 1970).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import norm

from explicitfe.close_loop.statistics.covariance import Covariance, measured, stacked
from explicitfe.close_loop.statistics.system import Hypothesis, System
from explicitfe.errors import RunError

STEP, ROUGH_STEP = 1e-3, 0.04  # of a parameter's typical way; the second where answers are rough
ENOUGH, RELATIVE = 0.02, 1e-5  # what another step would gain in chi2, and relative to it
ROUGH_ENOUGH, ROUGH_RELATIVE = 0.5, 3e-3  # the same where answers are rough
TURNS, ROUGH_TURNS, ROUGH_ANEW = 40, 8, 1  # steps, and how often derivatives are taken anew
GROSS = 9.0  # mean square of the rows: so far off, a model is not judged by its nuisances
POOR = 0.25  # of the gain that was hoped for: derivatives are taken anew
STALLED, ROUGH_STALLED = 1e-2, 1e-1
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e8
EDGE = 1e-6  # of a parameter's range: it is at its bound
Z95 = float(norm.ppf(0.975))


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its best.

    Attributes
    ----------
    model : with the best parameters.
    answer : (n,) SI of all rows.
    slopes : (n, p) SI, its derivatives by the coordinates.
    residual, jacobian : (n,) target - answer and (n, p) slopes, whitened.
    at_bound : names of parameters at a bound.
    converged : False where the search gave up: that says nothing about the model.
    by_rows : sum of squares whitened by the rows alone, where the misfit is gross; else None.
    """

    model: Hypothesis
    answer: np.ndarray
    slopes: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    at_bound: tuple[str, ...]
    converged: bool
    by_rows: float | None = None

    @property
    def chi2(self) -> float:
        """Whitened sum of squares, that which was made small: by the rows alone where the misfit is gross."""
        return self.whitened if self.by_rows is None else self.by_rows

    @property
    def whitened(self) -> float:
        """Whitened sum of squares, in which fingerprints are counted."""
        return float(self.residual @ self.residual)

    @property
    def movable(self) -> np.ndarray:
        """The whitened derivatives (n, q) by the parameters that can follow: one that is pressed against its bound cannot."""
        low, high = (np.array([getattr(p, end) for p in self.model.parameters]) for end in ("low", "high"))
        edge = EDGE * (high - low)
        push = self.jacobian.T @ self.residual
        stuck = ((self.model.x <= low + edge) & (push < 0.0)) | ((self.model.x >= high - edge) & (push > 0.0))
        return self.jacobian[:, ~stuck]


def refit(
    system: System,
    start: Hypothesis,
    covariance: Covariance,
    target: np.ndarray | None = None,
    slopes: np.ndarray | None = None,
) -> Fitted:
    """The best parameters of a model (Levenberg & Marquardt, inside the bounds).

    Parameters
    ----------
    target : (n,) SI; what is to be met, the measured rows if left out.
    slopes : (n, p) SI; derivatives about there, to begin with. Where answers are rough they are worth the runs they save.

    Raises
    ------
    RunError : the model cannot be computed where the search begins.
    """
    y = measured(system.series) if target is None else target
    low = np.array([p.low for p in start.parameters])
    high = np.array([p.high for p in start.parameters])
    model = start.at(np.clip(start.x, low, high))
    answer = _one(system, model)
    if answer is None:
        raise RunError("the model cannot be computed where the fit begins.")
    fresh = slopes is None or system.exact(start)
    found = _Place(model, answer, derivatives(system, model, answer) if fresh else slopes, fresh, False)
    # First by the rows alone. Against a gross misfit no scale of a test and no assumed length is unlikely enough: they would
    # be spent on it, and the constants would go anywhere.
    rows = covariance.of_rows()
    found = _descend(system, found, rows, y)
    gross = float(np.sum(rows.whiten(y - found.answer) ** 2))
    by_rows = gross if gross >= GROSS * len(y) else None
    if by_rows is None:
        found = found if rows is covariance else _descend(system, found, covariance, y)
    edge = EDGE * (high - low)
    at_bound = tuple(
        p.name
        for p, x, a, b, e in zip(found.model.parameters, found.model.x, low, high, edge, strict=True)
        if x <= a + e or x >= b - e
    )
    residual = covariance.at(found.answer).whiten(y - found.answer)
    J = _jacobian(covariance, y, found.answer, found.slopes)
    return Fitted(found.model, found.answer, found.slopes, residual, J, at_bound, found.converged, by_rows)


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a search is: derivatives are ``fresh`` if they were taken just there."""

    model: Hypothesis
    answer: np.ndarray
    slopes: np.ndarray
    fresh: bool
    converged: bool


def _descend(system: System, place: _Place, covariance: Covariance, y: np.ndarray) -> _Place:
    """The least chi2 downhill from a place."""
    model, answer, slopes, fresh = place.model, place.answer, place.slopes, place.fresh
    exact = system.exact(place.model)
    enough, relative = (ENOUGH, RELATIVE) if exact else (ROUGH_ENOUGH, ROUGH_RELATIVE)
    low = np.array([p.low for p in model.parameters])
    high = np.array([p.high for p in model.parameters])
    r = covariance.at(answer).whiten(y - answer)
    damping, converged = FIRST_DAMPING, False
    anew = TURNS if exact else ROUGH_ANEW
    for _ in range(TURNS if exact else ROUGH_TURNS):
        J = _jacobian(covariance, y, answer, slopes)
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-12 * max(float(np.linalg.norm(J)), 1e-300))
        step = _step(J / size, r, size * (low - model.x), size * (high - model.x), damping) / size
        gain = float(r @ r - (r - J @ step) @ (r - J @ step))
        if gain < enough + relative * float(r @ r):
            if damping > FIRST_DAMPING:
                break  # a small step, for no larger one was any better or could be computed: that may be no optimum
            if fresh or not exact:
                converged = True
                break
            slopes, fresh = derivatives(system, model, answer), True
            continue
        there = model.at(np.clip(model.x + step, low, high))
        new = _one(system, there)
        rest = None if new is None else covariance.at(new).whiten(y - new)
        better = rest is not None and float(rest @ rest) < float(r @ r)
        if better:
            way = there.x - model.x
            slopes = _updated(slopes, new - answer, way)
            poor = float(r @ r - rest @ rest) < POOR * gain
            model, answer, r, fresh = there, new, rest, False
            damping *= 1.0 if poor else 0.1
        if better and not poor:
            continue
        if not fresh and anew > 0:
            slopes, fresh, anew = derivatives(system, model, answer), True, anew - 1
        elif not better:
            damping *= 10.0
            if damping > LARGEST_DAMPING:
                break  # nothing is downhill
    # rough answers have no exact minimum; near it is enough
    if not converged:
        J = _jacobian(covariance, y, answer, slopes)
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-12 * max(float(np.linalg.norm(J)), 1e-300))
        step = _step(J / size, r, size * (low - model.x), size * (high - model.x), FIRST_DAMPING) / size
        gain = float(r @ r - (r - J @ step) @ (r - J @ step))
        converged = gain < max(enough, (STALLED if exact else ROUGH_STALLED) * float(r @ r))
    return _Place(model, answer, slopes, fresh, converged)


def _updated(slopes: np.ndarray, change: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Derivatives (n, p) that give the change (n,) along a way (p,); where there is none, none comes (Schubert 1970).

    So a test learns nothing from what constants of others did.
    """
    ways = np.where(slopes != 0.0, way, 0.0)
    length = np.maximum(ways @ way, 1e-300)
    return slopes + ((change - slopes @ way) / length)[:, None] * ways


def _jacobian(covariance: Covariance, y: np.ndarray, answer: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Slopes whitened where the model is; the scale that a test is likely to have multiplies them as it does the answer."""
    here = covariance.at(answer)
    return here.whiten(here.factors(y - answer)[:, None] * slopes)


def derivatives(system: System, model: Hypothesis, now: np.ndarray) -> np.ndarray:
    """Derivatives (n, p) SI of the answer ``now`` by the coordinates, one-sided: inside the bounds, where it can be computed.

    A parameter by which the model can be computed on neither side has the derivative 0: it is left where it is.
    """
    step = STEP if system.exact(model) else ROUGH_STEP
    ways = [step * max(p.typical, 0.1 * abs(x)) for p, x in zip(model.parameters, model.x, strict=True)]
    ways = [-way if x + way > p.high else way for p, x, way in zip(model.parameters, model.x, ways, strict=True)]

    def shifted(k: int, way: float) -> Hypothesis:
        x = model.x.copy()
        x[k] += way
        return model.at(x)

    found = system.answers([shifted(k, way) for k, way in enumerate(ways)])
    back = [k for k, answer in enumerate(found) if answer is None and model.parameters[k].low <= model.x[k] - ways[k]]
    for k, answer in zip(back, system.answers([shifted(k, -ways[k]) for k in back]), strict=True):
        found[k], ways[k] = answer, -ways[k]
    columns = []
    for answer, way in zip(found, ways, strict=True):
        columns.append(np.zeros(len(now)) if answer is None else (stacked(answer) - now) / way)
    return np.array(columns).reshape(len(columns), len(now)).T  # (n, 0) where nothing is fitted


def intervals(fit: Fitted, covariance: Covariance, worse: float = 1.0) -> list[tuple[float, float]]:
    """95 % intervals of the values, from the curvature at the optimum.

    Where the misfit is gross the rows alone were fitted, and what they have in common moves the parameters that they give.

    Parameters
    ----------
    covariance : that the model was fitted with.
    worse : multiplies the unit of chi2.
    """
    gross = fit.by_rows is not None
    J = covariance.by_rows(fit.slopes) if gross else fit.jacobian
    size = np.linalg.norm(J, axis=0)
    shown = size > 0.0
    unit = J[:, shown] / size[shown]
    inverse = np.linalg.pinv(unit.T @ unit, rcond=1e-12)
    each = worse * np.diag(inverse)
    if gross:
        each = each + np.sum((inverse @ (unit.T @ covariance.at(fit.answer).shared)) ** 2, axis=1)
    variance = np.full(len(size), np.inf)  # of what the data do not depend on
    variance[shown] = each / size[shown] ** 2
    found = []
    for k, p in enumerate(fit.model.parameters):
        half = Z95 * float(np.sqrt(variance[k]))
        ends = np.clip([fit.model.x[k] - half, fit.model.x[k] + half], p.low, p.high)
        low, high = (p.sought.value(float(x)) for x in ends)
        found.append((min(low, high), max(low, high)))
    return found


def cross_validated(system: System, fit: Fitted, covariance: Covariance) -> dict[str, float]:
    """Test -> rms deviation over its largest value where the parameters come from the other tests only.

    From the derivatives at the optimum: what leaving a test out moves is small where the model is any good. A test whose
    constants no other one shares cannot be predicted, and is not among them.
    """
    tests = list(dict.fromkeys(one.test for one in system.series))
    slices = covariance.slices()
    y = measured(system.series)
    sd = np.concatenate([row.sd for row in covariance.rows])
    r = (y - fit.answer) / sd
    J = fit.slopes / sd[:, None]
    largest: dict[str, float] = {}
    for one in system.series:
        largest[one.curve] = max(largest.get(one.curve, 0.0), float(np.abs(one.measured).max()))
    found = {}
    for test in tests:
        mine = np.zeros(len(y), dtype=bool)
        groups, others = set(), set()
        for one, part in zip(system.series, slices, strict=True):
            mine[part] = one.test == test
            (groups if one.test == test else others).add(one.constants)
        if not groups <= others:
            continue
        free = np.linalg.norm(J[~mine], axis=0) > 1e-9 * np.linalg.norm(J, axis=0)
        step = np.zeros(J.shape[1])
        step[free] = _bounded(J[~mine][:, free], r[~mine], fit.model, free)
        rest = (r - J @ step) * sd
        errors = [
            np.sqrt(np.mean(rest[part] ** 2)) / largest[one.curve]
            for one, part in zip(system.series, slices, strict=True)
            if one.test == test
        ]
        found[test] = float(np.mean(errors))
    return found


def _bounded(J: np.ndarray, r: np.ndarray, model: Hypothesis, free: np.ndarray) -> np.ndarray:
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    low = np.array([p.low for p in model.parameters])[free] - model.x[free]
    high = np.array([p.high for p in model.parameters])[free] - model.x[free]
    return _step(J / size, r, size * low, size * high, 1e-9) / size


def _step(J: np.ndarray, r: np.ndarray, low: np.ndarray, high: np.ndarray, damping: float) -> np.ndarray:
    """min |J p - r|^2 + damping |p|^2 between bounds; the columns of J are of unit length."""
    Q, R = np.linalg.qr(J)
    top = np.concatenate([R, np.sqrt(damping) * np.eye(J.shape[1])])
    right = np.concatenate([Q.T @ r, np.zeros(J.shape[1])])
    gap = 1e-12 + 1e-9 * np.abs(high - low)
    return lsq_linear(top, right, bounds=(np.minimum(low, 0.0) - gap, np.maximum(high, 0.0) + gap), method="bvls").x


def _one(system: System, model: Hypothesis) -> np.ndarray | None:
    (found,) = system.answers([model])
    if found is None:
        return None
    rows = stacked(found)
    return rows if np.isfinite(rows).all() else None
