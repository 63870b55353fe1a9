"""Weighted least squares with bounds.

Every evaluation may be a finite-element run. Derivatives are therefore taken once, all at a time, and are then kept up to date
from the steps themselves (Broyden 1965, Schubert 1970).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, measured_rows, stack
from explicitfe.inverse.close_loop.statistics.system import Answer, Answering, Hypothesis, System, steps_of, values_by_name
from explicitfe.platform.errors import InputError, RunError

# Names with ROUGH are for answers with numerical roughness, such as those of a coarse mesh.
# The search ends where a further step would gain less chi2 than the sum of this number and of this share of chi2; where every
# answer is a run of a mesh, sooner.
ENOUGH_CHI2, ENOUGH_CHI2_SHARE = 0.02, 1e-5
COSTLY_ENOUGH_CHI2, COSTLY_ENOUGH_CHI2_SHARE = 0.5, 3e-3
# A search that ended otherwise has still converged if a further step would gain less than this share of chi2.
STALLED_CHI2_SHARE, ROUGH_STALLED_CHI2_SHARE = 1e-2, 1e-1
MOST_REFIT_STEPS, MOST_STEPS_WITH_SLOPES, ROUGH_MOST_STEPS = 40, 12, 8
# A search of costly answers ends after so many steps in a row that led nowhere: the answers are too rough to go on.
COSTLY_VAIN_STEPS = 3
# So often derivatives are taken again where answers are rough; elsewhere they may be at every step.
ROUGH_NEW_DERIVATIVES = 1
# Derivatives are taken again where a step gains less than this share of what they promised.
POOR_GAIN_SHARE = 0.25
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e8
# After a trial that cannot be computed, or that was costly and in vain, steps are at most about half as long. Each further one
# would be a run that fails again.
DAMPING_AFTER_FAILURE = 1.0
# Damping of the steps in cross-validation, which only has to keep them finite.
SMALLEST_DAMPING = 1e-9
# A parameter this near to an end of its range, as a share of the range, is at its bound.
BOUND_SHARE = 1e-6
# Mean square of the residual over the noise of the rows from which on a misfit is gross: against it the scatter between equal
# tests would be used up, so the model is fitted as if they did not differ.
GROSS_MISFIT = 9.0
# A search that gave up begins again with each coordinate moved by this share of its typical length, to either side.
MOVED_START_SHARE = 0.5
# The forward model is taken again at the parameters of a fit so often: they move little, and the model less.
MOST_RENEWALS = 1
# Shares of the strengths of all effects that are tried where a search begins, until the model can be computed.
START_STRENGTH_SHARES = (1.0, 0.5, 0.25, 0.1, 0.0)
# A parameter on which the other tests depend by less than this share of what all tests do stays where it is.
UNSEEN_SHARE = 1e-9


Slopes = Callable[[Hypothesis], np.ndarray | None]


@dataclass(frozen=True, eq=False)
class BestFit:
    """A model at its best.

    Attributes
    ----------
    model : with the best parameters.
    answer : (n,) SI of all rows.
    slopes : (n, p) SI, its derivatives by the coordinates.
    residual, jacobian : (n,) target - answer and (n, p) slopes, whitened.
    at_bound : names of parameters at a bound.
    converged : False where the search gave up, which says nothing about the model.
    by_rows : sum of squares by the noise of the rows alone where the misfit is gross; None elsewhere.
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
        """The sum of squares that the fit made small: by the rows alone where the misfit is gross, else by Sigma."""
        return self.whitened if self.by_rows is None else self.by_rows

    @property
    def whitened(self) -> float:
        """The sum of squares whitened by Sigma, in which fingerprints are counted."""
        return float(self.residual @ self.residual)

    @property
    def movable(self) -> np.ndarray:
        """The whitened derivatives (n, q) by the parameters that can move: one that is pressed against its bound cannot."""
        low, high = (np.array([getattr(p, end) for p in self.model.parameters]) for end in ("low", "high"))
        edge = BOUND_SHARE * (high - low)
        push = self.jacobian.T @ self.residual
        stuck = ((self.model.x <= low + edge) & (push < 0.0)) | ((self.model.x >= high - edge) & (push > 0.0))
        return self.jacobian[:, ~stuck]


