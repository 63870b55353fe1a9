"""A dataset that is made of given columns: a linear ``System`` of the statistics, answered in microseconds.

Answers are X x + sum of strength * column(shape), so that fits, intervals and chances have closed forms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.compared import ComparedCauses
from explicitfe.inverse.close_loop.comparison import compare
from explicitfe.inverse.close_loop.statistics.budget import Budget
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, stack
from explicitfe.inverse.close_loop.statistics.noise import RowNoise, Scatter
from explicitfe.inverse.close_loop.statistics.system import Answer, Candidate, Hypothesis, Parameter, Scales, Series, candidate
from explicitfe.inverse.close_loop.verdict import Outcome, conclude

ROWS = 40
WIDE = 1e6  # bound of a parameter that shall never meet it
BOTH_WAYS = Sought((-1.0, -0.1, 0.1, 1.0), -100.0, 100.0)
UPWARD = Sought((0.1, 0.3, 1.0), 0.0, 100.0)


@dataclass(frozen=True)
class Planted:
    """An effect of the system: its answer is strength * column(shape), of all rows; its cause is its own name if left out."""

    column: Callable[..., np.ndarray]
    sought: Mapping[str, Sought] = field(default_factory=lambda: {"size": BOTH_WAYS})
    reason: str = ""
    cause: str = ""


@dataclass(eq=False)
class Linear:
    """The system.

    Attributes
    ----------
    series : with what was measured.
    X : (n, p), answers of the baseline by its parameters.
    effects : name -> effect.
    bounds : of the baseline's parameters; wide if left out.
    fails : models that cannot be computed.
    checked, assumed : name -> change (n,) of the answer by other numerics, by an assumption.
    shared : name -> change (n,) of all rows by an error that they share.
    """

    series: Sequence[Series]
    X: np.ndarray
    effects: Mapping[str, Planted] = field(default_factory=dict)
    bounds: Sequence[tuple[float, float]] | None = None
    fails: Callable[[Hypothesis], bool] = lambda model: False
    checked: Mapping[str, np.ndarray] = field(default_factory=dict)
    assumed: Mapping[str, np.ndarray] = field(default_factory=dict)
    shared: Mapping[str, np.ndarray] = field(default_factory=dict)
    smooth: bool = True
    fast_everywhere: ClassVar[bool] = False

    def __post_init__(self) -> None:
        limits = self.bounds or [(-WIDE, WIDE)] * self.X.shape[1]
        self.base = tuple(Parameter(f"x{k}", Sought((1.0,), *limit), 0.0) for k, limit in enumerate(limits))

    def exact(self, model: Hypothesis) -> bool:
        return self.smooth

    def has_slopes(self, model: Hypothesis) -> bool:
        return False

    def costly(self, model: Hypothesis) -> bool:
        return not self.smooth

    def start(self) -> Hypothesis:
        return Hypothesis(self.base, (), np.clip(np.zeros(len(self.base)), *np.array([(p.low, p.high) for p in self.base]).T))

    def candidates(self, model: Hypothesis) -> list[Candidate]:
        candidates = []
        for name, planted in self.effects.items():
            if name not in model.effects:
                own = candidate(name, 1, planted.cause or name, planted.sought, Scales())
                candidates.append(replace(own, trials=(), reason=planted.reason) if planted.reason else own)
        return candidates

    def changes(self, model: Hypothesis, candidates: Sequence[Candidate]) -> list[list[np.ndarray | None]]:
        now = self.rows(model)
        answers = [self.answers([model.plus(one.term, values) for values in one.trials]) for one in candidates]
        return [[None if answer is None else stack(answer) - now for answer in row] for row in answers]

    def systematic(self) -> Mapping[str, np.ndarray]:
        return self.shared

    def at(self, model: Hypothesis) -> Linear:
        return self

    def rows(self, model: Hypothesis) -> np.ndarray:
        """The answer (n,)."""
        answer = self.X @ model.x[: len(self.base)]
        for name, values in model.of_terms():
            strength, *shape = values.values()
            answer = answer + strength * self.effects[name].column(*shape)
        return answer

    def split(self, rows: np.ndarray) -> Answer:
        """One array a series."""
        return np.split(rows, np.cumsum([len(one.measured) for one in self.series])[:-1])

    def answers(self, models: Sequence[Hypothesis]) -> list[Answer | None]:
        return [None if self.fails(model) else self.split(self.rows(model)) for model in models]

    def checks(self, model: Hypothesis) -> dict[str, Answer]:
        return {name: self.split(self.rows(model) + d) for name, d in self.checked.items()}

    def assumptions(self, model: Hypothesis) -> dict[str, Answer]:
        return {name: self.split(self.rows(model) + d) for name, d in self.assumed.items()}

    def measuring(self, rows: np.ndarray) -> Linear:
        """The same system where something else was measured."""
        series = [replace(one, measured=y) for one, y in zip(self.series, self.split(rows), strict=True)]
        return replace(self, series=series)


def ramp(number: int, measured: np.ndarray, *, sd: float | None, **more) -> Series:
    """A test of its own, of one way in that takes one second."""
    count = len(measured)
    summary_of = {
        "id": f"test-{number}",
        "curve": f"test-{number}",
        "test": f"test-{number}",
        "peers": "",
        "specimen": "",
        "constants": "all",
        "measured": measured,
        "time_s": np.linspace(0.0, 1.0, count),
        "noise_sd": sd,
        "imposed_sd": np.zeros(count),
        "bends": np.array([0, count - 1]),
        "scatter": None,
        "trend": 0.0,
        "phase": np.full(count, "loading"),
        "unit": "N",
        "factor": 1.0,
    }
    return Series(**summary_of | more)


def autoregressive(rng: np.random.Generator, count: int, correlation: float = 0.0) -> np.ndarray:
    """AR(1) rows of unit variance."""
    rows = rng.standard_normal(count)
    for k in range(1, count):
        rows[k] = correlation * rows[k - 1] + np.sqrt(1.0 - correlation**2) * rows[k]
    return rows


def programme(tests: int, rows: int = ROWS) -> np.ndarray:
    """The way (n,) of several equal tests, from 0 to 1."""
    return np.tile(np.linspace(0.0, 1.0, rows), tests)


def split_up(measured: np.ndarray, tests: int, sd: float | None, **more) -> list[Series]:
    """Rows of several equal tests as series."""
    return [ramp(number, part, sd=sd, **more) for number, part in enumerate(np.split(measured, tests))]


def elastic(
    rng: np.random.Generator,
    *,
    tests: int = 3,
    rows: int = ROWS,
    sd: float = 0.01,
    stated: bool = True,
    correlation: float = 0.0,
    hidden: Mapping[str, float] | None = None,
    effects: Mapping[str, Planted] | None = None,
    extra: np.ndarray | None = None,
    **more,
) -> Linear:
    """Several tests of F = 2 d + d^3 with noise, in which effects are ``hidden``: name -> strength; ``extra`` is added."""
    d = programme(tests, rows)
    X = np.column_stack([d, d**3])
    truth = X @ [2.0, 1.0] + (0.0 if extra is None else extra)
    for name, strength in (hidden or {}).items():
        truth = truth + strength * effects[name].column()
    noise = np.concatenate([autoregressive(rng, rows, correlation) for _ in range(tests)])
    return Linear(split_up(truth + sd * noise, tests, sd if stated else None), X, effects or {}, **more)


def white(system: Linear, sd: float = 0.01) -> Covariance:
    """The covariance of noise of known sd, independent from row to row."""
    rows = [RowNoise(np.full(len(one.measured), sd), 0.0, True) for one in system.series]
    return Covariance(system.series, rows, Scatter(0.0, 0.0, "unknown", 0))


def compared(
    system: Linear, max_effects: int = 2, sd: float | None = None, simulations: int | None = None
) -> tuple[ComparedCauses, Outcome]:
    """The comparison and its outcome; with noise of known sd if one is given, which is estimated or stated elsewhere."""
    rows = None if sd is None else white(system, sd).rows
    comparison = compare(system, max_effects=max_effects, rows=rows, limit=Budget(simulations))
    return comparison, conclude(comparison)
