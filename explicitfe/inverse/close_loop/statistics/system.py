"""What the search needs to know of a test: measured series, a baseline, candidate effects, and what a model answers.

The statistics of this folder know nothing else, so the same search serves specimens under a tool, homogeneous states and the
sensors of a moving tongue.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Protocol

import numpy as np

from explicitfe.fem.effects.effect import Sought


@dataclass(frozen=True)
class Parameter:
    """A number that is fitted.

    Attributes
    ----------
    name : such as "C10_Pa" or "viscoelastic.tau_s".
    sought : its bounds and its coordinate, in its own unit.
    start : the value to begin with.
    group : the curves that it belongs to, or "" where all share it.
    """

    name: str
    sought: Sought
    start: float
    group: str = ""

    @property
    def low(self) -> float:
        """Lower bound of the coordinate."""
        return self.sought.coordinate(self.sought.low)

    @property
    def high(self) -> float:
        """Upper bound of the coordinate."""
        return self.sought.coordinate(self.sought.high)

    @property
    def typical(self) -> float:
        """How far the coordinate moves before the answer changes much: steps of derivatives are shares of it."""
        if self.sought.kind == "log":
            return 1.0
        lengths = [abs(self.sought.coordinate(v) - self.sought.coordinate(self.sought.none)) for v in self.sought.values]
        return min((length for length in lengths if length > 0.0), default=1.0)


@dataclass(frozen=True)
class Term:
    """One effect in a model, or one term of it, with its parameters."""

    effect: str
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Candidate:
    """A term that may be missing.

    Attributes
    ----------
    cause : the mechanism of which the effect is a form, such as "relaxation".
    trials : values of the parameters at which signatures are computed: each shape with a middle strength of each sign.
    reason : why these data cannot show it; "" if they may.
    slow : its runs take many times longer than others, so that it is fitted after them.
    """

    effect: str
    cause: str
    term: Term
    trials: tuple[tuple[float, ...], ...] = ()
    reason: str = ""
    slow: bool = False


@dataclass(frozen=True)
class Hypothesis:
    """A model: the baseline's constants and the terms that were added to it, each parameter with its coordinate.

    Attributes
    ----------
    base : parameters of the baseline.
    terms : in the order in which they were added.
    x : (p,) coordinates of the baseline's parameters, then of those of the terms.
    """

    base: tuple[Parameter, ...]
    terms: tuple[Term, ...]
    x: np.ndarray

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All of them, in the order of ``x``."""
        return (*self.base, *(parameter for term in self.terms for parameter in term.parameters))

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, each once."""
        return tuple(dict.fromkeys(term.effect for term in self.terms))

    @property
    def values(self) -> list[float]:
        """In the order of ``parameters``."""
        return [p.sought.value(float(x)) for p, x in zip(self.parameters, self.x, strict=True)]

    def at(self, x: np.ndarray | Sequence[float]) -> Hypothesis:
        """The same model with other parameters."""
        return Hypothesis(self.base, self.terms, np.asarray(x, dtype=float))

    def with_values_of(self, other: Hypothesis) -> Hypothesis:
        """The same model with the parameters that another one has too."""
        known = {(p.name, p.group): x for p, x in zip(other.parameters, other.x, strict=True)}
        return self.at([known.get((p.name, p.group), x) for p, x in zip(self.parameters, self.x, strict=True)])

    def plus(self, term: Term, values: Sequence[float]) -> Hypothesis:
        """The model with a further term, at values of its parameters."""
        more = [p.sought.coordinate(v) for p, v in zip(term.parameters, values, strict=True)]
        return Hypothesis(self.base, (*self.terms, term), np.concatenate([self.x, more]))

    def weakened(self, share: float) -> Hypothesis:
        """The model with a share of the strength of its last term."""
        place = len(self.x) - len(self.terms[-1].parameters)
        sought = self.parameters[place].sought
        none = sought.coordinate(sought.none)
        x = self.x.copy()
        x[place] = none + share * (x[place] - none)
        return self.at(x)

    def shifted(self, number: int, step: float) -> Hypothesis:
        """The model with one coordinate moved."""
        x = self.x.copy()
        x[number] += step
        return self.at(x)

    def of_terms(self) -> list[tuple[str, dict[str, float]]]:
        """The effect of each term, and its values by the names that the effect gives its parameters."""
        values = iter(self.values[len(self.base) :])
        return [(term.effect, {p.name.rpartition(".")[2]: next(values) for p in term.parameters}) for term in self.terms]


# Derivatives are taken over this share of a parameter's typical length: a larger one where roughness would drown a small one, and
# where answers come from Newton's method, which ends at a residual (error of derivatives at 1e-3: 5 to 28 %, at 1e-2: 1 to 5 %).
STEP_SHARE, NEWTON_STEP_SHARE, ROUGH_STEP_SHARE = 1e-3, 0.03, 0.04
# The typical length is no less than this share of the coordinate itself.
LEAST_TYPICAL_SHARE = 0.1


def steps_of(system: Answering, model: Hypothesis, *, rough: bool = False) -> list[float]:
    """Steps of the coordinates over which derivatives are taken, inside the bounds; ``rough`` for answers that are not smooth."""
    share = STEP_SHARE if system.exact(model) and not rough else ROUGH_STEP_SHARE
    share = NEWTON_STEP_SHARE if system.has_slopes(model) and not rough else share
    steps = [share * max(p.typical, LEAST_TYPICAL_SHARE * abs(x)) for p, x in zip(model.parameters, model.x, strict=True)]
    return [-step if x + step > p.high else step for p, x, step in zip(model.parameters, model.x, steps, strict=True)]


@dataclass(frozen=True, eq=False)
class Series:
    """One measured column.

    Attributes
    ----------
    id, curve : its own name, and that of the curve that it belongs to.
    test : the same for curves that are one test, such as its cycles; cross-validation leaves out whole tests.
    peers : the same for nominally equal tests; "" if there are none.
    specimen : what it was measured on; "" if the dataset does not say.
    constants : the group of constants that it depends on.
    measured : (k,) SI; ``time_s`` (k,).
    noise_sd : standard deviation of a row, SI; None is unknown.
    imposed_sd : (k,) what independent errors of the imposed rows add, SI.
    slope : (k,) change of the measured column by the imposed one, SI.
    bends : indices of the rows where the programme bends, first and last among them.
    scatter : stated relative scatter between nominally equal tests; None is unknown.
    trend : place in the order of repeats; 0 if there is none.
    phase : (k,) "loading", "hold" or "unloading" of each row.
    unit, factor : the unit of the measured column for people, and the factor from SI to it.
    """

    id: str
    curve: str
    test: str
    peers: str
    specimen: str
    constants: str
    measured: np.ndarray
    time_s: np.ndarray
    noise_sd: float | None
    imposed_sd: np.ndarray
    bends: np.ndarray
    scatter: float | None
    trend: float
    phase: np.ndarray
    unit: str
    factor: float
    slope: np.ndarray | float = 0.0


Answer = list[np.ndarray]


class Answering(Protocol):
    """What a fit needs to know: measured series, and what a model answers."""

    @property
    def series(self) -> Sequence[Series]:
        """The measured columns."""

    @property
    def base(self) -> tuple[Parameter, ...]:
        """Parameters of the baseline."""

    def exact(self, model: Hypothesis) -> bool:
        """Whether a model's answers are free of numerical roughness, so that small differences between them mean something."""

    def costly(self, model: Hypothesis) -> bool:
        """Whether an answer takes the run of a mesh, so that what decides nothing is left undone."""

    def has_slopes(self, model: Hypothesis) -> bool:
        """Whether an answer comes with those that derivatives need, so that these cost little."""

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """What each model predicts of the series, in SI at their rows; None where it cannot be computed."""


