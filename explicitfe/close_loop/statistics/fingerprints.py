"""What each candidate would do to the data, how much of the residual it explains, and how likely that is by chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import f as f_distribution

from explicitfe.close_loop.statistics.covariance import Covariance, measured_rows, outside, stack
from explicitfe.close_loop.statistics.noise import smooth_basis
from explicitfe.close_loop.statistics.refit import BestFit
from explicitfe.close_loop.statistics.system import Candidate, System
from explicitfe.close_loop.thresholds import THRESHOLDS

# Draws of the bootstrap: a p-value of one per cent is then known to a tenth of itself.
BOOTSTRAP_DRAWS = 20_000
# A trial's strength is no smaller than this share of what was tried, so that a fit begins away from no effect.
SMALLEST_GROWTH = 0.02
# A fit begins inside the bounds of a strength by this share of its range.
BOUND_MARGIN_SHARE = 0.05
# The F-test takes the noise for known no better than from so many rows.
LEAST_DEGREES_OF_NOISE = 5.0
# A search that has to begin elsewhere begins at no more trials than this.
OTHER_STARTS = 2

Status = Literal["significant", "not-significant", "not-testable", "failed"]
SIGNIFICANT: Status = "significant"
NOT_SIGNIFICANT: Status = "not-significant"
NOT_TESTABLE: Status = "not-testable"
FAILED: Status = "failed"


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """A candidate's secants, whitened and without what the model's own parameters can imitate.

    Attributes
    ----------
    secants : (n, m), y(strength) - y(0) of each trial.
    changes : (n, m) SI, the same as they are.
    values : the parameters of each trial.
    limits : (m,) by how many times the strength of each trial may grow until it is at its bound.
    plausible : (m,) the same until it is the largest plausible strength.
    """

    candidate: Candidate
    secants: np.ndarray
    changes: np.ndarray
    values: tuple[tuple[float, ...], ...]
    limits: np.ndarray
    plausible: np.ndarray

    @property
    def visible(self) -> float:
        """|secant|^2 of the largest plausible strength, with the shape that shows most."""
        return float(((self.secants * self.plausible) ** 2).sum(axis=0).max(initial=0.0))


@dataclass(frozen=True)
class Score:
    """How a candidate fares, before it is fitted.

    Attributes
    ----------
    drop : by how much the best trial lowers chi2.
    promise : by how much it lowers what a fit makes small: the same, but where the misfit is gross; there chi2 of the rows alone.
    p, p_holm : p-value of such a drop by chance, for this candidate alone and among all of them.
    p_is_bound : both are upper bounds, because no draw of the bootstrap reached the drop.
    values : parameters that explain most, with the strength that explains most.
    reason : for the status, in words.
    others : the same of the trials that explain most after that, for searches that have to begin elsewhere.
    """

    candidate: Candidate
    status: Status
    drop: float
    p: float
    p_holm: float
    values: tuple[float, ...]
    reason: str
    p_is_bound: bool = False
    others: tuple[tuple[float, ...], ...] = ()
    promise: float = 0.0


def fingerprints(system: System, fit: BestFit, covariance: Covariance, candidates: Sequence[Candidate]) -> list[Fingerprint]:
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
    prints = []
    for candidate in candidates:
        if candidate.reason:
            continue
        columns: list[np.ndarray] = []
        computed: list[tuple[float, ...]] = []
        limits, plausible = [], []
        for (c, values, zero), answer in zip(jobs, tried, strict=True):
            before = None if zero is None else zeros[id(c), zero]
            if c is not candidate or answer is None or (zero is not None and before is None):
                continue
            columns.append(stack(answer) - (fit.answer if before is None else stack(before)))
            computed.append(values)
            bound, usual = _room(candidate, values)
            limits.append(bound)
            plausible.append(usual)
        changes = np.array(columns).T if columns else np.zeros((len(fit.answer), 0))
        secants = outside(fit.movable, covariance.whiten(changes)) if columns else changes
        prints.append(Fingerprint(candidate, secants, changes, tuple(computed), np.array(limits), np.array(plausible)))
    return prints


def _room(candidate: Candidate, values: tuple[float, ...]) -> tuple[float, float]:
    """How many times the strength of a trial goes into its bound, and into the largest plausible one of its sign."""
    strength = candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    size = strength.coordinate(values[0]) - none
    bound = strength.coordinate(strength.high if size > 0.0 else strength.low)
    usual = max((strength.coordinate(v) - none) / size for v in strength.values)
    return max((bound - none) / size, 1.0), max(usual, 1.0)


def grow(candidate: Candidate, values: tuple[float, ...], times: float) -> tuple[float, ...]:
    """Values of a trial with the strength's coordinate multiplied, well inside its bounds."""
    strength = candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    ends = sorted(strength.coordinate(v) for v in (strength.low, strength.high))
    room = BOUND_MARGIN_SHARE * (ends[1] - ends[0])
    x = none + times * (strength.coordinate(values[0]) - none)
    inside = np.clip(x, ends[0] + room * (none > ends[0]), ends[1] - room * (none < ends[1]))
    return (strength.value(float(inside)), *values[1:])


