"""How probable each cause of a misfit is: nothing, each effect, several together, or something that no effect does.

The evidence of a model is what its residual says of it, averaged over what was believed of its parameters before: an amplitude
has a half-normal prior whose two standard deviations are the largest plausible strength, a shape an even one over the range in
which it is tried (MacKay 1992). Where a model was fitted, the average is that of Laplace; where it was only tried, its answer is
linear in the amplitude and the average has a closed form. Pairs are tried together, because two effects can hide each other. The
rival of all of them is a discrepancy: any smooth curve between the bends of a programme, whose size is found by its own evidence
(Kennedy & O'Hagan 2001, with a fixed basis).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import log_ndtr, logsumexp, ndtr

from explicitfe.close_loop.search import Outcome, Round
from explicitfe.close_loop.statistics.covariance import outside
from explicitfe.close_loop.statistics.fingerprints import grow, lack_of_fit, smooth_directions
from explicitfe.close_loop.statistics.refit import BestFit, refit
from explicitfe.close_loop.statistics.system import Hypothesis, Parameter, System
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.errors import RunError
from explicitfe.results.verdict_text import JOINED_BY, NOTHING, OTHER

# Sizes of a discrepancy, in standard deviations along each smooth function, even on a logarithmic scale.
DISCREPANCY_SIZES = np.geomspace(0.3, 1e4, 60)
# The prior's standard deviations in the largest plausible strength.
PLAUSIBLE_SDS = 2.0
# Causes that are less probable are not listed.
LEAST_LISTED_PROBABILITY = 1e-3
# An even prior over a range has the variance of its square over this number.
EVEN_PRIOR_DIVISOR = 12.0

# Pairs whose trial comes so near to the best model are fitted where that costs little, and no more than so many of them.
FAR_LOG_EVIDENCE, MOST_FITTED_PAIRS = 2.0, 3
# Two columns whose determinant is a smaller share of that of orthogonal ones are one.
SMALLEST_DETERMINANT_SHARE = 1e-9

Causes = frozenset[str]


@dataclass(frozen=True)
class Evidence:
    """What the data say of one model.

    Attributes
    ----------
    causes : its effects.
    terms : how many terms they have together.
    log : of the evidence over that of the baseline.
    open : with a discrepancy beside the effects.
    model, jacobian : at its best parameters, and the whitened derivatives (n, p) of its answer by these.
    fitted : whether they are those of a fit; else of a trial, with the other parameters where they were.
    """

    causes: Causes
    terms: int
    log: float
    open: bool
    model: Hypothesis
    jacobian: np.ndarray
    fitted: bool


@dataclass(frozen=True)
class Posterior:
    """Probabilities of causes.

    Attributes
    ----------
    closed : effects that are all there is -> probability; the empty set is that nothing is missing.
    open : effects -> probability that they are at work beside something else; the empty set is something else alone.
    """

    closed: dict[Causes, float]
    open: dict[Causes, float]

    @property
    def causes(self) -> dict[str, float]:
        """Cause in words -> probability, the most probable first; effects count with and without something else beside them."""
        total: dict[str, float] = {}
        for table, empty in ((self.closed, NOTHING), (self.open, OTHER)):
            for names, p in table.items():
                words = JOINED_BY.join(sorted(names)) or empty
                total[words] = total.get(words, 0.0) + p
        listed = {words: p for words, p in total.items() if p >= LEAST_LISTED_PROBABILITY}
        return dict(sorted(listed.items(), key=lambda entry: -entry[1]))

    def of(self, names: Causes) -> float:
        """Probability that these effects are what is missing, with or without something else beside them."""
        return self.closed.get(names, 0.0) + (self.open.get(names, 0.0) if names else 0.0)

    @property
    def something_else(self) -> float:
        """Probability that something is at work that no effect does, alone or beside effects."""
        return sum(self.open.values())


def posterior_of(evidence: Sequence[Evidence], testable: int) -> Posterior:
    """Probabilities of the causes from the evidence of models.

    Parameters
    ----------
    testable : effects that the data could show. A priori one of them is at work, on average, each independently of the others.
    """
    odds = _log_odds(testable)
    other = np.log(THRESHOLDS.discrepancy_odds)
    best: dict[tuple[Causes, bool], float] = {}
    for one in evidence:
        log = one.log + odds * one.terms + other * one.open
        best[one.causes, one.open] = max(best.get((one.causes, one.open), -np.inf), log)
    logs = np.array(list(best.values()))
    shares = np.exp(logs - logsumexp(logs)) * (1.0 - THRESHOLDS.unforeseen_probability)
    closed: dict[Causes, float] = {}
    unknown: dict[Causes, float] = {frozenset(): THRESHOLDS.unforeseen_probability}
    for (causes, is_open), share in zip(best, shares, strict=True):
        table = unknown if is_open else closed
        table[causes] = table.get(causes, 0.0) + float(share)
    return Posterior(closed, unknown)


def _log_odds(testable: int) -> float:
    """A priori, of each effect: the odds that make one of them be at work on average."""
    return -float(np.log(max(testable - 1, 1)))


def count_of_testable(outcome: Outcome) -> int:
    """How many effects the data could show."""
    return sum(p.visible >= THRESHOLDS.visible_separation for p in outcome.rounds[0].prints)


def sureness(outcome: Outcome, posterior: Posterior) -> float | None:
    """Probability that the verdict is right; None where it says nothing of causes.

    Two forms of one mechanism count as one, since a verdict that names the usual form claims no more than the mechanism.
    """
    if outcome.verdict in ("failed", "limited-by-numerics"):
        return None
    usual = usual_forms(outcome)
    posterior = by_mechanism(posterior, usual)
    if outcome.verdict == "no-missing-effect":
        slight = in_usual_forms(outcome.no_consequence, usual)
        return sum(posterior.of(causes) for causes in {*posterior.closed, *posterior.open} if causes <= slight)
    if outcome.verdict == "unexplained":
        return posterior.something_else
    last = outcome.rounds[-1]
    added = in_usual_forms(last.fit.model.effects, usual)
    if outcome.verdict == "ambiguous" and not outcome.effects and last.best is not None:
        named = {added | {usual.get(name, name)} for name in (last.best, *last.ambiguous_with)}
        return sum(posterior.of(causes) for causes in named)
    effects = in_usual_forms(outcome.effects, usual)
    if outcome.remainder == "at-floor":
        return posterior.of(effects)
    # More than these effects is at work, the verdict says.
    supersets = {causes for causes in {*posterior.closed, *posterior.open} if effects <= causes}
    return sum(posterior.of(causes) for causes in supersets)


def usual_forms(outcome: Outcome) -> dict[str, str]:
    """Effect -> the usual form of the same mechanism, of those that are another form."""
    return {s.candidate.effect: s.candidate.variant_of for one in outcome.rounds for s in one.scores if s.candidate.variant_of}


def by_mechanism(posterior: Posterior, usual: Mapping[str, str]) -> Posterior:
    """Probabilities with the forms of one mechanism added up."""
    return Posterior(merge_names(posterior.closed, usual), merge_names(posterior.open, usual))


def in_usual_forms(effects: Iterable[str], usual: Mapping[str, str]) -> Causes:
    """Effects by the usual form of each."""
    return frozenset(usual.get(name, name) for name in effects)


def merge_names(table: Mapping[Causes, float], usual: Mapping[str, str]) -> dict[Causes, float]:
    """Probabilities with effects renamed, and those of causes added up that become the same."""
    merged: dict[Causes, float] = {}
    for causes, p in table.items():
        merged[in_usual_forms(causes, usual)] = merged.get(in_usual_forms(causes, usual), 0.0) + p
    return merged


def evidence_of(outcome: Outcome, system: System) -> list[Evidence]:
    """The evidence of all models that were fitted or tried, each over that of the baseline.

    Pairs are tried at the start. A trial is linear, so where a run costs little the best pairs are fitted; where it costs much
    and the misfit is gross, only those that the search went through count.
    """
    first = outcome.rounds[0]
    start, evidence = 0.0, []
    for judged in outcome.rounds:
        evidence += [replace(one, log=start + one.log) for one in _of_round(judged)]
        if judged.chosen is not None:
            start += max(_refitted(judged, judged.refits[judged.chosen]), 0.0)
    odds = _log_odds(count_of_testable(outcome))
    best = max(one.log + odds * one.terms for one in evidence)
    pairs = _Trials(first).pairs()
    near = [names for names, pair in pairs.items() if pair.log + 2.0 * odds > best - FAR_LOG_EVIDENCE]
    promising = sorted(near, key=lambda names: -pairs[names].log)
    for names, pair in pairs.items():
        causes = frozenset(names)
        if names in promising:
            fitted = _fitted_pair(system, first, pair) if system.exact(first.fit.model) else None
            if names in promising[MOST_FITTED_PAIRS:] or (fitted is None and first.fit.by_rows is not None):
                continue
            if fitted is not None:
                evidence += _evidence(causes, first, fitted)
                continue
        evidence += _of_trial(causes, first, pair)
    return evidence


def _fitted_pair(system: System, first: Round, pair: Tried) -> BestFit | None:
    """The model with two effects at its best; None where it cannot be computed."""
    if not system.exact(pair.model):
        return None
    try:
        return refit(system, pair.model, first.covariance)
    except RunError:
        return None


def _of_round(judged: Round) -> Iterator[Evidence]:
    """The evidence of a round's model and of the models with one effect more, over that of the first."""
    fit = judged.fit
    base, terms = frozenset(fit.model.effects), len(fit.model.terms)
    yield Evidence(base, terms, 0.0, False, fit.model, fit.jacobian, True)
    yield Evidence(base, terms, discrepancy(judged.lack.chi2, judged.lack.free), True, fit.model, fit.jacobian, True)
    for name, tried in _Trials(judged).singles().items():
        fitted = judged.refits.get(name)
        if fitted is not None and _refitted(judged, fitted) > tried.log:
            yield from _evidence(base | {name}, judged, fitted)
        else:
            yield from _of_trial(base | {name}, judged, tried)


