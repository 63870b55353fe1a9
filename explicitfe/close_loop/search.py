"""The search for what a model lacks: fit, residual, candidates, refit, and again; from a system to a verdict, without files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from explicitfe.close_loop.rivals import excluded, fits, gain_over, separations_of, worth_a_refit
from explicitfe.close_loop.selection import CrossValidation, select, why_not_fitted
from explicitfe.close_loop.statistics.covariance import Covariance, measured_rows, outside, stack
from explicitfe.close_loop.statistics.fingerprints import (
    NOT_SIGNIFICANT,
    SIGNIFICANT,
    Fingerprint,
    LackOfFit,
    Score,
    by_rows,
    fingerprints,
    lack_of_fit,
    scores,
)
from explicitfe.close_loop.statistics.noise import RowNoise, Scatter, row_noise, row_noise_beside, scatter
from explicitfe.close_loop.statistics.refit import BestFit, refit
from explicitfe.close_loop.statistics.starts import renewed, settled
from explicitfe.close_loop.statistics.system import Candidate, Hypothesis, System
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.results.loop_report import Remainder, Verdict

# Floors of assumed quantities have names that begin so; the others are of the numerics.
ASSUMED = "assumed "
# Shares of the whole search that are done when each stage begins; the rounds take what lies between the last two.
BASELINE_PROGRESS, FLOORS_PROGRESS, ROUNDS_PROGRESS, ROUNDS_PROGRESS_SHARE = 0.02, 0.06, 0.1, 0.8

NO_MORE_EFFECTS = "not added: the limit on the number of effects is reached (--max-effects)"

Watch = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Round:
    """One turn of the search.

    Attributes
    ----------
    fit, covariance : the model of this round at its best, and the covariance that it was judged with.
    lack : its lack of fit.
    p : p-value of the residual, from the lack of fit and from the best candidate together.
    p_is_bound : p is an upper bound, because no draw of the bootstrap reached the best candidate's drop.
    scores : of all candidates.
    prints : fingerprints of those that could be computed.
    refits : effect -> the model with it, at its best.
    failures : effect -> why that could not be computed.
    cv : effect -> cross-validated error of each test; "" is the model without a further effect.
    chosen : the effect that was added; None if none was.
    why_not : significant effect -> why it was not added here.
    best : the effect that was chosen, or that cannot be told from others.
    ambiguous_with : effects that these data cannot tell from the best.
    separations : (a, b, |y_a - y_b|^2).
    no_consequence : significant effects that do not lower the errors of left-out tests by more than the error of that gain.
    is_form : what is left may be the form of an effect that was added.
    """

    fit: BestFit
    covariance: Covariance
    lack: LackOfFit
    p: float
    scores: list[Score]
    p_is_bound: bool = False
    prints: tuple[Fingerprint, ...] = ()
    refits: dict[str, BestFit] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    cv: CrossValidation = field(default_factory=dict)
    chosen: str | None = None
    why_not: dict[str, str] = field(default_factory=dict)
    best: str | None = None
    ambiguous_with: tuple[str, ...] = ()
    separations: tuple[tuple[str, str, float], ...] = ()
    no_consequence: tuple[str, ...] = ()
    is_form: bool = False

    @property
    def at_floor(self) -> bool:
        """Whether no more than noise is left."""
        return self.p > THRESHOLDS.significance_p


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where the search ended.

    Attributes
    ----------
    rounds : the last one is that of the final model.
    effects : what is missing, in the order in which it was added.
    nearest : effects that help without explaining what is missing.
    no_consequence : effects that are significant, and of no consequence for tests that were left out.
    message : why a fit failed.
    """

    verdict: Verdict
    remainder: Remainder
    rounds: list[Round]
    effects: tuple[str, ...]
    nearest: tuple[str, ...] = ()
    no_consequence: tuple[str, ...] = ()
    message: str = ""

    @property
    def keeps_effects(self) -> bool:
        """Whether the final model has effects: those that are missing, or those that help without being what is missing."""
        return self.verdict in ("effect-found", "ambiguous", "unexplained") and bool(self.rounds[-1].fit.model.effects)


def covariance_of(
    system: System, model: Hypothesis, rows: Sequence[RowNoise], spread: Scatter, assumed: dict[str, np.ndarray]
) -> Covariance:
    """Sigma at a model: noise of rows, scatter between tests, numerics, and what is assumed (name -> change (n,) SI)."""
    (answer,) = system.answers([model])
    assert answer is not None
    base = stack(answer)
    floors = {name: stack(other) - base for name, other in system.checks(model).items()}
    return Covariance(system.series, rows, spread, floors | assumed)


