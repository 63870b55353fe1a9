"""Evidence of hypotheses and the posterior probability of causes.

A hypothesis is a set of effects, each a form of a cause. Its evidence is that of the Bayesian information criterion (Schwarz
1978), which is the prior of unit information (Kass & Wasserman 1995): each further parameter costs half the logarithm of the
number of independent rows. The prior of a strength is normal and as wide as its plausible values, whose standard deviation is
half the largest one, where this is wider than unit information: data that would show a plausible effect at a hundred times the
noise make one at three times the noise improbable (Lindley 1957), and a strength far beyond the plausible ones is improbable
itself. Before the data, each number of causes is equally probable, each set of causes of one size, and each form of a cause.

Three versions of each hypothesis compete (Kennedy & O'Hagan 2001). In the first the residual is noise. In the second it contains
a model-form error of the causes that are there: any combination of what their other forms would change. In the third it contains
something else: any smooth curve between the bends of the loading protocol. The size of such a discrepancy is integrated out. In
each version the noise may be larger than it was stated or estimated; its factor is integrated out too. A misfit without shape
therefore counts as noise, and one with a shape does not, because few smooth curves describe it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from scipy.special import logsumexp

from explicitfe.inverse.close_loop.statistics.covariance import Covariance, outside
from explicitfe.inverse.close_loop.statistics.lack_of_fit import LackOfFit, lack_of_fit
from explicitfe.inverse.close_loop.statistics.refit import BestFit
from explicitfe.inverse.close_loop.statistics.system import Parameter
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.results.documents.verdict_text import JOINED_BY, NOTHING, OTHER

# Sizes of a discrepancy, in standard deviations along each direction, uniform on a logarithmic scale.
DISCREPANCY_SIZES = np.geomspace(0.3, 1e4, 60)
# The standard deviations of the prior of a strength in its largest plausible value.
PLAUSIBLE_SDS = 2.0
# The noise may be larger than known by any factor up to this one.
LARGEST_NOISE_FACTOR = 1e4
# Directions of a model-form error whose singular value is a smaller share of the largest are none.
FORM_RANK_SHARE = 1e-3
# Precision that keeps finite what the data do not determine, as a share of that of one parameter alone.
SMALLEST_PRECISION_SHARE = 1e-10
# Causes that are less probable are not listed.
LEAST_LISTED_PROBABILITY = 1e-3

Causes = frozenset[str]


def log_discrepancy(chi2: float, free: int) -> float:
    """Log evidence of a discrepancy of unknown size over that of none, where ``chi2`` lies along its ``free`` directions."""
    if not free:
        return -np.inf
    size = DISCREPANCY_SIZES**2
    logs = -0.5 * free * np.log1p(size) + 0.5 * chi2 * size / (1.0 + size)
    return float(logsumexp(logs) - np.log(len(logs)))


def log_larger_noise(chi2: float, rows: float) -> float:
    """Log evidence of noise that may be larger than known over that of noise as it is known, where ``rows`` leave ``chi2``.

    Rows count as independent: a misfit that lasts over many rows has a shape. The factor of the standard deviation has a uniform
    prior on a logarithmic scale; the integral over it is Laplace's.
    """
    if chi2 <= rows or rows < 1.0:
        return 0.0
    gain = 0.5 * (chi2 - rows - rows * np.log(chi2 / rows)) + 0.5 * np.log(np.pi / rows) - np.log(np.log(LARGEST_NOISE_FACTOR))
    return float(np.logaddexp(0.0, np.log(THRESHOLDS.larger_noise_odds) + gain))


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log evidence of one hypothesis, without its prior.

    Attributes
    ----------
    closed : the residual is noise.
    form : gain by a model-form error of its causes.
    other : gain by something else.
    lack : lack of fit beside a model-form error.
    chi2, rows : whitened sum of squares of the residual, and how many rows leave it.
    """

    closed: float
    form: float
    other: float
    lack: LackOfFit
    chi2: float = 0.0
    rows: float = 0.0

    @property
    def best(self) -> float:
        """The largest of the three versions, with the prior odds of each."""
        return self.closed + max(0.0, self.form + log_odds_of_form(), self.other + log_odds_of_other())

    def with_gain(self, gain: float) -> Evidence:
        """Where further parameters lower chi2 by a gain, as far as it is known without a fit: without a model-form error."""
        left = replace(self.lack, chi2=max(self.lack.chi2 - gain, 0.0))
        chi2 = max(self.chi2 - gain, 0.0)
        noise = log_larger_noise(chi2, self.rows)
        closed = self.closed + 0.5 * gain + noise - log_larger_noise(self.chi2, self.rows)
        other = _gain_of_discrepancy(left.chi2, left.free, chi2, self.rows)
        return Evidence(closed, -np.inf, other, left, chi2, self.rows)

    @property
    def total(self) -> float:
        """All three versions together, with the prior odds of each."""
        return self.closed + float(np.logaddexp.reduce([0.0, self.form + log_odds_of_form(), self.other + log_odds_of_other()]))


