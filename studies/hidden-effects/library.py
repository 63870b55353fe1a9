"""The only file of the rivals that knows the project: the elastic fit of a dataset, and the response columns of all effects.

A response column is the secant of an effect at a trial value of its parameters: the change of the answer of the fitted elastic
model, whitened by the noise of the rows. All rivals select from the same columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from causes import cause_of

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.specimens.features import features_of
from explicitfe.inverse.close_loop.specimens.scales import scales_of
from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.inverse.close_loop.specimens.specimens import CORRECTED, Specimens
from explicitfe.inverse.close_loop.split import split
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, stack
from explicitfe.inverse.close_loop.statistics.noise import row_noise, scatter
from explicitfe.inverse.close_loop.statistics.refit import BestFit, refit
from explicitfe.inverse.close_loop.statistics.system import Candidate, Hypothesis, candidate
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import RunError

SMALLEST_COLUMN_SD = 1e-3  # a column whose norm outside of the constants is smaller is no response


@dataclass(frozen=True)
class Column:
    """What a response column stands for: an effect and the trial values of its parameters."""

    effect: str
    values: tuple[float, ...]

    @property
    def cause(self) -> str:
        return cause_of(self.effect)


@dataclass(frozen=True, eq=False)
class Library:
    """A dataset as a linear regression.

    Attributes
    ----------
    y (n,) : measured rows less the elastic fit, whitened.
    constants (n, p) : derivatives by C10 and C20, whitened; every model contains them.
    X (n, m) : response columns, whitened.
    columns : what they stand for.
    test (n,) : number of the test that a row belongs to.
    """

    y: np.ndarray
    constants: np.ndarray
    X: np.ndarray
    columns: list[Column]
    test: np.ndarray


class Data:
    """A dataset with its elastic fit; close it, or use it in a ``with`` statement.

    Raises
    ------
    InputError, RunError : the dataset cannot be read, or the elastic model cannot be computed.
    """

    def __init__(self, path: Path, processes: int = 1) -> None:
        dataset = read_dataset(path)
        self._simulator = Simulator(processes)
        system = Specimens(dataset, split(dataset).fit, self._simulator, CORRECTED)
        rows = row_noise(system.series)
        self.covariance = Covariance(system.series, rows, scatter(system.series, rows))
        first = refit(system, system.start(), self.covariance)
        self.system = system.at(first.model)
        self.elastic = first if self.system is system else refit(self.system, first.model, self.covariance)

    def __enter__(self) -> Data:
        return self

    def __exit__(self, *_: object) -> None:
        self._simulator.workers.close()

    def candidates(self) -> list[Candidate]:
        """Effects that these data may show, with their trial values; on a mesh only those that need no history."""
        system = self.system
        C10, C20 = (float(np.mean(self.elastic.model.values[k::2])) for k in (0, 1))
        scales = scales_of(system.curves, C10, C20)
        features = features_of(system.curves, system.series)
        tool = system.curves[0].tool is not None
        found = []
        for name, effect in EFFECTS.items():
            costly = not system.homogeneous and (
                effect.needs_half_body or (effect.depends_on_path and effect.acts_on != "reading")
            )
            point = system.homogeneous and not effect.pointwise
            if effect.searched and not effect.extends and set(effect.requires) <= features and not costly and not point:
                found.append(candidate(name, 1, cause_of(name), effect.sought_in(tool=tool), scales))
        return found

    def library(self) -> Library:
        """All response columns."""
        models: list[Hypothesis] = []
        columns: list[Column] = []
        for one in self.candidates():
            for values in one.trials:
                models.append(self.elastic.model.plus(one.term, values))
                columns.append(Column(one.effect, values))
        answers = self.system.answers(models)
        white = self.covariance.whiten
        X, kept = [], []
        basis, _ = np.linalg.qr(self.elastic.jacobian)
        for column, answer in zip(columns, answers, strict=True):
            if answer is None:
                continue
            x = white(stack(answer) - self.elastic.answer)
            if np.isfinite(x).all() and np.linalg.norm(x - basis @ (basis.T @ x)) > SMALLEST_COLUMN_SD:
                X.append(x)
                kept.append(column)
        names = list(dict.fromkeys(one.test for one in self.system.series))
        test = np.concatenate([np.full(len(one.measured), names.index(one.test)) for one in self.system.series])
        count = len(self.elastic.residual)
        return Library(self.elastic.residual, self.elastic.jacobian, np.array(X).reshape(-1, count).T, kept, test)

    def fitted(self, start: BestFit, column: Column) -> BestFit | None:
        """The best fit of a model with one effect more, from the trial of a column; None where it cannot be computed."""
        term = next(one.term for one in self.candidates() if one.effect == column.effect)
        try:
            return refit(self.system, start.model.plus(term, column.values), self.covariance)
        except RunError:
            return None