def _evidence(causes: Causes, judged: Round, fitted: BestFit) -> list[Evidence]:
    """The evidence of a fitted model, without and with a discrepancy."""
    lack, terms = lack_of_fit(fitted, judged.covariance), len(fitted.model.terms)
    log, left = _refitted(judged, fitted), discrepancy(lack.chi2, lack.free)
    return [
        Evidence(causes, terms, log, False, fitted.model, fitted.jacobian, True),
        Evidence(causes, terms, log + left, True, fitted.model, fitted.jacobian, True),
    ]


def _of_trial(causes: Causes, judged: Round, tried: Tried) -> list[Evidence]:
    """The evidence of a model that was only tried, without and with a discrepancy."""
    terms = len(tried.model.terms)
    return [
        Evidence(causes, terms, tried.log, False, tried.model, tried.jacobian, False),
        Evidence(causes, terms, tried.log + tried.left, True, tried.model, tried.jacobian, False),
    ]


def discrepancy(chi2: float, free: int) -> float:
    """Log evidence of a smooth curve of unknown size over that of none, where ``chi2`` lies along its ``free`` functions."""
    size = DISCREPANCY_SIZES**2
    logs = -0.5 * free * np.log1p(size) + 0.5 * chi2 * size / (1.0 + size)
    return float(logsumexp(logs) - np.log(len(logs)))