def numerical_shares(covariance: Covariance, fit: BestFit, names: Sequence[str]) -> dict[str, float]:
    """Floor -> rms of its change, outside what the constants can imitate, as a share of the noise of the rows."""
    shares = {}
    for name in names:
        d = covariance.floors[name]
        rows = covariance.by_rows(np.column_stack([d, fit.slopes]))
        change = outside(rows[:, 1:], rows[:, :1])
        shares[name] = float(np.sqrt(np.mean(change**2)))
    return shares


def _numerical_chi2(covariance: Covariance, fit: BestFit, other: BestFit) -> float:
    """What numerics may change of the gain of another model over a fit, where the misfit is gross and chi2 is that of the rows
    alone; elsewhere numerics are in Sigma.

    A change d of what both answer changes a gain 2 r D - D D by 2 d D, where D is the difference of their answers.
    """
    if fit.by_rows is None:
        return 0.0
    floors = [d for name, d in covariance.floors.items() if not name.startswith(ASSUMED)]
    rows = covariance.by_rows(np.column_stack([other.answer - fit.answer, *floors, fit.slopes]))
    changes = outside(rows[:, 1 + len(floors) :], rows[:, 1 : 1 + len(floors)])
    return float(np.linalg.norm(2.0 * rows[:, 0] @ changes))


def search(
    system: System,
    *,
    max_effects: int,
    start: Hypothesis | None = None,
    rows: Sequence[RowNoise] | None = None,
    single: bool = False,
    seed: int = 0,
    watch: Watch = lambda stage, share: None,
) -> Outcome:
    """Add the effect that explains most, again and again, until nothing is left or nothing helps.

    Parameters
    ----------
    start : the baseline with constants to begin with; the system's own if left out.
    rows : noise of the rows; estimated if left out.
    single : there is one test only, so that nothing can be confirmed by another.
    watch : called with what is done now and the share of the whole that is done.

    Raises
    ------
    RunError : the baseline cannot be computed.
    """
    estimated = rows is None
    rows = row_noise(system.series) if rows is None else rows
    spread = scatter(system.series, rows)
    watch("fit of the baseline", BASELINE_PROGRESS)
    by_tests = Covariance(system.series, rows, spread)
    baseline = settled(system, refit(system, start or system.start(), by_tests), by_tests)
    system, baseline = renewed(system, baseline, by_tests)
    if estimated:
        rows = row_noise_beside(system.series, rows, baseline.answer)
        spread = scatter(system.series, rows)
    watch("numerical error", FLOORS_PROGRESS)
    assumed = {f"{ASSUMED}{name}": stack(answer) - baseline.answer for name, answer in system.assumptions(baseline.model).items()}
    covariance = covariance_of(system, baseline.model, rows, spread, assumed)
    fit = settled(system, refit(system, baseline.model, covariance, slopes=baseline.slopes), covariance)
    rounds: list[Round] = []
    while True:
        covariance = covariance.at(fit.answer)
        share = ROUNDS_PROGRESS + ROUNDS_PROGRESS_SHARE * len(rounds) / (max_effects + 1)
        watch(f"round {len(rounds) + 1} of at most {max_effects + 1}", share)
        seen, systems = _round(system, fit, covariance, seed, last=len(rounds) >= max_effects, first=not rounds)
        rounds.append(_without_form(rounds, seen))
        if not fit.converged and len(rounds) == 1:
            return Outcome("failed", "unexplained", rounds, (), message="the fit of the baseline did not converge.")
        chosen = rounds[-1].chosen
        if chosen is None:
            break
        watch(f"add effect {chosen}", ROUNDS_PROGRESS + ROUNDS_PROGRESS_SHARE * len(rounds) / (max_effects + 1))
        system, fit = systems[chosen], rounds[-1].refits[chosen]
        if estimated:
            rows = row_noise_beside(system.series, rows, fit.answer)
        covariance = covariance_of(system, fit.model, rows, spread, assumed)
        fit = settled(system, refit(system, fit.model, covariance, slopes=fit.slopes), covariance)
    return _outcome(rounds, single)


def conclude(system: System, outcome: Outcome, model: Hypothesis) -> list[Round]:
    """Rounds that end at another model than that of an outcome.

    Raises
    ------
    RunError : the model cannot be computed.
    """
    first, last = outcome.rounds[0], outcome.rounds[-1]
    system = system.at(model)
    assumed = {name: d for name, d in first.covariance.floors.items() if name.startswith(ASSUMED)}
    covariance = covariance_of(system, model, last.covariance.rows, last.covariance.scatter, assumed)
    fit = settled(system, refit(system, model, covariance), covariance)
    seen, _ = _round(system, fit, covariance.at(fit.answer), 0, last=True, first=False)
    return [first, seen]


