"""Which test settles best what is open: the one from which most is expected to be learned in a minute of testing.

All causes that the data leave compete, with their probabilities: also those that the data cannot show at all. Each foretells what
a proposed test would read, with what is not known of its parameters after the data at hand. A test may be repeated: its rows and
the scatter of tests then count with as much less noise.

Each model predicts the rows as a normal distribution: a mean, and what is not known of its parameters. What a test is expected
to tell is the mutual information of model and rows. For mixtures of normal distributions it has no closed form, but a lower
bound by the Bhattacharyya distances of all pairs has (Kolchinsky & Tracey 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from explicitfe.inverse.close_loop.compared import ComparedCauses, Entry
from explicitfe.inverse.close_loop.evidence import prior_sd
from explicitfe.inverse.close_loop.proposals import ProposedCurve, proposals
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, stack
from explicitfe.inverse.close_loop.statistics.refit import derivatives
from explicitfe.inverse.close_loop.statistics.system import Candidate, Hypothesis, Parameter
from explicitfe.inverse.measured.curve import COLUMNS, programme_of
from explicitfe.inverse.measured.tables import RigLimits
from explicitfe.results.documents.loop_report import NextExperiment

# Causes that compete: where each answer is the run of a mesh, fewer.
MOST_CAUSES, MOST_CAUSES_ON_A_MESH = 4, 3
# Causes that the data cannot show are considered besides, so many of them.
MOST_UNSEEN, MOST_UNSEEN_ON_A_MESH = 3, 1
TRIED_REPEATS = (1, 2, 3, 5)
MOST_LISTED = 3
# Precision that keeps a parameter finite which the data do not determine, as a share of the largest.
SMALLEST_PRECISION_SHARE = 1e-10
# A uniform prior over a range has the variance of its square over this number.
UNIFORM_VARIANCE_DIVISOR = 12.0
# Causes that are less probable do not compete.
LEAST_PROBABILITY = 0.005
# Of tests that are expected to yield at least this share of the largest information the quickest is proposed, if it yields this
# share of the entropy of the causes.
ENOUGH_SHARE, WORTHWHILE_SHARE = 0.7, 0.05
NATS_PER_BIT = float(np.log(2.0))
# Directions in which models foretell less than this share of the largest change are none.
DIFFERING_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Survivor:
    """A cause that the data leave.

    Attributes
    ----------
    name : in words.
    probability : of it.
    model : with its best parameters.
    precision : (p, p) of these, by the data and by what was believed before.
    """

    name: str
    probability: float
    model: Hypothesis
    precision: np.ndarray


def survivors(system: Specimens, comparison: ComparedCauses) -> list[Survivor]:
    """Causes that the data leave, the most probable first."""
    costly = system.costly(comparison.baseline.model)
    left = []
    for causes, p in list(comparison.posterior.sets.items())[: MOST_CAUSES_ON_A_MESH if costly else MOST_CAUSES]:
        entry = comparison.best_of(causes)
        if entry is not None and p >= LEAST_PROBABILITY:
            left.append(_survivor(entry, p))
    if not left:
        return []
    return [*left, *_unseen(system, comparison, left[0], MOST_UNSEEN_ON_A_MESH if costly else MOST_UNSEEN)]


def _survivor(entry: Entry, probability: float) -> Survivor:
    assert entry.fit is not None
    precision = entry.fit.jacobian.T @ entry.fit.jacobian
    for k, term in zip(_starts(entry.model), entry.model.terms, strict=True):
        precision[k : k + len(term.parameters), k : k + len(term.parameters)] += np.diag(prior_precision(term.parameters))
    return Survivor(" + ".join(sorted(entry.causes)) or "nothing", probability, entry.model, precision)


def prior_precision(parameters: Sequence[Parameter]) -> np.ndarray:
    """Precision (q,) of a term's parameters before the data, in their coordinates: a plausible strength, a range of shapes."""
    strength, *shapes = parameters
    widths = [max(shape.high - shape.low, 1e-300) for shape in shapes]
    return np.array([prior_sd(strength) ** -2.0, *(UNIFORM_VARIANCE_DIVISOR / width**2 for width in widths)])


def _starts(model: Hypothesis) -> list[int]:
    """Place of the first parameter of each term."""
    sizes = [len(term.parameters) for term in model.terms]
    return [len(model.base) + sum(sizes[:k]) for k in range(len(sizes))]


def _unseen(system: Specimens, comparison: ComparedCauses, best: Survivor, most: int) -> list[Survivor]:
    """The most probable model with each effect that these data cannot show but another test of the kind might.

    The data do not change its probability, and it is as strong as is usual. Effects that need a mesh where the most probable
    model needs none are left out: a proposal is not worth their time.
    """
    candidates = [
        c
        for c in system.possible(best.model)
        if c.effect in comparison.not_testable
        and system.costly(best.model.plus(c.term, usual_values(c))) == system.costly(best.model)
    ]
    models = [best.model.plus(c.term, usual_values(c)) for c in candidates[:most]]
    odds = 1.0 / max(comparison.prior.causes + len(candidates) - 1, 1)
    unseen: list[Survivor] = []
    for candidate, model, answer in zip(candidates, models, system.answers(models), strict=False):
        if answer is None:  # it cannot be present alone, or not here
            continue
        size = len(best.precision)
        precision = np.zeros((len(model.x), len(model.x)))
        precision[:size, :size] = best.precision
        precision[size:, size:] = np.diag(prior_precision(candidate.term.parameters))
        name = candidate.effect if best.name == "nothing" else f"{best.name} + {candidate.effect}"
        unseen.append(Survivor(name, odds * best.probability, model, precision))
    return unseen