class System(Answering, Protocol):
    """A dataset with its forward model."""

    def start(self) -> Hypothesis:
        """The baseline, at constants to begin with."""

    def at(self, model: Hypothesis) -> System:
        """The same data with the forward model that is best near a model, such as with what a finer mesh changes there; itself
        where there is only one."""

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        """Terms that may be added to a model, or the reason why these data cannot show one."""

    def changes(self, model: Hypothesis, candidates: Sequence[Candidate]) -> list[list[np.ndarray | None]]:
        """Change (n,) SI of the prediction by each trial of each candidate; None where it cannot be computed."""

    def systematic(self) -> Mapping[str, np.ndarray]:
        """Name -> change (n,) SI of all rows by one standard deviation of an error that many rows share, such as that of the
        estimated loading protocol."""

    @property
    def fast_everywhere(self) -> bool:
        """Whether fast answers follow all effects so far that the simulator need only confirm the best hypotheses."""

    def has_sketch(self, effect: str) -> bool:
        """Whether :meth:`sketched` can answer with an effect."""

    def sketched(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """Fast answers, for differences between models where an answer is costly; None where there are none."""

    def checks(self, model: Hypothesis) -> dict[str, Answer]:
        """What other numerics answer, such as a finer mesh or smaller steps."""

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        """What the model answers with each assumed quantity larger by its likely error."""


@dataclass(frozen=True)
class Scales:
    """Sizes in a test, by name; the ranges of parameters are multiples of them."""

    values: Mapping[str, float] = field(default_factory=dict)

    def in_units(self, sought: Sought) -> Sought:
        """Values and bounds in the parameter's own unit."""
        by = self.values[sought.scale] if sought.scale else 1.0
        return replace(sought, values=tuple(by * v for v in sought.values), low=by * sought.low, high=by * sought.high)


def candidate(name: str, number: int, cause: str, sought: Mapping[str, Sought], scales: Scales) -> Candidate:
    """A candidate with the trials that its parameters ask for.

    Parameters
    ----------
    name, number : of the effect, and of this term of it, from 1.
    sought : parameter -> how it is looked for, the strength first.
    """
    in_units = {key: scales.in_units(entry) for key, entry in sought.items()}
    first, *shapes = in_units
    strength = in_units[first]
    none = strength.coordinate(strength.none)
    tried = []
    for sign in (-1.0, 1.0):
        side = [v for v in strength.values if sign * (strength.coordinate(v) - none) > 0.0]
        side.sort(key=lambda v: abs(strength.coordinate(v) - none))
        tried += side if strength.every else side[len(side) // 2 : len(side) // 2 + 1]
    trials = tuple((value, *shape) for shape in product(*(in_units[key].values for key in shapes)) for value in tried)
    head = name if number == 1 else f"{name}.{number}"
    parameters = tuple(Parameter(f"{head}.{key}", entry, entry.values[0]) for key, entry in in_units.items())
    return Candidate(name, cause, Term(name, parameters), trials)


def values_by_name(model: Hypothesis) -> dict[str, float]:
    """Name, with the group in brackets where there are several, -> value."""
    return dict(zip([p.name + (f"[{p.group}]" if p.group else "") for p in model.parameters], model.values, strict=True))
