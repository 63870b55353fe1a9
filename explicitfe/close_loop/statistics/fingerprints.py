"""What each candidate would do to the data, how much of the residual it explains, and how likely that is by chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import f as f_distribution

from explicitfe.close_loop.statistics.covariance import Covariance, stacked
from explicitfe.close_loop.statistics.noise import smooth_basis
from explicitfe.close_loop.statistics.refit import Fitted
from explicitfe.close_loop.statistics.system import Candidate, System

DRAWS = 20_000  # of the bootstrap
LEVEL = 0.01  # below, a p-value is significant
IMITATED = 0.3  # sine of the angle between a smooth function and what the constants can do: below, it is theirs
DISTINCT = 25.0  # |y_A - y_B|^2 in the metric of Sigma^-1 from which on two models are told apart
SIGNIFICANT, NOT_SIGNIFICANT, NOT_TESTABLE, FAILED = "significant", "not-significant", "not-testable", "failed"


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """A candidate's secants, whitened and without what the model's own parameters can imitate.

    Attributes
    ----------
    secants : (n, m), y(strength) - y(0) of each trial.
    values : of the parameters in each trial.
    limits, plausible : (m,) how many times its secant a trial may grow until the strength is at its bound, and until it is the
        largest plausible one.
    """

    candidate: Candidate
    secants: np.ndarray
    values: tuple[tuple[float, ...], ...]
    limits: np.ndarray
    plausible: np.ndarray

    @property
    def visible(self) -> float:
        """|secant|^2 of the largest plausible strength, of the shape that shows most."""
        return float(((self.secants * self.plausible) ** 2).sum(axis=0).max(initial=0.0))


@dataclass(frozen=True)
class Score:
    """How a candidate fares, before it is fitted.

    Attributes
    ----------
    status : significant | not-significant | not-testable | failed.
    drop : of chi2 by the best trial.
    p, p_holm : of such a drop by chance, for this candidate alone and among all of them.
    values : of the parameters that explain most, the strength grown as it explains most.
    reason : in words.
    """

    candidate: Candidate
    status: str
    drop: float
    p: float
    p_holm: float
    values: tuple[float, ...]
    reason: str


def outside(J: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """What of the columns lies outside the span of J."""
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    U = U[:, s > 1e-10 * max(s.max(initial=0.0), 1e-300)]
    return columns - U @ (U.T @ columns)


def fingerprints(system: System, fit: Fitted, covariance: Covariance, candidates: Sequence[Candidate]) -> list[Fingerprint]:
    """Secants of all testable candidates, from one model at its best."""
    jobs: list[tuple[Candidate, tuple[float, ...], tuple[float, ...] | None]] = []
    for c in candidates:
        for number, row in enumerate(c.trials if not c.reason else ()):
            jobs += [(c, values, c.reference[number] if c.reference else None) for values in row]
    plain = system.sketch(fit.model)
    tried = system.answers([(fit.model if zero is None else plain).plus(c.term, values) for c, values, zero in jobs])
    without = list(dict.fromkeys((id(c), zero) for c, _, zero in jobs if zero is not None))
    terms = {id(c): c.term for c in candidates}
    zeros = dict(zip(without, system.answers([plain.plus(terms[key], zero) for key, zero in without]), strict=True))
    found = []
    for candidate in candidates:
        if candidate.reason:
            continue
        columns, kept, limits, plausible = [], [], [], []
        for (c, values, zero), answer in zip(jobs, tried, strict=True):
            before = None if zero is None else zeros[id(c), zero]
            if c is not candidate or answer is None or (zero is not None and before is None):
                continue
            columns.append(stacked(answer) - (fit.answer if before is None else stacked(before)))
            kept.append(values)
            bound, usual = _room(candidate, values)
            limits.append(bound)
            plausible.append(usual)
        secants = np.array(columns).T if columns else np.zeros((len(fit.answer), 0))
        if columns:
            secants = outside(fit.movable, covariance.whiten(secants))
        found.append(Fingerprint(candidate, secants, tuple(kept), np.array(limits), np.array(plausible)))
    return found


def _room(candidate: Candidate, values: tuple[float, ...]) -> tuple[float, float]:
    """How many times the strength of a trial goes into its bound, and into the largest plausible one of its sign."""
    strength = candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    way = strength.coordinate(values[0]) - none
    bound = strength.coordinate(strength.high if way > 0.0 else strength.low)
    usual = max((strength.coordinate(v) - none) / way for v in strength.values)
    return max((bound - none) / way, 1.0), max(usual, 1.0)


def _grown(candidate: Candidate, values: tuple[float, ...], times: float) -> tuple[float, ...]:
    """Values with the strength's coordinate multiplied, well inside its bounds."""
    strength = candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    ends = sorted(strength.coordinate(v) for v in (strength.low, strength.high))
    room = 0.05 * (ends[1] - ends[0])
    x = none + times * (strength.coordinate(values[0]) - none)
    inside = np.clip(x, ends[0] + room * (none > ends[0]), ends[1] - room * (none < ends[1]))
    return (strength.value(float(inside)), *values[1:])