def _gain_of_discrepancy(along: float, free: int, chi2: float, rows: float) -> float:
    """Log evidence of a discrepancy with ``along`` of the ``chi2`` of all rows over that of noise alone."""
    beyond = log_larger_noise(max(chi2 - along, 0.0), rows - free)
    return log_discrepancy(along, free) + beyond - log_larger_noise(chi2, rows)


def log_odds_of_form() -> float:
    """Log prior odds that the best form of a cause is not exact."""
    return float(np.log(THRESHOLDS.form_error_odds))


def log_odds_of_other() -> float:
    """Log prior odds that something is present that no candidate describes."""
    return float(np.log(THRESHOLDS.something_else_odds))


def cost_of_term(parameters: int, rows: float, visible: float) -> float:
    """Log of the share of the prior of a term's parameters that the data leave.

    Parameters
    ----------
    parameters : how many parameters it has, the strength first.
    rows : effective number of independent rows.
    visible : decrease of chi2 by the largest plausible strength.
    """
    unit = np.log(max(rows, 2.0))
    return float(0.5 * (parameters - 1) * unit + 0.5 * max(unit, np.log1p(visible / PLAUSIBLE_SDS**2)))


def prior_sd(strength: Parameter) -> float:
    """Standard deviation of the prior of a strength, in its coordinate."""
    sought = strength.sought
    return max(abs(sought.coordinate(v) - sought.coordinate(sought.none)) for v in sought.values) / PLAUSIBLE_SDS


def log_prior_of_strengths(fit: BestFit) -> float:
    """Log of the normal priors of the strengths at the fitted ones, each as wide as the prior and the data leave it together.

    With :func:`cost_of_term` this is the evidence of a normal prior and a normal likelihood.
    """
    norm = np.linalg.norm(fit.jacobian, axis=0)
    size = np.where(norm > 0.0, norm, 1.0)
    precision = (fit.jacobian / size).T @ (fit.jacobian / size)
    variance = np.diag(np.linalg.inv(precision + SMALLEST_PRECISION_SHARE * np.eye(len(size)))) / size**2
    spread = np.where(norm > 0.0, variance, np.inf)
    total, at = 0.0, len(fit.model.base)
    for term in fit.model.terms:
        strength = term.parameters[0]
        away = fit.model.x[at] - strength.sought.coordinate(strength.sought.none)
        total -= 0.5 * float(away**2 / (prior_sd(strength) ** 2 + spread[at]))
        at += len(term.parameters)
    return total


def evidence_of(fit: BestFit, covariance: Covariance, cost: float, forms: np.ndarray | None = None) -> Evidence:
    """Evidence of a fitted hypothesis.

    Parameters
    ----------
    cost : of its parameters in addition to those of the baseline, see :func:`cost_of_term`.
    forms : (n, m) whitened changes by other forms of its causes.
    """
    chi2, rows = fit.whitened, float(len(fit.residual))
    closed = -0.5 * chi2 - 0.5 * covariance.log_determinant - cost + log_prior_of_strengths(fit) + log_larger_noise(chi2, rows)
    directions = _form_directions(fit, forms)
    along = 0.0 if directions is None else float(np.sum((directions.T @ fit.residual) ** 2))
    count = 0 if directions is None else directions.shape[1]
    lack = lack_of_fit(fit, covariance)
    beyond = lack if directions is None else lack_of_fit(fit, covariance, directions)
    form = _gain_of_discrepancy(along, count, chi2, rows)
    return Evidence(float(closed), form, _gain_of_discrepancy(lack.chi2, lack.free, chi2, rows), beyond, chi2, rows)