def amplitude(along: np.ndarray, size: np.ndarray, prior_sd: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Log evidence of a column with an amplitude from 0 to a limit over that of none; the prior is half-normal.

    Parameters
    ----------
    along, size : (m,) column . residual and |column|^2, whitened.
    prior_sd, limit : (m,) of the amplitude.
    """
    precision = size + prior_sd**-2.0
    root, mean = np.sqrt(precision), along / precision
    inside = _log_between(-mean * root, (limit - mean) * root)
    allowed = np.log(ndtr(limit / prior_sd) - 0.5)
    return 0.5 * along * mean - 0.5 * np.log1p(size * prior_sd**2) + inside - allowed


def _log_between(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """log(Phi(high) - Phi(low)), also far out in either tail."""
    mirrored = low > 0.0
    a, b = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    return log_ndtr(b) + np.log1p(-np.exp(np.minimum(log_ndtr(a) - log_ndtr(b), -1e-12)))


@dataclass(frozen=True, eq=False)
class Tried:
    """A model that was tried: log evidence, what a discrepancy beside it adds, and where its trial explains most.

    Attributes
    ----------
    model, jacobian : as in :class:`Evidence`.
    """

    log: float
    left: float
    model: Hypothesis
    jacobian: np.ndarray


class _Trials:
    """The trials of a round: linear models of their amplitudes about the round's model."""

    def __init__(self, judged: Round) -> None:
        self.fit = judged.fit
        self.prints = [p for p in judged.prints if p.visible >= THRESHOLDS.visible_separation]
        residual = outside(judged.fit.movable, judged.fit.residual)
        rows = len(residual)
        self.columns = np.concatenate([np.zeros((rows, 0)), *(p.secants for p in self.prints)], axis=1)
        self.limits = np.concatenate([np.zeros(0), *(p.limits for p in self.prints)])
        self.prior_sds = np.concatenate([np.zeros(0), *(p.plausible for p in self.prints)]) / PLAUSIBLE_SDS
        self.owner = np.repeat(np.arange(len(self.prints)), [p.secants.shape[1] for p in self.prints])
        self.products = self.columns.T @ self.columns
        self.along = self.columns.T @ residual
        directions = smooth_directions(judged.fit, judged.covariance)
        self.free = directions.shape[1]
        self.smooth_columns, self.smooth_residual = directions.T @ self.columns, directions.T @ residual

    def singles(self) -> dict[str, Tried]:
        """Effect -> the model with it."""
        size = np.diag(self.products)
        logs = amplitude(self.along, size, self.prior_sds, self.limits)
        best = np.clip(self.along / (size + self.prior_sds**-2.0), 0.0, self.limits)
        entries = {}
        for number, own in enumerate(self.prints):
            part = np.flatnonzero(self.owner == number)
            k = int(part[np.argmax(logs[part])])
            entries[own.candidate.effect] = self._tried(_mean(logs[part]), [(k, float(best[k]))])
        return entries

    def _tried(self, log: float, amplitudes: Sequence[tuple[int, float]]) -> Tried:
        """The model with some columns at so many times their strength."""
        model, J, left = self.fit.model, [self.fit.jacobian], self.smooth_residual
        for k, times in amplitudes:
            own = self.prints[self.owner[k]]
            values = own.values[k - int(np.searchsorted(self.owner, self.owner[k]))]
            strength, *shapes = own.candidate.term.parameters
            tried = strength.sought.coordinate(values[0]) - strength.sought.coordinate(strength.sought.none)
            model = model.plus(own.candidate.term, grow(own.candidate, values, times))
            J += [self.columns[:, [k]] / tried, np.zeros((len(self.columns), len(shapes)))]
            left = left - self.smooth_columns[:, k] * times
        return Tried(log, discrepancy(float(left @ left), self.free), model, np.concatenate(J, axis=1))

    def pairs(self) -> dict[tuple[str, str], Tried]:
        """Two effects -> the model with both together.

        Only amplitudes inside their limits count: at a limit of none, a pair is one effect alone.
        """
        entries = {}
        d, size = self.prior_sds**-2.0, np.diag(self.products)
        for one, other in combinations(range(len(self.prints)), 2):
            i, j = (np.flatnonzero(self.owner == k) for k in (one, other))
            a, b = (size[i] + d[i])[:, None], (size[j] + d[j])[None, :]
            c, p, q = self.products[np.ix_(i, j)], self.along[i][:, None], self.along[j][None, :]
            determinant = np.maximum(a * b - c**2, SMALLEST_DETERMINANT_SHARE * a * b)
            x, y = (b * p - c * q) / determinant, (a * q - c * p) / determinant
            logs = 2.0 * np.log(2.0) + 0.5 * (x * p + y * q) - 0.5 * np.log(determinant / np.outer(d[i], d[j]))
            inside = (x > 0.0) & (y > 0.0) & (x <= self.limits[i][:, None]) & (y <= self.limits[j][None, :])
            if not inside.any():
                continue
            logs = np.where(inside, logs, -np.inf)
            m, n = np.unravel_index(int(np.argmax(logs)), logs.shape)
            names = self.prints[one].candidate.effect, self.prints[other].candidate.effect
            amplitudes = [(int(i[m]), float(x[m, n])), (int(j[n]), float(y[m, n]))]
            entries[names] = self._tried(_mean(logs.ravel()), amplitudes)
        return entries


def _mean(logs: np.ndarray) -> float:
    return float(logsumexp(logs) - np.log(len(logs)))


def _refitted(judged: Round, fitted: BestFit) -> float:
    """Log evidence of a fitted model, over that of the round's model, by the method of Laplace."""
    count = len(fitted.model.x) - len(judged.fit.model.x)
    own = outside(fitted.jacobian[:, :-count], fitted.jacobian[:, -count:])
    precisions, log, start = [], 0.0, len(judged.fit.model.x)
    for term in fitted.model.terms[len(judged.fit.model.terms) :]:
        precision, density = _prior(term.parameters, fitted.model.x[start : start + len(term.parameters)])
        precisions.append(precision)
        log += density
        start += len(term.parameters)
    _, determinant = np.linalg.slogdet(own.T @ own + np.diag(np.concatenate(precisions)))
    gain = _least(judged.fit) - _least(fitted)
    return float(0.5 * gain + log + 0.5 * count * np.log(2.0 * np.pi) - 0.5 * determinant)


def _least(fit: BestFit) -> float:
    """Whitened sum of squares without what the model's parameters can still do, as they were perhaps fitted by the rows alone."""
    return float(np.sum(outside(fit.movable, fit.residual) ** 2))


def _prior(parameters: Sequence[Parameter], x: np.ndarray) -> tuple[np.ndarray, float]:
    """Precision of the prior of each parameter of a term (q,), and the log of its density at coordinates (q,)."""
    strength, *shapes = parameters
    none = strength.sought.coordinate(strength.sought.none)
    lengths = [abs(strength.sought.coordinate(v) - none) for v in strength.sought.values]
    sd = max(lengths) / PLAUSIBLE_SDS
    two_sided = min(strength.sought.values) < strength.sought.none < max(strength.sought.values)
    log = -0.5 * ((x[0] - none) / sd) ** 2 - np.log(sd) - 0.5 * np.log(2.0 * np.pi) + (0.0 if two_sided else np.log(2.0))
    precision = [sd**-2.0]
    for shape in shapes:
        width = _width(shape)
        precision.append(EVEN_PRIOR_DIVISOR / width**2)
        log -= np.log(width)
    return np.array(precision), float(log)


def prior_precision(parameters: Sequence[Parameter]) -> np.ndarray:
    """Precision (q,) of what is believed of the parameters of a term before the data, in their coordinates."""
    return _prior(parameters, np.zeros(len(parameters)))[0]


def _width(shape: Parameter) -> float:
    """Range of a shape's coordinate in which it is tried, with half a step of the grid beyond each end."""
    tried = sorted(shape.sought.coordinate(v) for v in shape.sought.values)
    if len(tried) == 1:
        return shape.high - shape.low
    return (tried[-1] - tried[0]) * len(tried) / (len(tried) - 1)