def largest_drop(along: np.ndarray, size: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """The largest drop of chi2 by an amplitude between 0 and its limit.

    Parameters
    ----------
    along, size, limits : (m,) secant . residual, |secant|^2, and the largest amplitude of each trial.
    """
    amplitude = np.clip(along / np.maximum(size, 1e-300), 0.0, limits)
    return 2.0 * amplitude * along - amplitude**2 * size


def scores(
    fit: BestFit, prints: Sequence[Fingerprint], candidates: Sequence[Candidate], seed: int = 0, draws: int = BOOTSTRAP_DRAWS
) -> list[Score]:
    """Each candidate's best drop of chi2 and its p-value.

    The p-value comes from a parametric bootstrap of the search over the candidate's trials, because a shape exists only where the
    effect does, and is then adjusted for the number of candidates by Holm (1979).
    """
    residual = outside(fit.movable, fit.residual)
    testable = [p for p in prints if p.visible >= THRESHOLDS.visible_separation]
    drops, best, chance, bounded = [], [], [], []
    if testable:
        every = np.concatenate([p.secants for p in testable], axis=1)
        size = (every**2).sum(axis=0)
        unit = every / np.sqrt(np.maximum(size, 1e-300))
        _, s, V = np.linalg.svd(unit, full_matrices=False)
        random = np.random.default_rng(seed)
        drawn = (random.standard_normal((draws, len(s))) * s) @ V * np.sqrt(size)
        limits = np.concatenate([p.limits for p in testable])
        by_chance = largest_drop(drawn, size, limits)
        observed = largest_drop(every.T @ residual, size, limits)
        start = 0
        for tested in testable:
            part = slice(start, start + tested.secants.shape[1])
            start = part.stop
            drops.append(max(float(observed[part].max()), 0.0))
            best.append(_starts(tested, observed[part], tested.secants.T @ residual, size[part]))
            reached = int((by_chance[:, part].max(axis=1) >= drops[-1]).sum())
            chance.append((1.0 + reached) / (draws + 1.0))
            bounded.append(reached == 0)
    adjusted = holm(chance)
    entries = zip(drops, best, chance, adjusted, bounded, strict=True)
    by_candidate = dict(zip([id(tested.candidate) for tested in testable], entries, strict=True))
    scored = []
    for candidate in candidates:
        own = next((one for one in prints if one.candidate is candidate), None)
        if own is None:
            scored.append(Score(candidate, NOT_TESTABLE, 0.0, 1.0, 1.0, (), candidate.reason))
        elif id(candidate) in by_candidate:
            drop, (values, *others), p, p_holm, is_bound = by_candidate[id(candidate)]
            status = SIGNIFICANT if p_holm < THRESHOLDS.significance_p else NOT_SIGNIFICANT
            reason = "explains more than chance would" if status == SIGNIFICANT else "explains no more than chance may"
            scored.append(Score(candidate, status, drop, p, p_holm, values, reason, is_bound, tuple(others), drop))
        elif not own.values:
            scored.append(Score(candidate, FAILED, 0.0, 1.0, 1.0, (), "the model cannot be computed with it"))
        else:
            needed = f"{own.visible:.2g} where {THRESHOLDS.visible_separation:g} is needed"
            reason = f"even the largest plausible one stays under the floors ({needed})"
            scored.append(Score(candidate, NOT_TESTABLE, 0.0, 1.0, 1.0, (), reason))
    return scored


def by_rows(scored: Sequence[Score], prints: Sequence[Fingerprint], fit: BestFit, covariance: Covariance) -> list[Score]:
    """Scores that promise what a fit finds where the misfit is gross, and is therefore made small by the rows alone.

    There an error of a stated length that imitates a candidate would have to be many times as large as is likely. Whitened by
    Sigma, such a candidate hardly counts, although it may be the only one that explains the data.
    """
    rows = covariance.of_rows()
    slopes = rows.whiten(fit.slopes)
    residual = outside(slopes, rows.whiten(measured_rows(covariance.series) - fit.answer))
    by_candidate = {id(tested.candidate): tested for tested in prints}
    ranked = []
    for score in scored:
        if not score.values:
            ranked.append(score)
            continue
        tested = by_candidate[id(score.candidate)]
        secants = outside(slopes, rows.whiten(tested.changes))
        along, size = secants.T @ residual, (secants**2).sum(axis=0)
        drops = largest_drop(along, size, tested.limits)
        values, *others = _starts(tested, drops, along, size)
        ranked.append(replace(score, promise=max(float(drops.max()), 0.0), values=values, others=tuple(others)))
    return ranked


def _starts(tested: Fingerprint, drops: np.ndarray, along: np.ndarray, size: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """Values with which fits begin, the most promising first, given each trial's drop, secant . residual and |secant|^2 (m,)."""
    times = np.clip(along / np.maximum(size, 1e-300), SMALLEST_GROWTH, tested.limits)
    ranked = _by_drop(tested, drops)[: 1 + OTHER_STARTS]
    return tuple(grow(tested.candidate, tested.values[k], float(times[k])) for k in ranked)


def _by_drop(tested: Fingerprint, drops: np.ndarray) -> list[int]:
    """The trial that lowers chi2 most of each shape and sign, the best first."""
    strength = tested.candidate.term.parameters[0].sought
    none = strength.coordinate(strength.none)
    ranked: dict[tuple[object, ...], int] = {}
    for k in np.argsort(-drops):
        first, *shape = tested.values[k]
        ranked.setdefault((strength.coordinate(first) > none, *shape), int(k))
    return list(ranked.values())


def holm(p: Sequence[float]) -> list[float]:
    """p-values adjusted for their number, by the step-down method of Holm (1979)."""
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
    chi2, free : whitened sum of squares along smooth functions outside the model's span, and the number of these.
    p : p-value of so large a sum by chance.
    """

    chi2: float
    free: int
    p: float

    @property
    def excess(self) -> float:
        """chi2 above what noise alone gives."""
        return max(self.chi2 - self.free, 0.0)


def smooth_directions(fit: BestFit, covariance: Covariance, besides: np.ndarray | None = None) -> np.ndarray:
    """Orthonormal directions (n, m), whitened, of smooth curves between the bends, outside what the model's parameters can do.

    Parameters
    ----------
    besides : (n, k) SI, columns that count as what the model can do too.
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
    U, s, _ = np.linalg.svd(outside(_explained(fit, covariance, besides), directions), full_matrices=False)
    # What the constants leave of a direction that they nearly imitate is the noise of the imposed column in their derivatives.
    return U[:, s > THRESHOLDS.imitation_sine]


def _explained(fit: BestFit, covariance: Covariance, besides: np.ndarray | None) -> np.ndarray:
    """Whitened columns (n, q) of what the parameters that can move do, and of what counts as explained besides."""
    return fit.movable if besides is None else np.column_stack([fit.movable, covariance.whiten(besides)])


def lack_of_fit(fit: BestFit, covariance: Covariance, besides: np.ndarray | None = None) -> LackOfFit:
    """A test of a residual against smooth functions of the programme: physics is smooth between bends, and noise is not.

    The plain sum over all rows would test the stated noise rather than the model, because 5 % more noise in a thousand rows is
    significant there. Where the noise was estimated from what a smooth curve leaves, the test is an F-test.

    Parameters
    ----------
    besides : (n, k) SI, columns that count as explained.
    """
    U = smooth_directions(fit, covariance, besides)
    along = U.T @ outside(_explained(fit, covariance, besides), fit.residual)
    free, size = U.shape[1], float(along @ along)
    if not free:
        p = 1.0
    elif all(row.stated for row in covariance.rows):
        p = float(chi2_distribution.sf(size, free))
    else:
        known = max(covariance.effective - free, LEAST_DEGREES_OF_NOISE)
        p = float(f_distribution.sf(size / free, free, known))
    return LackOfFit(size, free, p)