def usual_values(candidate: Candidate) -> tuple[float, ...]:
    """A middle strength, of the larger sign, and middle shapes."""
    strength, *shapes = candidate.term.parameters
    none = strength.sought.coordinate(strength.sought.none)
    largest = max(strength.sought.values, key=lambda v: abs(strength.sought.coordinate(v) - none))
    side = strength.sought.coordinate(largest) > none
    tried = sorted(v for v in strength.sought.values if (strength.sought.coordinate(v) > none) == side)
    middles = [sorted(shape.sought.values)[len(shape.sought.values) // 2] for shape in shapes]
    return (tried[len(tried) // 2], *middles)


def next_tests(system: Specimens, causes: Sequence[Survivor], covariance: Covariance, limits: RigLimits) -> list[NextExperiment]:
    """The tests that tell most about which cause is right in a minute of testing, the best first."""
    if len(causes) < 2:
        return []
    ranked = []
    # What the rig can do follows from the dataset itself: a test that was added because it was proposed asks for no larger one.
    own = {curve.id for curve in system.dataset.curves}
    for proposal in proposals(tuple(c for c in system.curves if c.id in own), limits):
        foretold = _foretold(system, causes, covariance, proposal, limits)
        if foretold is None:
            continue
        for repeats in TRIED_REPEATS:
            again = [Foretold(m.probability, np.sqrt(repeats) * m.mean, _repeated(m, repeats)) for m in foretold]
            bits, minutes = expected_bits(again), repeats * proposal.minutes(limits)
            ranked.append((bits / minutes, bits, minutes, repeats, proposal, again))
    ranked.sort(key=lambda entry: -entry[0])
    chosen: dict[str, NextExperiment] = {}
    # A cheap test that settles little is cheap for every bit, and leaves the question open.
    enough = max(
        WORTHWHILE_SHARE * entropy_bits([c.probability for c in causes]),
        ENOUGH_SHARE * max((bits for _, bits, *_ in ranked), default=0.0),
    )
    for _, bits, minutes, repeats, proposal, again in ranked:
        if proposal.words in chosen or bits < enough or len(chosen) == MOST_LISTED:
            continue
        chosen[proposal.words] = _reported(proposal, repeats, bits, minutes, causes, again)
    return list(chosen.values())


def _repeated(model: Foretold, repeats: int) -> np.ndarray:
    """The spread where rows are averaged over repeats: the last two columns are the scatter of one test and shrink with them."""
    spread = np.sqrt(repeats) * model.spread
    spread[:, -2:] /= np.sqrt(repeats)
    return spread


def _foretold(
    system: Specimens, causes: Sequence[Survivor], covariance: Covariance, proposal: ProposedCurve, limits: RigLimits
) -> list[Foretold] | None:
    """What each cause says of a test, whitened; None where one cannot be computed or the load cell cannot bear it."""
    test = replace(system, curves=(proposal.curve,))
    source = max(range(len(system.curves)), key=lambda k: system.curves[k].time_s[-1])
    noise = covariance.rows[source]
    answers = test.answers([cause.model for cause in causes])
    if any(answer is None for answer in answers):
        return None
    means = [stack(answer) for answer in answers if answer is not None]
    foretold = []
    for cause, y, slopes in zip(causes, means, _slopes(test, causes, means), strict=True):
        if proposal.curve.predicted == "force_N" and limits.largest_force_N is not None and y.max() > limits.largest_force_N:
            return None
        by = 1.0 / (float(noise.sd.mean()) * np.sqrt(len(noise.sd) / noise.effective))
        J = by * slopes
        scale = by * covariance.scatter.scale * y
        offset = np.full(len(y), by * covariance.scatter.offset * float(np.abs(y).max()))
        foretold.append(Foretold(cause.probability, by * y, np.column_stack([J @ _root(cause.precision), scale, offset])))
    return foretold


def _slopes(test: Specimens, causes: Sequence[Survivor], means: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Derivatives (n, p) of what each cause answers by its parameters.

    Where each answer is the run of a mesh, all share those of the constants, and an effect has the secant of its strength.
    """
    if not any(test.costly(cause.model) for cause in causes):
        return [derivatives(test, cause.model, y) for cause, y in zip(causes, means, strict=True)]
    first = causes[0].model
    constants = derivatives(test, Hypothesis(first.base, (), first.x[: len(first.base)]), means[0])
    slopes = []
    for cause, y in zip(causes, means, strict=True):
        J = np.zeros((len(y), len(cause.model.x)))
        J[:, : len(first.base)] = constants
        starts = _starts(cause.model)
        bare = [
            cause.model.at(np.where(np.arange(len(cause.model.x)) == k, _none(cause.model, k), cause.model.x)) for k in starts
        ]
        for k, answer in zip(starts, test.answers(bare), strict=True):
            if answer is not None and cause.model.x[k] != _none(cause.model, k):
                J[:, k] = (y - stack(answer)) / (cause.model.x[k] - _none(cause.model, k))
        slopes.append(J)
    return slopes


def _none(model: Hypothesis, place: int) -> float:
    """The coordinate of a strength without its effect."""
    sought = model.parameters[place].sought
    return sought.coordinate(sought.none)


def _root(precision: np.ndarray) -> np.ndarray:
    """(p, p) L with L L^T the covariance of parameters of this precision."""
    size = np.sqrt(np.maximum(np.diag(precision), SMALLEST_PRECISION_SHARE * max(float(np.diag(precision).max()), 1e-300)))
    values, axes = np.linalg.eigh(precision / np.outer(size, size))
    return (axes / np.sqrt(np.maximum(values, SMALLEST_PRECISION_SHARE))) / size[:, None]


def _reported(
    proposal: ProposedCurve, repeats: int, bits: float, minutes: float, causes: Sequence[Survivor], again: Sequence[Foretold]
) -> NextExperiment:
    """A proposal as the report has it, with what is expected of it."""
    order = np.argsort([-c.probability for c in causes])[:2]
    expected = {
        "separates": [causes[k].name for k in order],
        "separation": separation(again[order[0]], again[order[1]]),
        "information_bits": bits,
        "minutes": minutes,
    }
    return reported_programme(proposal, repeats).model_copy(update=expected)


def reported_programme(proposal: ProposedCurve, repeats: int) -> NextExperiment:
    """A proposal in words, with the programme in the unit of the file."""
    curve = proposal.curve
    column, factor = next((name, by) for name, (si, by) in COLUMNS[curve.kind].items() if si == curve.imposed)
    return NextExperiment(
        protocol=proposal.words + (f", {repeats} times" if repeats > 1 else ""),
        repeats=repeats,
        imposed=column,
        programme=[[float(t), float(x / factor)] for t, x in zip(curve.time_s, programme_of(curve), strict=True)],
        specimen=None
        if curve.specimen is None
        else curve.specimen.model_dump(mode="json", exclude_none=True, exclude_defaults=True),
        tool=None if curve.tool is None else curve.tool.model_dump(mode="json", exclude_none=True, exclude_defaults=True),
        conditions=dict(curve.conditions),
    )


@dataclass(frozen=True, eq=False)
class Foretold:
    """What a model says of rows that are not measured yet, whitened by their noise.

    Attributes
    ----------
    probability : of the model.
    mean : (n,).
    spread : (n, q), one standard deviation of each independent thing that is not known.
    """

    probability: float
    mean: np.ndarray
    spread: np.ndarray


def expected_bits(models: Sequence[Foretold]) -> float:
    """Bits that rows are expected to tell about which model is right; no more than their entropy."""
    p = np.array([m.probability for m in models])
    p = p / p.sum()
    distances = bhattacharyya(models)
    return float(-(p @ np.log(np.exp(-distances) @ p)) / NATS_PER_BIT)


def entropy_bits(probabilities: Sequence[float]) -> float:
    """What is open, in bits."""
    p = np.array([x for x in probabilities if x > 0.0])
    p = p / p.sum()
    return float(-(p @ np.log(p)) / NATS_PER_BIT)


def bhattacharyya(models: Sequence[Foretold]) -> np.ndarray:
    """Bhattacharyya distances (m, m) of what the models foretell."""
    means, spreads = _reduced(models)
    eye = np.eye(means.shape[1])
    covariances = [eye + B @ B.T for B in spreads]
    sizes = [np.linalg.slogdet(S)[1] for S in covariances]
    distances = np.zeros((len(models), len(models)))
    for i in range(len(models)):
        for j in range(i):
            gap, S = means[i] - means[j], 0.5 * (covariances[i] + covariances[j])
            apart = float(gap @ cho_solve(cho_factor(S), gap))
            distance = 0.125 * apart + 0.5 * (np.linalg.slogdet(S)[1] - 0.5 * (sizes[i] + sizes[j]))
            distances[i, j] = distances[j, i] = max(distance, 0.0)
    return distances


def separation(one: Foretold, other: Foretold) -> float:
    """Squared distance of the means over the noise and over what is not known of both models."""
    (a, b), (A, B) = _reduced([one, other])
    S = np.eye(len(a)) + A @ A.T + B @ B.T
    return float((a - b) @ np.linalg.solve(S, a - b))


def _reduced(models: Sequence[Foretold]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Means (m, k) and spreads (k, q) in coordinates of all that differs among the models: elsewhere there is noise alone."""
    first = models[0].mean
    columns = np.column_stack([*(m.mean - first for m in models), *(m.spread for m in models)])
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    U = U[:, s > DIFFERING_SHARE * max(float(s.max(initial=0.0)), 1e-300)]
    return np.array([U.T @ (m.mean - first) for m in models]), [U.T @ m.spread for m in models]