def _without_form(before: Sequence[Round], seen: Round) -> Round:
    """The round, without an effect that remembers whose gain may be the form of one that was added before.

    Real tissue does not remember by one formula. What that leaves looks like a second memory, not like a sensor or a tool.
    """
    remembering = {s.candidate.effect for one in before for s in one.scores if s.candidate.remembers}
    # Where two are there already, their forms are no excuse: then it is another memory altogether.
    if seen.chosen not in remembering or len(remembering.intersection(seen.fit.model.effects)) != 1:
        return seen
    gain = seen.fit.whitened - seen.refits[seen.chosen].whitened
    if gain > THRESHOLDS.form_excess_share * before[0].lack.excess:
        return seen
    why = {seen.chosen: "not added: so small a residual may be a model-form error of the history-dependent effect that was found"}
    return replace(seen, chosen=None, best=None, why_not=seen.why_not | why, is_form=True)


def _outcome(rounds: list[Round], single: bool) -> Outcome:
    """The verdict, by the first line that applies."""
    first, last = rounds[0], rounds[-1]
    effects = last.fit.model.effects
    slight = last.no_consequence
    quiet = last.at_floor or bool(slight) or _below_floor(last)
    left: Remainder = "ambiguous" if last.ambiguous_with else "unexplained"
    remainder: Remainder = "at-floor" if quiet else "form" if last.is_form else left
    # An error below its own floor is nothing that is missing, whatever correlates in it.
    if first.at_floor or first.no_consequence or (_below_floor(first) and not effects and not first.ambiguous_with):
        verdict: Verdict = "limited-by-numerics" if _limited_by_numerics(first) else "no-missing-effect"
        return Outcome(verdict, "at-floor", rounds, (), no_consequence=slight)
    if first.best is None:
        return Outcome("unexplained", "unexplained", rounds, ())
    if not effects:
        if first.ambiguous_with:
            alike = (first.best, *first.ambiguous_with)
            least = min(lack_of_fit(first.refits[name], first.covariance).excess for name in alike if name in first.refits)
            if least > THRESHOLDS.unexplained_excess_share * first.lack.excess:
                return Outcome("unexplained", "unexplained", rounds, (), nearest=alike)
            return Outcome("ambiguous", "ambiguous", rounds, ())
        return Outcome("unexplained", "unexplained", rounds, ())
    # Where two effects cannot be told apart, what either of them explains counts as explained.
    more = last.fit.whitened - last.refits[last.best].whitened if last.ambiguous_with and last.best else 0.0
    most = max(THRESHOLDS.unexplained_excess_share * first.lack.excess, THRESHOLDS.visible_separation)
    if not quiet and not last.is_form and last.lack.excess - more > most:
        return Outcome("unexplained", "unexplained", rounds, (), nearest=effects)
    if single:
        return Outcome("ambiguous", remainder, rounds, effects, no_consequence=slight)
    return Outcome("effect-found", remainder, rounds, effects, no_consequence=slight)


def _below_floor(one: Round) -> bool:
    """Whether each series is missed by no more than noise and numerics."""
    off = measured_rows(one.covariance.series) - one.fit.answer
    misses = [float(np.sqrt(np.mean(off[part] ** 2))) for part in one.covariance.slices()]
    return all(miss <= one.covariance.floor_of(k, one.fit.slopes) for k, miss in enumerate(misses))


def _limited_by_numerics(one: Round) -> bool:
    """Whether something would be left if the numerics were free of error, while their bound is no small part of the noise."""
    covariance, fit = one.covariance, one.fit
    names = [name for name in covariance.floors if not name.startswith(ASSUMED)]
    shares = numerical_shares(covariance, fit, names)
    if float(np.linalg.norm(list(shares.values()))) <= THRESHOLDS.numerics_bound_share:
        return False
    exact = replace(covariance, floors={name: d for name, d in covariance.floors.items() if name not in names})
    residual = exact.whiten(measured_rows(covariance.series) - fit.answer)
    bare = replace(fit, residual=residual, jacobian=exact.whiten(fit.slopes))
    return lack_of_fit(bare, exact).p <= THRESHOLDS.significance_p