def refit(
    system: Answering,
    start: Hypothesis,
    covariance: Covariance,
    target: np.ndarray | None = None,
    slopes: np.ndarray | None = None,
    renew: Slopes | None = None,
) -> BestFit:
    """The best parameters of a model, by the method of Levenberg and Marquardt inside the bounds; never worse than the start.

    Parameters
    ----------
    start : the model with parameters to begin with.
    target : (n,) SI; what is to be met, the measured rows if left out.
    slopes : (n, p) SI; derivatives near the start, NaN where they are unknown. They are used where an answer takes the run of a
        mesh, because they save many runs.
    renew : fast derivatives at any model, used in the same way wherever they are taken.

    Raises
    ------
    RunError : the model cannot be computed where the search begins, nor with weaker effects.
    """
    y = measured_rows(system.series) if target is None else target
    low = np.array([p.low for p in start.parameters])
    high = np.array([p.high for p in start.parameters])
    model, answer = _computable(system, start.at(np.clip(start.x, low, high)))
    if slopes is None and renew is not None:
        slopes = renew(model)
    if slopes is not None and system.has_slopes(start) and np.array_equal(model.x, start.x):
        position = _Position(model, answer, slopes, True, False)
    elif slopes is None or system.exact(start):
        position = _Position(model, answer, derivatives(system, model, answer), True, False)
    else:
        position = _Position(model, answer, derivatives(system, model, answer, slopes), False, False)
    # The model is first fitted to the rows alone. Against a gross misfit no scale of a test and no error of a length is unlikely
    # enough: all would be spent on it, and the constants would go anywhere.
    rows, alike = covariance.of_rows(), covariance.without_scatter()
    small = GROSS_MISFIT * len(y)

    begin = position
    by_rows: float | None = None
    if rows is not covariance and system.costly(start) and start.terms:
        # Both fits cost, and the second would be thrown away where the first leaves no gross misfit.
        weighted = _descend(system, position, covariance, y, renew)
        if _misfit(weighted, covariance, y) < small:
            return _best_fit(weighted, covariance, y, None)
    position = _descend(system, position, rows, y, renew)
    if _misfit(position, alike, y) >= small:
        by_rows = _misfit(position, rows, y)
    elif rows is not covariance:
        position = _descend(system, position, covariance, y, renew)
        if _misfit(begin, covariance, y) < _misfit(position, covariance, y):
            # The way by the rows alone led to a worse place than it began at.
            position = _descend(system, begin, covariance, y, renew)
    return _best_fit(position, covariance, y, by_rows)


def _computable(system: Answering, model: Hypothesis) -> tuple[Hypothesis, np.ndarray]:
    """The model with its answer (n,); with weaker effects where it cannot be computed as it is.

    An effect can leave a body too soft for an imposed force. The model without its strength is a subset of it, which was fitted.

    Raises
    ------
    RunError : nor can it be computed without the strength of its effects.
    """
    strengths = np.zeros(len(model.x), dtype=bool)
    none = np.zeros(len(model.x))
    at = len(model.base)
    for term in model.terms:
        sought = term.parameters[0].sought
        strengths[at], none[at] = True, sought.coordinate(sought.none)
        at += len(term.parameters)
    for share in START_STRENGTH_SHARES if model.terms else START_STRENGTH_SHARES[:1]:
        weaker = model.at(np.where(strengths, none + share * (model.x - none), model.x))
        answer = _answer_of(system, weaker)
        if answer is not None:
            return weaker, answer
    values = ", ".join(f"{name} = {value:.4g}" for name, value in values_by_name(model).items())
    weakened = ", nor with weaker effects" if model.terms else ""
    raise RunError(f"the model cannot be computed where its fit begins ({values}){weakened}.")


def _misfit(at: _Position, covariance: Covariance, y: np.ndarray) -> float:
    return float(np.sum(covariance.at(at.answer).whiten(y - at.answer) ** 2))


def fit_at(
    model: Hypothesis, answer: np.ndarray, slopes: np.ndarray, covariance: Covariance, target: np.ndarray, *, converged: bool
) -> BestFit:
    """The fit of a search that has ended at a model with an answer (n,) and derivatives (n, p) SI."""
    return _best_fit(_Position(model, answer, slopes, True, converged), covariance, target, None)


def _best_fit(position: _Position, covariance: Covariance, y: np.ndarray, by_rows: float | None) -> BestFit:
    """The end of a search as a fit."""
    low = np.array([p.low for p in position.model.parameters])
    high = np.array([p.high for p in position.model.parameters])
    edge = BOUND_SHARE * (high - low)
    at_bound = tuple(
        p.name
        for p, x, a, b, e in zip(position.model.parameters, position.model.x, low, high, edge, strict=True)
        if x <= a + e or x >= b - e
    )
    residual = covariance.at(position.answer).whiten(y - position.answer)
    J = _jacobian(covariance, y, position.answer, position.slopes)
    return BestFit(position.model, position.answer, position.slopes, residual, J, at_bound, position.converged, by_rows)


@dataclass(frozen=True, eq=False)
class _Position:
    """Where a search is; its slopes are ``fresh`` if they were taken just at its model."""

    model: Hypothesis
    answer: np.ndarray
    slopes: np.ndarray
    fresh: bool
    converged: bool


