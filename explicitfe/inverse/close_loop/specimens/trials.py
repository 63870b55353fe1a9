"""What each candidate changes in the prediction: trials near a model, by differences on one mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, Self

import numpy as np

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.inverse.close_loop.statistics.covariance import stack
from explicitfe.inverse.close_loop.statistics.system import Answer, Candidate, Hypothesis
from explicitfe.inverse.predict.tissue import Numerics

# With which tests are planned and candidates are tried, by differences of answers; ramps have the instants of the search.
COARSE = Numerics(refinement=0.4, density=0.4, tolerance=5e-4, section=0.4, finer=1.0)
# With which a tool that leans is tried, on half of a body.
LEANING = Numerics(refinement=0.3, density=0.5, tolerance=1e-3)
# Share of a trial's strength with which an effect is computed beside the model without it.
WEAK_SHARE = 0.01
# Shares of a trial's strength that are tried until the model can be computed.
TRIED_SHARES = (1.0, 0.5, 0.25, 0.1)


class Trying(Protocol):
    """What trials ask of tests of specimens, see :class:`explicitfe.inverse.close_loop.specimens.specimens.Specimens`."""

    @property
    def homogeneous(self) -> bool: ...

    @property
    def numerics(self) -> Numerics: ...

    def pointwise(self, model: Hypothesis) -> bool: ...

    def exact(self, model: Hypothesis) -> bool: ...

    def has_sketch(self, effect: str) -> bool: ...

    def sketched(self, models: Sequence[Hypothesis]) -> list[Answer | None]: ...

    def answers(self, models: Sequence[Hypothesis], *, with_slopes: bool = True) -> list[Answer | None]: ...

    def beside(self, model: Hypothesis, others: Sequence[Hypothesis]) -> list[Answer | None]: ...

    def with_numerics(self, numerics: Numerics) -> Self: ...


def changes_by_trials(specimens: Trying, model: Hypothesis, candidates: Sequence[Candidate]) -> list[list[np.ndarray | None]]:
    """Change (n,) SI of the prediction by each trial, by differences on one mesh.

    A trial that follows whole histories is compared with the same effect without strength, because a model without history
    is read off one ramp.
    """
    if not specimens.pointwise(model):
        known = [c for c in candidates if specimens.has_sketch(c.effect) and EFFECTS[c.effect].acts_on != "reading"]
        table = dict(zip([c.effect for c in known], _sketched_changes(specimens, model, known), strict=True))
        others = iter(_simulated_changes(specimens, model, [c for c in candidates if c.effect not in table]))
        return [table[c.effect] if c.effect in table else next(others) for c in candidates]
    return _simulated_changes(specimens, model, candidates)


def _sketched_changes(specimens: Trying, model: Hypothesis, candidates: Sequence[Candidate]) -> list[list[np.ndarray | None]]:
    """As :func:`changes_by_trials`, by the reduced specimens."""
    bare = Hypothesis(model.base, (), model.x[: len(model.base)])
    bases = [model if EFFECTS[one.effect].extends else bare for one in candidates for _ in one.trials]
    trials = [(one.term, values) for one in candidates for values in one.trials]
    models = [base.plus(term, values) for base, (term, values) in zip(bases, trials, strict=True)]
    answers = iter(specimens.sketched([*bases, *models]))
    before = [next(answers) for _ in bases]
    changes = iter([None if y is None or x is None else stack(y) - stack(x) for x, y in zip(before, answers, strict=True)])
    return [[next(changes) for _ in one.trials] for one in candidates]


def _simulated_changes(specimens: Trying, model: Hypothesis, candidates: Sequence[Candidate]) -> list[list[np.ndarray | None]]:
    """As :func:`changes_by_trials`, by the simulator."""
    plain = _without_history(specimens, model)
    jobs: list[tuple[Trying, Hypothesis, Hypothesis]] = []
    for one in candidates:
        effect = EFFECTS[one.effect]
        pointwise = specimens.homogeneous and effect.pointwise and specimens.pointwise(model)
        by_ramp = not (specimens.homogeneous or needs_history(effect) or effect.needs_half_body)
        numerics = LEANING if effect.needs_half_body else COARSE
        system, base = (specimens, model) if pointwise or by_ramp else (specimens.with_numerics(numerics), plain)
        base = model if effect.extends else base
        none = base
        if not pointwise and (specimens.homogeneous or needs_history(effect) or not effect.in_revolution):
            none = base.plus(one.term, (one.term.parameters[0].sought.none, *one.trials[0][1:]))
        jobs += [(system, base.plus(one.term, values), none) for values in one.trials]
    differences: list[np.ndarray | None] = [None] * len(jobs)
    together: dict[int, list[int]] = {}  # jobs that differ from the same model by little
    for k, (system, _, none) in enumerate(jobs):
        if system.exact(none) and not system.pointwise(none):
            together.setdefault(id(none), []).append(k)
    for own in together.values():
        system, _, none = jobs[own[0]]
        without, *weak = system.beside(none, [jobs[k][1].weakened(WEAK_SHARE) for k in own])
        for k, answer in zip(own, weak, strict=True):
            if answer is not None and without is not None:
                differences[k] = (stack(answer) - stack(without)) / WEAK_SHARE
    remaining = [k for k, one in enumerate(differences) if one is None]
    before = dict(zip(remaining, _each([(jobs[k][0], jobs[k][2]) for k in remaining]), strict=True))
    # An effect can leave a body too soft for an imposed force: its signature is then that of a weaker one.
    for share in TRIED_SHARES:
        open_jobs = [k for k in remaining if differences[k] is None and before[k] is not None]
        weaker = [(jobs[k][0], jobs[k][1].weakened(share)) for k in open_jobs]
        for k, answer in zip(open_jobs, _each(weaker), strict=True):
            other = before[k]
            if answer is not None and other is not None:
                differences[k] = (stack(answer) - stack(other)) / share
    columns = iter(differences)
    return [[next(columns) for _ in one.trials] for one in candidates]


def _each(jobs: Sequence[tuple[Trying, Hypothesis]]) -> list[Answer | None]:
    """Answers of models that are computed with different numerics, each kind together."""
    answers: dict[int, Answer | None] = {}
    for numerics in dict.fromkeys(repr(system.numerics) for system, _ in jobs):
        own = [k for k, (system, _) in enumerate(jobs) if repr(system.numerics) == numerics]
        answers |= dict(zip(own, jobs[own[0]][0].answers([jobs[k][1] for k in own], with_slopes=False), strict=True))
    return [answers[k] for k in range(len(jobs))]


def _without_history(specimens: Trying, model: Hypothesis) -> Hypothesis:
    """The model without effects that need whole histories: others change about as much, and take a fraction of the time."""
    if specimens.pointwise(model):
        return model
    kept = [k for k, term in enumerate(model.terms) if not needs_history(EFFECTS[term.effect])]
    x, start = list(model.x[: len(model.base)]), len(model.base)
    for k, term in enumerate(model.terms):
        if k in kept:
            x += list(model.x[start : start + len(term.parameters)])
        start += len(term.parameters)
    return Hypothesis(model.base, tuple(model.terms[k] for k in kept), np.array(x))


def needs_history(effect: type[Effect]) -> bool:
    """Whether a body has to follow the whole course of a test; a machine that misreads does not change what the body does."""
    return effect.acts_on != "reading" and effect.depends_on_path
