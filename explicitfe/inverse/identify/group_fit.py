"""The fit of one group of constants, with everything that its numbers, warnings and pictures are made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from explicitfe.inverse.identify.assumptions import Hidden
from explicitfe.inverse.identify.compare_laws import LawFit, RangeTest
from explicitfe.inverse.identify.fit import Fit
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.identify.paper import PaperFit
from explicitfe.inverse.measured.curve import PRINTED_UNITS
from explicitfe.inverse.measured.select import Group


@dataclass(frozen=True)
class GroupFit:
    """A group and its fit.

    Attributes
    ----------
    observed, predicted : rows of the fitted curves, and of those that are only predicted.
    fit : by least squares; with the paper's method too, for the noise.
    interpolation_error : deviation of the interpolated response from the last run of the simulator, relative to the force.
    laws : all laws that were compared, the one of ``fit`` among them.
    range_test : the same law fitted to the lower half of the range.
    paper, loads_N, measured_m : the paper's method, if it was chosen: its fit, loads (k,) and measured displacements (k,).
    hidden : sensitivity to the assumptions.
    """

    group: Group
    observed: Sequence[Observed]
    predicted: Sequence[Observed]
    fit: Fit
    interpolation_error: float
    laws: Sequence[LawFit] = ()
    range_test: RangeTest | None = None
    paper: PaperFit | None = None
    loads_N: np.ndarray = field(default_factory=lambda: np.zeros(0))
    measured_m: np.ndarray = field(default_factory=lambda: np.zeros(0))
    hidden: Sequence[Hidden] = ()

    @property
    def constants(self) -> np.ndarray:
        """Constants (p,) of the law by the chosen method."""
        return self.fit.constants if self.paper is None else self.paper.constants

    @property
    def own(self) -> LawFit:
        """The fitted law in the comparison."""
        return next(row for row in self.laws if row.law.name == self.fit.law.name)

    @property
    def preferred(self) -> LawFit:
        """The law with the lowest AICc."""
        return min(self.laws, key=lambda row: row.aicc)

    @property
    def of_unit(self) -> list[int]:
        """Numbers of the fitted curves whose predicted column has this unit."""
        return [number for number, curve in enumerate(self.group.fitted) if PRINTED_UNITS[curve.predicted][0] == self.unit]

    @property
    def unit(self) -> str:
        """Unit in which the predicted column of the first curve is printed."""
        return PRINTED_UNITS[self.group.fitted[0].predicted][0]

    @property
    def scale(self) -> float:
        """From SI to that unit."""
        return PRINTED_UNITS[self.group.fitted[0].predicted][1]

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Constants that ended at a bound."""
        if self.paper is None:
            return self.fit.at_bound
        return ("C20_Pa",) if self.paper.status == "bound" else ()

    @property
    def chi2(self) -> float | None:
        """Weighted sum of squares; None if the noise was estimated from the residual, and for the paper's method."""
        return self.fit.chi2 if self.paper is None and not self.fit.noise_estimated else None

    @property
    def noise_sd(self) -> float:
        """Rms noise of the rows, in the unit."""
        return self.scale * root_mean_square(np.concatenate([self.fit.sds[number] for number in self.of_unit]))

    @property
    def numerical_sd(self) -> float:
        """Rms numerical noise of the predictions, in the unit."""
        parts = []
        for o in (self.observed[number] for number in self.of_unit):
            o = o.at_contact(o.contact(self.constants))
            value, slope = o.model.with_slope(o.imposed, *map(float, self.constants))
            # The roughness of a response is relative to its forces.
            deviation = np.abs(o.imposed * slope) if o.model.by_force else np.abs(value)
            parts.append(o.model.response.roughness * deviation)
        return self.scale * root_mean_square(np.concatenate(parts))


def root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