def explained(along: np.ndarray, size: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Largest drop of chi2 by an amplitude between 0 and its limit; ``along`` is secant . residual, ``size`` |secant|^2."""
    amplitude = np.clip(along / np.maximum(size, 1e-300), 0.0, limits)
    return 2.0 * amplitude * along - amplitude**2 * size


def scores(
    fit: Fitted, prints: Sequence[Fingerprint], candidates: Sequence[Candidate], seed: int = 0, draws: int = DRAWS
) -> list[Score]:
    """Each candidate's best drop of chi2 and its p-value, by a parametric bootstrap of the search over its trials (the shape
    exists only where the effect does), then by Holm (1979) over the candidates.
    """
    rest = outside(fit.movable, fit.residual)
    testable = [p for p in prints if p.visible >= DISTINCT]
    drops, best, chance = [], [], []
    if testable:
        every = np.concatenate([p.secants for p in testable], axis=1)
        size = (every**2).sum(axis=0)
        unit = every / np.sqrt(np.maximum(size, 1e-300))
        _, s, V = np.linalg.svd(unit, full_matrices=False)
        random = np.random.default_rng(seed)
        drawn = (random.standard_normal((draws, len(s))) * s) @ V * np.sqrt(size)
        limits = np.concatenate([p.limits for p in testable])
        by_chance = explained(drawn, size, limits)
        seen = explained(every.T @ rest, size, limits)
        start = 0
        for p in testable:
            part = slice(start, start + p.secants.shape[1])
            start = part.stop
            drops.append(float(seen[part].max()))
            number = int(np.argmax(seen[part]))
            along = float(p.secants[:, number] @ rest) / max(float(size[part][number]), 1e-300)
            best.append(_grown(p.candidate, p.values[number], float(np.clip(along, 0.02, p.limits[number]))))
            chance.append((1.0 + float((by_chance[:, part].max(axis=1) >= drops[-1]).sum())) / (draws + 1.0))
    adjusted = holm(chance)
    by_name = {id(p.candidate): (d, b, c, a) for p, d, b, c, a in zip(testable, drops, best, chance, adjusted, strict=True)}
    found = []
    for candidate in candidates:
        mine = next((p for p in prints if p.candidate is candidate), None)
        if mine is None:
            found.append(Score(candidate, NOT_TESTABLE, 0.0, 1.0, 1.0, (), candidate.reason))
        elif id(candidate) in by_name:
            drop, values, p, p_holm = by_name[id(candidate)]
            status = SIGNIFICANT if p_holm < LEVEL else NOT_SIGNIFICANT
            reason = "explains more than chance would" if status == SIGNIFICANT else "explains no more than chance may"
            found.append(Score(candidate, status, drop, p, p_holm, values, reason))
        elif not mine.values:
            found.append(Score(candidate, FAILED, 0.0, 1.0, 1.0, (), "the model cannot be computed with it"))
        else:
            reason = f"even the largest plausible one stays under the floors ({mine.visible:.2g} where {DISTINCT:g} is needed)"
            found.append(Score(candidate, NOT_TESTABLE, 0.0, 1.0, 1.0, (), reason))
    return found


def holm(p: Sequence[float]) -> list[float]:
    """p-values adjusted for their number, step-down."""
    order = np.argsort(p)
    adjusted = np.zeros(len(p))
    worst = 0.0
    for rank, k in enumerate(order):
        worst = max(worst, min(1.0, (len(p) - rank) * p[k]))
        adjusted[k] = worst
    return adjusted.tolist()


@dataclass(frozen=True)
class LackOfFit:
    """What a smooth curve would explain of a residual.

    Attributes
    ----------
    chi2, free : whitened sum of squares along smooth functions outside the model's span, and their number.
    p : of so much by chance.
    """

    chi2: float
    free: int
    p: float

    @property
    def excess(self) -> float:
        """chi2 above what noise alone gives."""
        return max(self.chi2 - self.free, 0.0)


def lack_of_fit(fit: Fitted, covariance: Covariance) -> LackOfFit:
    """Test of a residual against smooth functions of the programme: physics is smooth between bends, noise of rows is not.

    The plain sum over all rows would test the stated noise rather than the model: 5 % more noise in a thousand rows is
    significant there. Where the noise was estimated from what a smooth curve leaves, the test is an F-test.
    """
    blocks = []
    total = len(fit.answer)
    for one, part in zip(covariance.series, covariance.slices(), strict=True):
        basis = smooth_basis(one)
        block = np.zeros((total, basis.shape[1]))
        block[part] = basis
        blocks.append(block)
    directions = covariance.whiten(np.concatenate(blocks, axis=1))
    directions, _ = np.linalg.qr(directions / np.linalg.norm(directions, axis=0))
    U, s, _ = np.linalg.svd(outside(fit.movable, directions), full_matrices=False)
    # What is left of a direction that the constants imitate nearly is the noise of the imposed column in their derivatives.
    U = U[:, s > IMITATED]
    along = U.T @ outside(fit.movable, fit.residual)
    free, size = U.shape[1], float(along @ along)
    if not free:
        p = 1.0
    elif all(row.stated for row in covariance.rows):
        p = float(chi2_distribution.sf(size, free))
    else:
        left = max(covariance.effective - free, 5.0)
        p = float(f_distribution.sf(size / free, free, left))
    return LackOfFit(size, free, p)
