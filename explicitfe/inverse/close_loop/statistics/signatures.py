"""Signatures: what each candidate changes in the prediction, whitened, and how much of a residual such changes explain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, outside
from explicitfe.inverse.close_loop.statistics.refit import BestFit
from explicitfe.inverse.close_loop.statistics.system import Candidate, Hypothesis, System

# A fit begins with a strength of at least this share of the trial, and inside the bounds by this share of their range.
LEAST_START_SHARE, BOUND_MARGIN_SHARE = 0.02, 0.05

Changes = Sequence[np.ndarray | None]  # (n,) SI of each trial; None where it cannot be computed


@dataclass(frozen=True, eq=False)
class Signature:
    """A candidate's secants, whitened and without what the model's own parameters imitate.

    Attributes
    ----------
    secants : (n, m), y(strength) - y(0) of each trial.
    values : the parameters of each trial.
    limits : (m,) factor of each trial's strength that reaches its bound.
    plausible : (m,) factor of each trial's strength that reaches the largest plausible strength.
    """

    candidate: Candidate
    secants: np.ndarray
    values: tuple[tuple[float, ...], ...]
    limits: np.ndarray
    plausible: np.ndarray

    @property
    def visible(self) -> float:
        """Decrease of chi2 by the largest plausible strength, with the shape that is most visible."""
        return float(((self.secants * self.plausible) ** 2).sum(axis=0).max(initial=0.0))


def signatures(
    fit: BestFit, covariance: Covariance, candidates: Sequence[Candidate], table: Sequence[Changes]
) -> list[Signature]:
    """Signatures of candidates near one model at its best.

    Parameters
    ----------
    table : changes of each candidate's trials.
    """
    computed_signatures = []
    for candidate, columns in zip(candidates, table, strict=True):
        computed = [(values, d) for values, d in zip(candidate.trials, columns, strict=True) if d is not None]
        rows = len(fit.answer)
        raw = np.array([d for _, d in computed]).reshape(len(computed), rows).T
        limits, plausible = np.array([_room(candidate, values) for values, _ in computed]).reshape(len(computed), 2).T
        secants = outside(fit.movable, covariance.whiten(raw)) if computed else raw
        computed_signatures.append(Signature(candidate, secants, tuple(values for values, _ in computed), limits, plausible))
    return computed_signatures


def signatures_beside(
    system: System,
    table: Mapping[str, tuple[Candidate, Changes]],
    fit: BestFit,
    covariance: Covariance,
    candidates: Sequence[Candidate],
    model: Hypothesis | None = None,
) -> list[Signature]:
    """Signatures near a fitted model, or near another.

    Parameters
    ----------
    table : effect -> its candidate, and what its trials change: of those that take the run of a mesh.
    """
    own = {c.effect: replace(c, trials=table[c.effect][0].trials) for c in candidates if c.effect in table}
    others = [c for c in candidates if c.effect not in own]
    new = system.changes(model or fit.model, others) if others else []
    changes = dict(zip([c.effect for c in others], new, strict=True))
    changes |= {name: list(table[name][1]) for name in own}
    every = [own.get(c.effect, c) for c in candidates]
    return signatures(fit, covariance, every, [changes[c.effect] for c in every])


def _room(candidate: Candidate, values: tuple[float, ...]) -> tuple[float, float]:
    """Factors by which the strength of a trial reaches its bound, and the largest plausible one of its sign."""
    strength = candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    size = strength.coordinate(values[0]) - none
    bound = strength.coordinate(strength.high if size > 0.0 else strength.low)
    usual = max((strength.coordinate(v) - none) / size for v in strength.values)
    return max((bound - none) / size, 1.0), max(usual, 1.0)


def scaled_trial(candidate: Candidate, values: tuple[float, ...], factor: float) -> tuple[float, ...]:
    """Values of a trial with the coordinate of the strength multiplied, well inside its bounds."""
    strength = candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    ends = sorted(strength.coordinate(v) for v in (strength.low, strength.high))
    room = BOUND_MARGIN_SHARE * (ends[1] - ends[0])
    x = none + max(factor, LEAST_START_SHARE) * (strength.coordinate(values[0]) - none)
    inside = np.clip(x, ends[0] + room * (none > ends[0]), ends[1] - room * (none < ends[1]))
    return (strength.value(float(inside)), *values[1:])


# Noise along one direction, in standard deviations.
NOISE_SDS = 2.0


class EstimatedFit(NamedTuple):
    """What a fit would leave, by an estimate.

    Attributes
    ----------
    chi2 : whitened sum of squares that it would leave.
    change : whitened norm of the change of the prediction by the effects; the relative error of the estimate refers to it.
    fast : the estimate is a fit with fast answers, and not one of signatures.
    """

    chi2: float
    change: float
    fast: bool

    def possible_gain(self, error_share: float, rows: int) -> float:
        """Largest further decrease of chi2 by a true fit, for a relative error of the change of the prediction.

        The error can at most remove the misfit beyond noise (``rows`` is its expected chi2) and noise along one direction.
        """
        along = float(np.sqrt(max(self.chi2 - rows, 0.0))) + NOISE_SDS
        return float(along**2 - max(along - error_share * self.change, 0.0) ** 2)

    def error_of(self, chi2: float) -> float:
        """Relative error of the estimate, by the chi2 of a true fit; relative to the residual where the change is smaller."""
        return max(float(np.sqrt(self.chi2) - np.sqrt(chi2)), 0.0) / max(self.change, float(np.sqrt(chi2)), 1e-300)


@dataclass(frozen=True)
class Screening:
    """What candidates explain of a residual together, where the prediction is linear in their strengths.

    Attributes
    ----------
    gain : decrease of chi2 by one trial of each candidate at its best strength.
    bound : decrease by any non-negative combination of all their trials: an upper bound over the shapes between the trials.
    change : whitened norm of the change of the prediction.
    starts : values of each candidate's parameters with which a fit begins.
    """

    gain: float
    bound: float
    change: float
    starts: tuple[tuple[float, ...], ...]


def screen(residual: np.ndarray, members: Sequence[Signature]) -> Screening:
    """Decrease of chi2 by some candidates together, from their signatures and the whitened residual (n,)."""
    columns = np.concatenate([one.secants for one in members], axis=1)
    owner = np.repeat(np.arange(len(members)), [one.secants.shape[1] for one in members])
    size = np.linalg.norm(columns, axis=0)
    if not len(size) or not size.any():
        return Screening(0.0, 0.0, 0.0, tuple(one.candidate.trials[0] for one in members))
    unit = columns / np.maximum(size, 1e-300)
    Q, R = np.linalg.qr(unit)
    mixed, left = nnls(R, Q.T @ residual)
    inside = float(np.sum((Q.T @ residual) ** 2))
    best = []
    for number in range(len(members)):
        own = np.flatnonzero(owner == number)
        alone = np.maximum(unit[:, own].T @ residual, 0.0)
        best.append(int(own[np.argmax(mixed[own] if mixed[own].any() else alone)]))
    q, r = np.linalg.qr(unit[:, best])
    amplitudes, _ = nnls(r, q.T @ residual)
    limits = np.concatenate([one.limits for one in members])[best]
    factors = np.minimum(amplitudes / np.maximum(size[best], 1e-300), limits)
    change = columns[:, best] @ factors
    gain = float(2.0 * residual @ change - change @ change)
    starts = tuple(
        scaled_trial(one.candidate, one.values[k - int(np.searchsorted(owner, number))], float(f))
        for number, (one, k, f) in enumerate(zip(members, best, factors, strict=True))
    )
    return Screening(max(gain, 0.0), max(inside - left**2, gain, 0.0), float(np.linalg.norm(change)), starts)
