"""The loop: fit, residual, candidates, refit, again; from a system to a verdict, with nothing of files in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from explicitfe.close_loop.statistics.covariance import Covariance, stacked
from explicitfe.close_loop.statistics.fingerprints import (
    LEVEL,
    NOT_SIGNIFICANT,
    SIGNIFICANT,
    LackOfFit,
    Score,
    fingerprints,
    lack_of_fit,
    outside,
    scores,
)
from explicitfe.close_loop.statistics.noise import RowNoise, Scatter, row_noise, scatter
from explicitfe.close_loop.statistics.refit import Fitted, cross_validated, refit
from explicitfe.close_loop.statistics.system import Hypothesis, System
from explicitfe.errors import RunError

Verdict = Literal["failed", "no-missing-effect", "unexplained", "ambiguous", "effect-found"]
Remainder = Literal["at-floor", "unexplained", "ambiguous"]
MOST_REFITTED, MOST_REFITTED_ROUGH = 8, 3
QUIET = 0.2  # p of the lack of fit: where runs are dear, candidates are not tried on what is left
NEAR = 60.0  # of chi2: candidates this near to the best are refitted too, for they may be mistaken for it
WORTH, WORTH_A_MESH = 0.25, 0.6  # of the best drop: a candidate is refitted
GROWS = 1.5  # times: so much more than its best trial a candidate may explain when it is fitted
FAR = 150.0  # of chi2: so much worse on the data themselves, a model is told apart
# |y_A - y_B|^2 from which on data that are there tell two models apart. Sigma is cautious, so this asks for less than a plan does
# (DISTINCT): of the 309 tuning cases it decided 11 singles more, all of them rightly.
APART = 16.0
HALF = 0.5  # of the excess that must be explained before an effect is said to be what is missing
FEW_TESTS = 3  # left out in turn
WORTH_IT = 0.02  # of the cross-validated error, by which an effect more must lower it
ASSUMED = "assumed "
NOISE_SHARE = 0.5  # of the noise, that numerics may reach

Watch = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Step:
    """One turn of the loop.

    Attributes
    ----------
    fit : the model of this turn, at its best; ``covariance`` that it was judged with.
    lack, p : lack of fit, and the p-value of the residual: of it and of the best candidate together.
    scores : of all candidates.
    refits : effect -> model with it, at its best; ``cv`` effect -> cross-validated error of each test, "" is without any.
    chosen : the effect that was added; None if none was.
    ambiguous_with : effects that these data cannot tell from the best.
    best : the one that they cannot be told from, or that was chosen.
    separations : (a, b, |y_a - y_b|^2).
    """

    fit: Fitted
    covariance: Covariance
    lack: LackOfFit
    p: float
    scores: list[Score]
    refits: dict[str, Fitted] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    cv: dict[str, dict[str, float]] = field(default_factory=dict)
    chosen: str | None = None
    best: str | None = None
    ambiguous_with: tuple[str, ...] = ()
    separations: tuple[tuple[str, str, float], ...] = ()

    @property
    def at_floor(self) -> bool:
        """Whether nothing is left but noise."""
        return self.p > LEVEL


@dataclass(frozen=True, eq=False)
class Closed:
    """Where the loop ended.

    Attributes
    ----------
    steps : the last one is that of the final model.
    effects : found, in order.
    nearest : effects that help without explaining what is missing.
    message : why a fit failed.
    """

    verdict: Verdict
    remainder: Remainder
    steps: list[Step]
    effects: tuple[str, ...]
    nearest: tuple[str, ...] = ()
    message: str = ""


def covariance_of(
    system: System, model: Hypothesis, rows: Sequence[RowNoise], spread: Scatter, assumed: dict[str, np.ndarray]
) -> Covariance:
    """Sigma at a model: rows, repeats, numerics, what is assumed."""
    (now,) = system.answers([model])
    assert now is not None
    base = stacked(now)
    floors = {name: stacked(answer) - base for name, answer in system.checks(model).items()}
    return Covariance(system.series, rows, spread, floors | assumed)


def numerical_share(covariance: Covariance, fit: Fitted, names: Sequence[str]) -> dict[str, float]:
    """Rms of what numerics change, outside what the constants can imitate, over the noise of the rows."""
    found = {}
    for name in names:
        d = covariance.floors[name]
        rows = covariance.by_rows(np.column_stack([d, fit.slopes]))
        rest = outside(rows[:, 1:], rows[:, :1])
        found[name] = float(np.sqrt(np.mean(rest**2)))
    return found


def _numerical(covariance: Covariance, fit: Fitted) -> float:
    """Chi2 of what numerics change where the misfit is gross, that is where chi2 is of rows alone; else it is in Sigma."""
    if fit.by_rows is None:
        return 0.0
    shares = numerical_share(covariance, fit, [name for name in covariance.floors if not name.startswith(ASSUMED)])
    return len(fit.answer) * sum(share**2 for share in shares.values())


def close(
    system: System,
    *,
    max_effects: int,
    start: Hypothesis | None = None,
    rows: Sequence[RowNoise] | None = None,
    single: bool = False,
    seed: int = 0,
    watch: Watch = lambda what, share: None,
) -> Closed:
    """Run the loop.

    Parameters
    ----------
    start : the baseline with constants to begin with; the system's own if left out.
    single : there is one curve only, so that nothing can be confirmed by another.
    watch : called with what is done now and the share of the whole that is done.

    Raises
    ------
    RunError : the baseline cannot be computed.
    """
    rows = row_noise(system.series) if rows is None else rows
    spread = scatter(system.series, rows)
    watch("fit the baseline", 0.02)
    baseline = refit(system, start or system.start(), Covariance(system.series, rows, spread))
    watch("floors", 0.06)
    assumed = {
        f"{ASSUMED}{name}": stacked(answer) - baseline.answer for name, answer in system.assumptions(baseline.model).items()
    }
    covariance = covariance_of(system, baseline.model, rows, spread, assumed)
    fit = refit(system, baseline.model, covariance, slopes=baseline.slopes)
    steps: list[Step] = []
    while True:
        covariance = covariance.at(fit.answer)
        watch("trace the residual", 0.1 + 0.8 * len(steps) / (max_effects + 1))
        step = _step(system, fit, covariance, seed, last=len(steps) >= max_effects, first=not steps)
        steps.append(step)
        if not fit.converged and len(steps) == 1:
            return Closed("failed", "unexplained", steps, (), message="the search for the best parameters gave up.")
        if step.chosen is None:
            break
        watch("add an effect", 0.1 + 0.8 * len(steps) / (max_effects + 1))
        fit = step.refits[step.chosen]
        covariance = covariance_of(system, fit.model, rows, spread, assumed)
        fit = refit(system, fit.model, covariance, slopes=fit.slopes)
    return _verdict(steps, single)


def _verdict(steps: list[Step], single: bool) -> Closed:
    """By the first line that applies."""
    first, last = steps[0], steps[-1]
    found = last.fit.model.effects
    remainder: Remainder = "at-floor" if last.at_floor else "ambiguous" if last.ambiguous_with else "unexplained"
    if first.at_floor:
        return Closed("no-missing-effect", "at-floor", steps, ())
    if first.best is None:
        return Closed("unexplained", "unexplained", steps, ())
    if not found:
        return (
            Closed("ambiguous", "ambiguous", steps, ())
            if first.ambiguous_with
            else Closed("unexplained", "unexplained", steps, ())
        )
    # Of two that cannot be told apart either one counts.
    more = last.fit.whitened - last.refits[last.best].whitened if last.ambiguous_with and last.best else 0.0
    if not last.at_floor and last.lack.excess - more > HALF * first.lack.excess:
        return Closed("unexplained", "unexplained", steps, (), nearest=found)
    if single:
        return Closed("ambiguous", remainder, steps, found)
    return Closed("effect-found", remainder, steps, found)


def _step(system: System, fit: Fitted, covariance: Covariance, seed: int, *, last: bool, first: bool) -> Step:
    lack = lack_of_fit(fit, covariance)
    candidates = system.candidates(fit.model)
    if not first and not system.exact(fit.model) and lack.p > QUIET:
        why = "not tried: no smooth curve would explain anything of what is left"
        return Step(fit, covariance, lack, lack.p, [Score(c, NOT_SIGNIFICANT, 0.0, 1.0, 1.0, (), why) for c in candidates])
    prints = fingerprints(system, fit, covariance, candidates)
    scored = scores(fit, prints, candidates, seed)
    # Two looks at one residual: as any smooth curve, and as what the candidates would do.
    p = min(1.0, 2.0 * min([lack.p, *(s.p_holm for s in scored)]))
    step = Step(fit, covariance, lack, p, scored)
    significant = sorted((s for s in scored if s.status == SIGNIFICANT), key=lambda s: -s.drop)
    if step.at_floor or not significant or last:
        return step
    refits, failures = {}, {}
    most = MOST_REFITTED if system.exact(fit.model) else MOST_REFITTED_ROUGH
    # A fit finds more than the best trial, but not several times as much. One on a mesh costs more than all others together,
    # and most where the model remembers.
    top = significant[0].drop
    dear = WORTH_A_MESH if len(system.sketch(fit.model).terms) == len(fit.model.terms) else 1.0
    worth = [
        s for s in significant if (s.drop >= dear * top if s.candidate.reference else s.drop > WORTH * top or s.drop > top - NEAR)
    ]
    near = [s for s in scored if s not in worth and s.values and s.drop > top - NEAR]
    for score in worth[:most] + sorted((s for s in near if not s.candidate.reference), key=lambda s: -s.drop)[:most]:
        name = score.candidate.effect
        more = fit.model.plus(score.candidate.term, score.values)
        least = min((found.whitened for found in refits.values()), default=np.inf)
        if not system.exact(more) and fit.whitened - GROWS * score.drop > least + FAR:
            continue  # a fit would not bring it near the best
        try:
            refits[name] = refit(system, more, covariance)
        except RunError as error:
            failures[name] = str(error)
    allowed = {s.candidate.effect for s in significant}
    best, cv = _select(system, fit, refits, allowed, covariance)
    if best is not None and fit.chi2 - refits[best].chi2 <= _numerical(covariance, fit):
        best = None  # numerics may change as much
    step = Step(fit, covariance, lack, p, scored, refits, failures, cv)
    if best is None:
        return step
    chosen = refits[best]
    separations = []
    for name, rival in refits.items():
        if name == best:
            continue
        worse = rival.chi2 - chosen.chi2
        # what the data themselves tell apart needs no prediction
        apart = worse if worse > FAR else refit(system, rival.model, covariance, chosen.answer, rival.slopes).chi2
        separations.append((best, name, apart))
    unsure = [b for _, b, apart in separations if apart < APART]
    # One that was not fitted cannot be told from the best if it explains about as much.
    drop = fit.whitened - chosen.whitened
    unsure += [s.candidate.effect for s in near if s.candidate.effect not in refits and s.drop > drop - APART]
    return Step(
        fit,
        covariance,
        lack,
        p,
        scored,
        refits,
        failures,
        cv,
        chosen=None if unsure else best,
        best=best,
        ambiguous_with=tuple(unsure),
        separations=tuple(separations),
    )


def _select(
    system: System, fit: Fitted, refits: dict[str, Fitted], allowed: set[str], covariance: Covariance
) -> tuple[str | None, dict[str, dict[str, float]]]:
    """The effect to add: of the models about as good in cross-validation as the best the one with the least chi2 for its size.

    None where leaving curves out speaks against all of them.
    """
    cv = {"": cross_validated(system, fit, covariance)}
    cv |= {name: cross_validated(system, found, covariance) for name, found in refits.items()}
    size = np.log(max(covariance.effective, 2.0))
    worth = {name: refits[name].chi2 + size * len(refits[name].model.x) for name in refits if name in allowed}
    if not worth:
        return None, cv
    if not cv[""]:
        return min(worth, key=worth.__getitem__), cv
    mean = {name: float(np.mean(list(cv[name].values()))) for name in worth}
    first = min(mean, key=mean.__getitem__)
    near = [name for name in worth if _worse(cv[name], cv[first]) <= 1.0]
    best = min(near, key=worth.__getitem__)
    helps = worth[best] < fit.chi2 + size * len(fit.model.x)
    if fit.model.terms and len(cv[""]) >= FEW_TESTS:
        # One effect more must not harm tests that it was not fitted to; far above the noise, where everything is significant, it
        # must be worth it to them.
        most = 1.0 if fit.by_rows is None else 1.0 - WORTH_IT
        helps = helps and mean[best] < most * float(np.mean(list(cv[""].values())))
    return (best if helps and _worse(cv[best], cv[""]) <= 1.0 else None), cv


def _worse(one: dict[str, float], other: dict[str, float]) -> float:
    """By how many standard errors the errors of one model exceed those of another, test by test."""
    gap = np.array([one[test] - other[test] for test in one if test in other])
    if len(gap) < FEW_TESTS:
        return 0.0  # one of two rates does not say what the other will be: neither for a model nor against it
    error = float(np.std(gap, ddof=1) / np.sqrt(len(gap)))
    if error == 0.0:
        return 0.0 if gap.mean() <= 0.0 else np.inf
    return float(gap.mean()) / error