def _descend(system: Answering, position: _Position, covariance: Covariance, y: np.ndarray, renew: Slopes | None) -> _Position:
    """The least chi2 downhill from a position."""
    model, answer, slopes, fresh = position.model, position.answer, position.slopes, position.fresh
    exact = system.exact(position.model)
    costly = system.costly(position.model)
    enough, relative = (COSTLY_ENOUGH_CHI2, COSTLY_ENOUGH_CHI2_SHARE) if costly else (ENOUGH_CHI2, ENOUGH_CHI2_SHARE)
    low = np.array([p.low for p in model.parameters])
    high = np.array([p.high for p in model.parameters])
    r = covariance.at(answer).whiten(y - answer)
    damping, converged = FIRST_DAMPING, False
    renewals = MOST_REFIT_STEPS if exact else ROUGH_NEW_DERIVATIVES
    vain = 0
    included = system.has_slopes(position.model)
    most = MOST_STEPS_WITH_SLOPES if included else MOST_REFIT_STEPS
    for _ in range(most if exact else ROUGH_MOST_STEPS):
        J = _jacobian(covariance, y, answer, slopes)
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-12 * max(float(np.linalg.norm(J)), 1e-300))
        step = _step(J / size, r, size * (low - model.x), size * (high - model.x), damping) / size
        gain = float(r @ r - (r - J @ step) @ (r - J @ step))
        if gain < enough + relative * float(r @ r):
            if damping > FIRST_DAMPING:
                break  # the step is small because no larger one was better or could be computed, so this may be no optimum
            if fresh or not exact:
                converged = True
                break
            slopes, fresh = derivatives(system, model, answer, renew and renew(model)), True
            continue
        moved = model.at(np.clip(model.x + step, low, high))
        new = _answer_of(system, moved)
        better = False
        if new is None:
            damping = max(damping, DAMPING_AFTER_FAILURE)
        else:
            left = covariance.at(new).whiten(y - new)
            better = float(left @ left) < float(r @ r)
            if better:
                fast = None if renew is None else renew(moved)
                poor = float(r @ r - left @ left) < POOR_GAIN_SHARE * gain
                slopes = derivatives(system, moved, new) if included else _update(slopes, new - answer, moved.x - model.x, fast)
                model, answer, r, fresh = moved, new, left, included
                damping *= 1.0 if poor else 0.1
        vain = 0 if better else vain + 1
        if better and not poor:
            continue
        if costly and vain >= COSTLY_VAIN_STEPS:
            break
        if not fresh and renewals > 0 and not included:
            slopes, fresh, renewals = derivatives(system, model, answer, renew and renew(model)), True, renewals - 1
        elif not better:
            damping = max(10.0 * damping, DAMPING_AFTER_FAILURE) if costly else 10.0 * damping
            if damping > LARGEST_DAMPING:
                break  # no direction leads downhill
    # Rough answers have no exact minimum, so it is enough to be near it.
    if not converged:
        J = _jacobian(covariance, y, answer, slopes)
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-12 * max(float(np.linalg.norm(J)), 1e-300))
        step = _step(J / size, r, size * (low - model.x), size * (high - model.x), FIRST_DAMPING) / size
        gain = float(r @ r - (r - J @ step) @ (r - J @ step))
        converged = gain < max(enough, (STALLED_CHI2_SHARE if exact else ROUGH_STALLED_CHI2_SHARE) * float(r @ r))
    return _Position(model, answer, slopes, fresh, converged)


def _update(slopes: np.ndarray, change: np.ndarray, step: np.ndarray, fast: np.ndarray | None = None) -> np.ndarray:
    """Derivatives (n, p) that give the change (n,) along a step (p,); a zero among them stays zero (Schubert 1970).

    A test therefore learns nothing from what the constants of other tests did. Fast derivatives are taken where they are finite.
    """
    open_ones = np.ones(slopes.shape, dtype=bool) if fast is None else ~np.isfinite(fast)
    slopes = slopes if fast is None else np.where(open_ones, slopes, fast)
    steps = np.where(open_ones & (slopes != 0.0), step, 0.0)
    length = np.maximum((steps**2).sum(axis=1), 1e-300)
    return slopes + ((change - slopes @ step) / length)[:, None] * steps