def _round(
    system: System, fit: BestFit, covariance: Covariance, seed: int, *, last: bool, first: bool, all_tried: bool = False
) -> tuple[Round, dict[str, System]]:
    """What a model lacks, and which effect explains it best; with the forward model of each effect that was fitted.

    Parameters
    ----------
    first, last : no effect was added before; none may be added any more.
    all_tried : candidates are tried that would not be because no smooth curve explains anything of what is left.
    """
    lack = lack_of_fit(fit, covariance)
    candidates = system.candidates(fit.model)
    quiet = system.costly(fit.model) and lack.p > THRESHOLDS.quiet_p and not all_tried
    forgets = not quiet and system.costly(fit.model) and _forgets(system, fit, covariance)
    whys = [_why_not_tried(c, quiet=quiet, first=first, forgets=forgets) for c in candidates]
    tried = [c for c, why in zip(candidates, whys, strict=True) if not why]
    untried = [Score(c, NOT_SIGNIFICANT, 0.0, 1.0, 1.0, (), why) for c, why in zip(candidates, whys, strict=True) if why]
    if not tried:
        return Round(fit, covariance, lack, lack.p, untried), {}
    prints = fingerprints(system, fit, covariance, tried)
    scored = [*scores(fit, prints, tried, seed), *untried]
    if fit.by_rows is not None:
        scored = by_rows(scored, prints, fit, covariance)
    # One residual is looked at twice, for any smooth curve and for what the candidates would do, so the smaller p counts twice.
    least, is_bound = min([(lack.p, False), *((s.p_holm, s.p_is_bound) for s in scored)])
    seen = Round(fit, covariance, lack, min(1.0, 2.0 * least), scored, p_is_bound=is_bound, prints=tuple(prints))
    significant = sorted((s for s in scored if s.status == SIGNIFICANT), key=lambda s: -s.promise)
    if quiet and first and significant and not seen.at_floor:
        # One of the candidates explains something after all: it has to be the best of all of them.
        return _round(system, fit, covariance, seed, last=last, first=first, all_tried=True)
    if seen.at_floor or not significant or last:
        why = "not added: the residual is within the noise" if seen.at_floor else NO_MORE_EFFECTS
        return replace(seen, why_not={s.candidate.effect: why for s in significant}), {}
    promising, near = worth_a_refit(system, fit, significant, scored)
    refits, systems, failures = fits(system, fit, covariance, promising, near)
    numerical = {name: _numerical_chi2(covariance, fit, other) for name, other in refits.items()}
    # Whatever explains a gross misfit does not do so by chance.
    allowed = {s.candidate.effect for s in (significant if fit.by_rows is None else scored)}
    selection = select(system, fit, refits, allowed, covariance, numerical)
    fitted = [s for s in significant if s.candidate.effect in refits]
    why_not = {s.candidate.effect: why_not_fitted(s, fitted) for s in significant if s not in fitted} | selection.why_not
    best = selection.best
    seen = replace(
        seen, refits=refits, failures=failures, cv=selection.cv, why_not=why_not, no_consequence=selection.no_consequence
    )
    if best is None:
        return seen, systems
    separations, unsure = _separated(systems, best, refits, covariance)
    usual = {s.candidate.effect: s.candidate.variant_of or s.candidate.effect for s in scored}
    if usual[best] in unsure:
        # Two forms of one mechanism that these data cannot tell apart: the usual one is taken.
        why_not = why_not | {best: f"not added: not distinguishable from {usual[best]}, the usual form of this mechanism"}
        best = usual[best]
        separations, unsure = _separated(systems, best, refits, covariance)
    # An effect that was not fitted cannot be told from the best one if its trial explains about as much.
    likely_drop = gain_over(fit, refits[best], covariance) - THRESHOLDS.told_apart_separation
    unsure += [s.candidate.effect for s in near if s.candidate.effect not in refits and s.promise > likely_drop]
    unsure = [rival for rival in unsure if usual[rival] != usual[best]]
    if unsure:
        alike = {rival: f"not added: not distinguishable from {best}" for rival in unsure}
        why_not = why_not | alike | {best: f"not added: not distinguishable from {' and '.join(unsure)}"}
    judged = replace(
        seen,
        chosen=None if unsure else best,
        why_not=why_not,
        best=best,
        ambiguous_with=tuple(unsure),
        separations=tuple(separations),
    )
    return judged, systems


def _forgets(system: System, fit: BestFit, covariance: Covariance) -> bool:
    """Whether what is left is a function of the programme's value alone, up to noise: then nothing is remembered."""
    state = system.functions_of_state()
    return state is not None and lack_of_fit(fit, covariance, state).p > THRESHOLDS.quiet_p


def _why_not_tried(candidate: Candidate, *, quiet: bool, first: bool, forgets: bool) -> str:
    """Why a candidate is not tried on a mesh; "" if it is."""
    if quiet and (candidate.dear or not first):
        return "not tried: the residual has no smooth part"
    if forgets and candidate.remembers:
        return "not tried: the residual does not depend on history"
    return ""


def _separated(
    systems: dict[str, System], best: str, refits: dict[str, BestFit], covariance: Covariance
) -> tuple[list[tuple[str, str, float]], list[str]]:
    """How far the answers of the best model and of each rival lie apart, and the rivals that cannot be told from it."""
    clear = excluded(best, refits, covariance)
    separations = separations_of(systems, best, refits, clear, covariance)
    return separations, [
        rival for _, rival, apart in separations if apart < THRESHOLDS.told_apart_separation and rival not in clear
    ]