def _form_directions(fit: BestFit, forms: np.ndarray | None) -> np.ndarray | None:
    """Orthonormal directions (n, m) of the changes by other forms, outside the span of the model's parameters."""
    if forms is None or not forms.size:
        return None
    columns = outside(fit.movable, forms)
    U, s, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False)
    kept = U[:, s > FORM_RANK_SHARE * max(float(s.max(initial=0.0)), 1e-300)]
    return kept if kept.shape[1] else None


@dataclass(frozen=True)
class Prior:
    """Prior of hypotheses.

    Attributes
    ----------
    causes : how many causes the data could show.
    forms : cause -> how many forms it has.
    """

    causes: int
    forms: Mapping[str, int]

    def log(self, causes: Iterable[str]) -> float:
        """Log prior of one form of a set of causes: uniform over sizes, over sets of one size, and over forms."""
        chosen = set(causes)
        sets = comb(max(self.causes, len(chosen)), len(chosen))
        return -float(np.log(sets) + sum(np.log(max(self.forms.get(cause, 1), 1)) for cause in chosen))


@dataclass(frozen=True)
class Posterior:
    """Probabilities of sets of causes.

    Attributes
    ----------
    closed : set -> probability that these causes, with a model-form error or without, are all that is missing.
    open : set -> probability that they are present together with something that no candidate describes.
    form : probability that a model-form error is present.
    """

    closed: Mapping[Causes, float]
    open: Mapping[Causes, float]
    form: float

    @property
    def sets(self) -> dict[Causes, float]:
        """Set of causes -> probability, with something else or without, the most probable first."""
        total = {causes: self.closed.get(causes, 0.0) + self.open.get(causes, 0.0) for causes in {*self.closed, *self.open}}
        return dict(sorted(total.items(), key=lambda entry: (-entry[1], sorted(entry[0]))))

    @property
    def inclusion(self) -> dict[str, float]:
        """Cause -> probability that it is present, alone or with others."""
        total: dict[str, float] = {}
        for causes, p in self.sets.items():
            for cause in causes:
                total[cause] = total.get(cause, 0.0) + p
        # Sums of rounded shares may exceed one by the last digit.
        total = {cause: min(p, 1.0) for cause, p in total.items()}
        return dict(sorted(total.items(), key=lambda entry: (-entry[1], entry[0])))

    @property
    def something_else(self) -> float:
        """Probability that something is present that no candidate describes."""
        return min(sum(self.open.values()), 1.0)

    @property
    def by_words(self) -> dict[str, float]:
        """Set of causes in words -> probability, for the report; the empty set with something else is ``OTHER``."""
        words: dict[str, float] = {}
        for table, empty in ((self.closed, NOTHING), (self.open, OTHER)):
            for causes, p in table.items():
                name = JOINED_BY.join(sorted(causes)) or empty
                words[name] = words.get(name, 0.0) + p
        listed = {name: p for name, p in words.items() if p >= LEAST_LISTED_PROBABILITY}
        return dict(sorted(listed.items(), key=lambda entry: (-entry[1], entry[0])))


def posterior_of(entries: Sequence[tuple[Causes, Evidence]], prior: Prior) -> Posterior:
    """Probabilities of sets of causes from the evidence of hypotheses, one entry for each form."""
    logs, owners = [], []
    for causes, one in entries:
        base = one.closed + prior.log(causes)
        for kind, gain in (("closed", 0.0), ("form", one.form + log_odds_of_form()), ("open", one.other + log_odds_of_other())):
            logs.append(base + gain)
            owners.append((causes, kind))
    shares = np.exp(np.array(logs) - logsumexp(logs))
    closed: dict[Causes, float] = {}
    unknown: dict[Causes, float] = {}
    form = 0.0
    for (causes, kind), share in zip(owners, shares, strict=True):
        table = unknown if kind == "open" else closed
        table[causes] = table.get(causes, 0.0) + float(share)
        form += float(share) if kind == "form" else 0.0
    return Posterior(closed, unknown, form)