def _jacobian(covariance: Covariance, y: np.ndarray, answer: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Slopes whitened at an answer; the likely scale of a test multiplies them as it multiplies the answer."""
    local = covariance.at(answer)
    return local.whiten(local.scaled_slopes(y - answer, slopes))


def derivatives(system: Answering, model: Hypothesis, now: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
    """Derivatives (n, p) SI of the answer ``now`` by the coordinates, taken to one side.

    Parameters
    ----------
    known : (n, p) derivatives; only the columns that are not finite are computed.

    The side is the one inside the bounds on which the model can be computed. A parameter with no such side has the derivative 0,
    so that it stays where it is.
    """
    steps = steps_of(system, model)
    wanted = [k for k in range(len(steps)) if known is None or not np.isfinite(known[:, k]).all()]
    answers: list[Answer | None] = [None] * len(steps)
    for k, answer in zip(wanted, system.answers([model.shifted(k, steps[k]) for k in wanted]), strict=True):
        answers[k] = answer
    back = [k for k in wanted if answers[k] is None and model.parameters[k].low <= model.x[k] - steps[k]]
    for k, answer in zip(back, system.answers([model.shifted(k, -steps[k]) for k in back]), strict=True):
        answers[k], steps[k] = answer, -steps[k]
    columns = []
    for k, (answer, step) in enumerate(zip(answers, steps, strict=True)):
        if known is not None and k not in wanted:
            columns.append(known[:, k])
        else:
            columns.append(np.zeros(len(now)) if answer is None else (stack(answer) - now) / step)
    return np.array(columns).reshape(len(columns), len(now)).T  # (n, 0) where nothing is fitted


def step_inside_bounds(J: np.ndarray, r: np.ndarray, model: Hypothesis, free: np.ndarray) -> np.ndarray:
    """The step of the free parameters (q,) that makes |J step - r| least inside their bounds."""
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    low = np.array([p.low for p in model.parameters])[free] - model.x[free]
    high = np.array([p.high for p in model.parameters])[free] - model.x[free]
    return _step(J / size, r, size * low, size * high, SMALLEST_DAMPING) / size


def _step(J: np.ndarray, r: np.ndarray, low: np.ndarray, high: np.ndarray, damping: float) -> np.ndarray:
    """min |J p - r|^2 + damping |p|^2 between bounds; the columns of J are of unit length."""
    Q, R = np.linalg.qr(J)
    top = np.concatenate([R, np.sqrt(damping) * np.eye(J.shape[1])])
    right = np.concatenate([Q.T @ r, np.zeros(J.shape[1])])
    gap = 1e-12 + 1e-9 * np.abs(high - low)
    return lsq_linear(top, right, bounds=(np.minimum(low, 0.0) - gap, np.maximum(high, 0.0) + gap), method="bvls").x


def _answer_of(system: Answering, model: Hypothesis) -> np.ndarray | None:
    """What a model answers (n,) SI; None where it cannot be computed."""
    try:
        (answer,) = system.answers([model])
    except InputError:  # a value that no model file may have
        return None
    if answer is None:
        return None
    rows = stack(answer)
    return rows if np.isfinite(rows).all() else None


def _quality(fit: BestFit) -> tuple[bool, float]:
    """Smaller is better; a gross misfit is worse than any other, and its chi2 is that by the rows alone."""
    return fit.by_rows is not None, fit.chi2


def settled(system: Answering, fit: BestFit, covariance: Covariance, renew: Slopes | None = None) -> BestFit:
    """The fit itself, or where its search gave up the best of several.

    It begins again where it stopped, with new derivatives, and then to either side. The answers of a mesh, which are rough, can
    stop a search that has arrived; two searches that end about as low confirm each other.
    """
    ends, best = [fit], fit
    for share in (0.0, -MOVED_START_SHARE, MOVED_START_SHARE):
        if best.converged:
            break
        try:
            ends.append(refit(system, _moved(best.model, share), covariance, renew=renew))
        except RunError:
            continue  # no model there: the next start may have one
        best = min(ends, key=_quality)
        alike = [end for end in ends if (end.by_rows is None) == (best.by_rows is None)]
        as_low = sum(end.chi2 <= (1.0 + ROUGH_STALLED_CHI2_SHARE) * best.chi2 for end in alike)
        confirmed = as_low > 1 and system.costly(best.model)
        best = replace(best, converged=best.converged or confirmed)
    return best


def _moved(model: Hypothesis, share: float) -> Hypothesis:
    """A model with each coordinate moved by a share of its typical length, inside its bounds."""
    low, high, typical = (np.array([getattr(p, key) for p in model.parameters]) for key in ("low", "high", "typical"))
    return model.at(np.clip(model.x + share * typical, low, high))


def renewed(
    system: System,
    fit: BestFit,
    covariance: Covariance,
    times: int = MOST_RENEWALS,
    renew: Slopes | None = None,
) -> tuple[System, BestFit]:
    """A fit with the forward model that is best at its own parameters, which is taken again as they move; and that model."""
    for _ in range(times):
        here = system.at(fit.model)
        if here is system:
            break
        system, fit = here, refit(here, fit.model, covariance, slopes=fit.slopes, renew=renew)
    return system, fit
