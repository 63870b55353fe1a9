"""The verdict follows the posterior: what a report names is what its probabilities favour."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from explicitfe.close_loop.posterior import Causes, Evidence, Posterior, merge_names, sureness, usual_forms
from explicitfe.close_loop.search import Outcome, Round, conclude
from explicitfe.close_loop.statistics.system import System
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.errors import RunError
from explicitfe.results.loop_report import Remainder

NONE: Causes = frozenset()
# A form of a mechanism that the search named stands for all its forms unless another one is more probable by this factor.
NAMED_FORM_FACTOR = 3.0
# Rounds that end at a model with these effects; None if it cannot be computed.
Conclude = Callable[[Causes], list[Round] | None]


def by_named_forms(posterior: Posterior, outcome: Outcome) -> Posterior:
    """The posterior with the forms of each mechanism added up under one name, so that they do not compete with each other.

    The name is that of the form in the outcome, unless another form is clearly more probable.
    """
    usual = usual_forms(outcome)
    marginal: dict[str, float] = {}
    for table in (posterior.closed, posterior.open):
        for causes, p in table.items():
            for name in causes:
                marginal[name] = marginal.get(name, 0.0) + p
    names: dict[str, str] = {}
    for mechanism in set(usual.values()):
        forms = [name for name in marginal if usual.get(name, name) == mechanism]
        best = max(forms, key=marginal.__getitem__, default=mechanism)
        named = [name for name in _named(outcome) if name in forms and NAMED_FORM_FACTOR * marginal[name] >= marginal[best]]
        names |= dict.fromkeys(forms, named[0] if named else best)
    return Posterior(merge_names(posterior.closed, names), merge_names(posterior.open, names))


def follow_posterior(outcome: Outcome, posterior: Posterior, conclude_with: Conclude = lambda causes: None) -> Outcome:
    """The outcome with a verdict that agrees with the posterior.

    - Nothing is missing where that is too probable for an alarm.
    - No candidate explains the residual where another effect is more probable than all that was found.
    - An effect is found, or proposed by one test, where the most probable cause includes it and all causes with it are more
      probable than all others. Else the verdict is ambiguous, and the model becomes that of the most probable cause.

    Parameters
    ----------
    posterior : with the forms of each mechanism added up, see :func:`by_named_forms`.
    conclude_with : computes the rounds of the most probable cause where the search ended at another one.
    """
    if outcome.verdict not in ("effect-found", "ambiguous", "unexplained"):
        return outcome
    if posterior.of(NONE) > THRESHOLDS.nothing_probability:
        return Outcome("no-missing-effect", "at-floor", outcome.rounds, ())
    least, effects = THRESHOLDS.finding_probability, frozenset(outcome.effects)
    sure, something_else = sureness(outcome, posterior), posterior.something_else
    top = max((c for c in {*posterior.closed, *posterior.open} if c), key=posterior.of, default=NONE)
    other_is_top = posterior.open.get(NONE, 0.0) > posterior.of(top)
    if outcome.verdict == "unexplained":
        # Without effects that help, the search was not allowed to add any (--max-effects 0), or none explained more than chance.
        if other_is_top or something_else >= least or not outcome.nearest:
            return outcome
    elif not effects:
        return outcome  # the sentence lists the causes by their probability
    elif (sure is not None and sure < least < something_else) or other_is_top:
        return Outcome("unexplained", "unexplained", outcome.rounds, (), nearest=outcome.effects)
    elif effects <= top and _probability_of_including(effects, posterior) >= least:
        return outcome
    if top == frozenset(outcome.rounds[-1].fit.model.effects):
        return replace(outcome, verdict="ambiguous", effects=outcome.rounds[-1].fit.model.effects, nearest=())
    rounds = conclude_with(top)
    if rounds is None:
        return replace(outcome, verdict="ambiguous", nearest=())
    rivals = tuple(name for name in (*outcome.effects, *outcome.nearest) if name not in top)
    rounds = [_with_choice(rounds[0], top, posterior), *rounds[1:-1], replace(rounds[-1], ambiguous_with=rivals)]
    remainder: Remainder = "at-floor" if rounds[-1].at_floor else "unexplained"
    return Outcome("ambiguous", remainder, rounds, rounds[-1].fit.model.effects)


def concluding(system: System, outcome: Outcome, evidence: Sequence[Evidence], max_effects: int) -> Conclude:
    """How to compute the rounds of another model of at most ``max_effects``, from the evidence of all models."""

    def conclude_with(causes: Causes) -> list[Round] | None:
        models = [one for one in evidence if one.causes == causes]
        if not models or len(causes) > max_effects:
            return None
        try:
            return conclude(system, outcome, max(models, key=lambda one: (one.fitted, one.log)).model)
        except RunError:
            return None

    return conclude_with


def _named(outcome: Outcome) -> list[str]:
    """Effects that an outcome names, in the order of its rounds."""
    last = outcome.rounds[-1]
    return [*outcome.effects, *outcome.nearest, *([last.best] if last.best else []), *last.ambiguous_with]


def _probability_of_including(effects: Causes, posterior: Posterior) -> float:
    """Probability that these effects are missing, alone or with others."""
    return sum(posterior.of(causes) for causes in {*posterior.closed, *posterior.open} if effects <= causes)


def _with_choice(first: Round, top: Causes, posterior: Posterior) -> Round:
    """The first round with the effect that the most probable cause begins with."""
    drops = {score.candidate.effect: score.drop for score in first.scores if score.candidate.effect in top}
    chosen = max(drops, key=drops.__getitem__, default=first.chosen)
    if first.chosen in top or chosen is None:
        return first
    why = {name: reason for name, reason in first.why_not.items() if name != chosen}
    if first.chosen is not None:
        less, more = posterior.of(frozenset({first.chosen})), posterior.of(top)
        why[first.chosen] = f"not added: its probability is {less:.2g}, that of {' + '.join(sorted(top))} is {more:.2g}"
    return replace(first, chosen=chosen, best=chosen, why_not=why)
