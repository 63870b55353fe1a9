"""What the loop needs to know of a test: measured series, a baseline, candidate effects, and what a model answers.

The statistics of this folder know nothing else, so the same loop serves specimens under a tool, homogeneous states and the
sensors of a moving tongue.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Protocol

import numpy as np

from explicitfe.effects.effect import Sought


@dataclass(frozen=True)
class Parameter:
    """A number that is fitted.

    Attributes
    ----------
    name : such as "C10_Pa" or "viscoelastic.tau_s".
    group : of constants, or "" where there is one only.
    sought : bounds and coordinate; the scale is counted in already.
    start : value to begin with.
    """

    name: str
    sought: Sought
    start: float
    group: str = ""

    @property
    def low(self) -> float:
        """Bound of the coordinate."""
        return self.sought.coordinate(self.sought.low)

    @property
    def high(self) -> float:
        """Bound of the coordinate."""
        return self.sought.coordinate(self.sought.high)

    @property
    def typical(self) -> float:
        """How far the coordinate moves before the answer changes much: steps of derivatives are shares of it."""
        if self.sought.kind == "log":
            return 1.0
        ways = [abs(self.sought.coordinate(v) - self.sought.coordinate(self.sought.none)) for v in self.sought.values]
        return min((way for way in ways if way > 0.0), default=1.0)


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
    trials : values of the parameters that are tried, without a fit; in one row the same shape and sign, strengths increasing.
    reason : why these data cannot show it; "" if they may.
    reference : values without the effect, one a row of trials, where that is computed in another way than the model itself
        (on a mesh, where the model is a homogeneous state): secants are taken from there.
    """

    effect: str
    term: Term
    trials: tuple[tuple[tuple[float, ...], ...], ...] = ()
    reason: str = ""
    reference: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class Hypothesis:
    """A model: the baseline's constants and the terms added to it, each parameter with its coordinate.

    Attributes
    ----------
    base : parameters of the baseline.
    terms : added, in order.
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

    def at(self, x: np.ndarray) -> Hypothesis:
        """The same model with other parameters."""
        return Hypothesis(self.base, self.terms, np.asarray(x, dtype=float))

    def plus(self, term: Term, values: Sequence[float]) -> Hypothesis:
        """The model with one term more, at values of its parameters."""
        more = [p.sought.coordinate(v) for p, v in zip(term.parameters, values, strict=True)]
        return Hypothesis(self.base, (*self.terms, term), np.concatenate([self.x, more]))

    def of_terms(self) -> list[tuple[str, dict[str, float]]]:
        """Effect and values of each term, by the names that the effect gives its parameters."""
        values = iter(self.values[len(self.base) :])
        return [(term.effect, {p.name.rpartition(".")[2]: next(values) for p in term.parameters}) for term in self.terms]


@dataclass(frozen=True, eq=False)
class Series:
    """One measured column.

    Attributes
    ----------
    id : its own name; ``curve`` that of the curve it belongs to, which is left out as a whole in cross-validation.
    test : curves that are one test (cycles) share it; ``peers`` is the same for nominally equal tests, "" if there are none.
    specimen : group that it was measured on; "" if the dataset does not say.
    constants : group of constants that it depends on.
    measured : (k,) SI; ``time_s`` (k,).
    noise_sd : of a row, SI; None is unknown.
    imposed_sd : (k,) what the noise of the imposed column adds, SI.
    bends : indices of the rows where the programme bends, first and last among them.
    scatter : stated relative scatter between nominally equal tests; None is unknown.
    trend : place in the order of repeats; 0 if there is none.
    phase : (k,) "loading", "hold" or "unloading" of each row.
    unit, factor : of the measured column for people, and from SI to it.
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


Answer = list[np.ndarray]


class System(Protocol):
    """A dataset with its forward model."""

    series: Sequence[Series]
    base: tuple[Parameter, ...]

    def start(self) -> Hypothesis:
        """The baseline, at constants to begin with."""

    def exact(self, model: Hypothesis) -> bool:
        """Whether a model's answers are free of numerical roughness, so that small differences of them mean something."""

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        """What may be missing in a model."""

    def sketch(self, model: Hypothesis) -> Hypothesis:
        """A simpler model, in which candidates with a reference are tried."""

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        """What each model predicts of the series, in SI at their rows; None where it cannot be computed."""

    def checks(self, model: Hypothesis) -> dict[str, Answer]:
        """What is computed in other ways: a finer mesh, finer increments."""

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        """What is computed with each assumed quantity larger by its likely error."""


@dataclass(frozen=True)
class Scales:
    """Sizes in a test, of which the ranges of parameters are multiples; 1 stands for "no scale"."""

    values: Mapping[str, float] = field(default_factory=dict)

    def scaled(self, sought: Sought) -> Sought:
        """Values and bounds in the parameter's own unit."""
        by = self.values[sought.scale] if sought.scale else 1.0
        return Sought(
            tuple(by * v for v in sought.values), by * sought.low, by * sought.high, sought.scale, sought.kind, sought.none
        )


def candidate(name: str, number: int, sought: Mapping[str, Sought], scales: Scales) -> Candidate:
    """A candidate with the trials that its parameters ask for.

    Parameters
    ----------
    name, number : of the effect, and of this term of it, from 1.
    sought : parameter -> how it is looked for, the strength first.
    """
    scaled = {key: scales.scaled(entry) for key, entry in sought.items()}
    strength, *shapes = scaled
    found = scaled[strength]
    ways: list[list[float]] = []
    for side in (-1.0, 1.0):
        way = [v for v in found.values if side * (found.coordinate(v) - found.coordinate(found.none)) > 0.0]
        if way:
            ways.append(sorted(way, key=lambda v: abs(found.coordinate(v) - found.coordinate(found.none))))
    trials = tuple(
        tuple((value, *shape) for value in way) for shape in product(*(scaled[key].values for key in shapes)) for way in ways
    )
    head = name if number == 1 else f"{name}.{number}"
    parameters = tuple(Parameter(f"{head}.{key}", entry, entry.values[0]) for key, entry in scaled.items())
    return Candidate(name, Term(name, parameters), trials)


def described(model: Hypothesis) -> dict[str, Any]:
    """Name -> value, for reports; of the baseline by group."""
    return dict(zip([p.name + (f"[{p.group}]" if p.group else "") for p in model.parameters], model.values, strict=True))
