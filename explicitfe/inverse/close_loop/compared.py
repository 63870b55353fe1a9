"""The hypotheses that were compared, with what is known of each, and the probabilities that follow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from explicitfe.inverse.close_loop.evidence import LEAST_LISTED_PROBABILITY, Causes, Evidence, Posterior, Prior, cost_of_term
from explicitfe.inverse.close_loop.statistics.covariance import Covariance
from explicitfe.inverse.close_loop.statistics.refit import BestFit
from explicitfe.inverse.close_loop.statistics.signatures import Signature
from explicitfe.inverse.close_loop.statistics.system import Candidate, Hypothesis, System
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS

Key = tuple[str, ...]  # names of the effects of a hypothesis, sorted, one for each term


def needed_decrease(covariance: Covariance, causes: int, forms: int, signature: Signature) -> float:
    """Decrease of chi2 that makes a cause as probable as a verdict asks for.

    Parameters
    ----------
    causes, forms : how many causes compete, and how many forms this one has.
    """
    parameters = len(signature.candidate.term.parameters)
    cost = cost_of_term(parameters, covariance.effective, signature.visible)
    odds = THRESHOLDS.decisive_probability / (1.0 - THRESHOLDS.decisive_probability)
    return float(2.0 * (cost + np.log(max(causes, 1) * max(forms, 1)) + np.log(odds)))


@dataclass(frozen=True, eq=False)
class Entry:
    """A hypothesis of the comparison.

    Attributes
    ----------
    key, causes : effects, one for each term, and the causes of which they are forms.
    evidence : log evidence of its three versions.
    model : with the best parameters; of the screening where it was not fitted.
    fit, system, covariance : of a hypothesis that was fitted.
    bound, parent : largest decrease of chi2 by the signatures, and the hypothesis that it was screened from, of one that was not
        fitted.
    """

    key: Key
    causes: Causes
    evidence: Evidence
    model: Hypothesis
    fit: BestFit | None = None
    system: System | None = None
    covariance: Covariance | None = None
    bound: float = 0.0
    parent: Key = ()

    @property
    def has_all_terms(self) -> bool:
        """Whether the model has each term of the key, which a subset that serves for it lacks."""
        return len(self.model.terms) == len(self.key)

    def lowered(self, by: float) -> Entry:
        """The same with less evidence; ``by`` below 0 changes nothing."""
        return replace(self, evidence=replace(self.evidence, closed=self.evidence.closed - max(by, 0.0)))


@dataclass(frozen=True, eq=False)
class ComparedCauses:
    """All hypotheses that were compared.

    Attributes
    ----------
    baseline : the model without effects.
    entries : fitted and screened hypotheses, the most probable first; the baseline among them.
    prior, posterior : of the causes.
    signatures : of all candidates near the baseline.
    not_testable : effect -> why these data cannot show it.
    failed : effects of a hypothesis -> why it could not be computed.
    cause_of : effect -> cause, of all candidates.
    left : hypotheses that could matter and were not fitted, because a limit was reached.
    ended : which limit has ended the search, in words; "" where it was completed.
    """

    baseline: Entry
    entries: Sequence[Entry]
    prior: Prior
    posterior: Posterior
    signatures: Sequence[Signature]
    not_testable: Mapping[str, str]
    failed: Mapping[Key, str]
    cause_of: Mapping[str, str] = field(default_factory=dict)
    left: Sequence[Key] = ()
    ended: str = ""

    @property
    def nearest(self) -> Entry:
        """The fitted hypothesis that is most probable if its residual is noise: the nearest to the data for its parameters."""
        fitted = [one for one in self.entries if one.fit is not None]
        return max(fitted, key=lambda one: one.evidence.closed + self.prior.log(one.causes))

    def best_of(self, causes: Causes) -> Entry | None:
        """The most probable fitted hypothesis of a set of causes."""
        own = [one for one in self.entries if one.causes == causes and one.fit is not None]
        return max(own, key=lambda one: one.evidence.best, default=None)

    def probabilities(self) -> list[tuple[Entry, float]]:
        """Hypotheses and their probabilities, the most probable first."""
        posteriors = np.array([one.evidence.total + self.prior.log(one.causes) for one in self.entries])
        shares = np.exp(posteriors - logsumexp(posteriors))
        return sorted(zip(self.entries, map(float, shares), strict=True), key=lambda pair: -pair[1])

    def forms_of(self, cause: str) -> dict[str, float]:
        """Form of a cause, as its effects, one for each term -> probability, where the cause is present."""
        forms: dict[str, float] = {}
        for one, p in self.probabilities():
            own = " + ".join(name for name in one.key if self.cause_of[name] == cause)
            if own and p >= LEAST_LISTED_PROBABILITY:
                forms[own] = forms.get(own, 0.0) + p
        return dict(sorted(forms.items(), key=lambda entry: -entry[1]))

    def detectable(self, signature: Signature) -> float:
        """The smallest strength of an effect that these data would show, in the unit of its parameter."""
        size = (signature.secants**2).sum(axis=0)
        best = int(np.argmax(size))
        assert self.baseline.covariance is not None
        needed = needed_decrease(self.baseline.covariance, self.prior.causes, 1, signature)
        factor = float(np.sqrt(needed / max(size[best], 1e-300)))
        strength = signature.candidate.term.parameters[0].sought
        none = strength.coordinate(strength.none)
        x = none + factor * (strength.coordinate(signature.values[best][0]) - none)
        ends = sorted(strength.coordinate(v) for v in (strength.low, strength.high))
        return strength.value(min(max(x, ends[0]), ends[1]))


def forms_by_cause(library: Sequence[Candidate]) -> dict[str, int]:
    """Cause -> number of its forms in these data."""
    forms: dict[str, set[str]] = {}
    for one in library:
        forms.setdefault(one.cause, set()).update({one.effect} if not one.reason else set())
    return {cause: max(len(names), 1) for cause, names in forms.items()}


def not_testable(library: Sequence[Candidate], invisible: Sequence[Signature]) -> dict[str, str]:
    """Effect -> why these data cannot show it, of candidates with a reason and of those whose signature is too small."""
    reasons = {c.effect: c.reason for c in library if c.reason}
    for one in invisible:
        change = f"not detectable with these data: the largest plausible strength changes chi2 by {one.visible:.2g}"
        reasons[one.candidate.effect] = change if one.values else "the model cannot be computed with it"
    return reasons


def further_effects(key: Key, subset: Key) -> list[str]:
    """Effects of the terms that a hypothesis has and a subset of it lacks."""
    return list((Counter(key) - Counter(subset)).elements())


def without_term(model: Hypothesis, effect: str) -> Hypothesis:
    """The model without the last term of an effect."""
    last = max(k for k, term in enumerate(model.terms) if term.effect == effect)
    x, start = list(model.x[: len(model.base)]), len(model.base)
    for k, term in enumerate(model.terms):
        if k != last:
            x += list(model.x[start : start + len(term.parameters)])
        start += len(term.parameters)
    return Hypothesis(model.base, tuple(t for k, t in enumerate(model.terms) if k != last), np.array(x))
