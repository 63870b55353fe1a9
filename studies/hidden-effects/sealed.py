"""A sealed case: a dataset as a user brings it, and the truth that stays outside of its folder.

Both columns of a dataset carry noise, the measured one and the imposed one. The noise of the imposed column is added to the
reading of the loading protocol; the specimen follows the protocol itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from causes import causes_of

from studies.blind.case import Case

SMALLEST_IDENTIFIABLE_SD = 5.0  # distance of the true rows from the best elastic fit, and from every other single cause


@dataclass(frozen=True)
class Request:
    """What a case is to be.

    Attributes
    ----------
    family : program that makes the data: closed, press, glued, febio.
    kind : control, single, pair or outside.
    subjects : hidden effects, or the law outside the library; empty for a control.
    """

    family: str
    kind: str
    subjects: tuple[str, ...]


@dataclass(frozen=True)
class RowNoise:
    """Standard deviations of the rows, in the units of the dataset's columns.

    Attributes
    ----------
    measured, imposed : of the predicted column, and of the imposed one.
    stated : whether the dataset states them.
    """

    measured: float
    imposed: float
    stated: bool

    def add(self, rng: np.random.Generator, imposed: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both columns (k,) with noise."""
        return (
            imposed + self.imposed * rng.standard_normal(len(imposed)),
            measured + self.measured * rng.standard_normal(len(measured)),
        )


@dataclass(frozen=True)
class Distance:
    """How far the true rows stay from simpler models, in standard deviations of the noise (root of the decrease of chi2).

    Attributes
    ----------
    elastic : from the best elastic fit.
    rivals : from the best fit of each other single cause.
    """

    elastic: float
    rivals: Mapping[str, float]

    @property
    def nearest(self) -> tuple[str | None, float]:
        """The nearest other cause, and the distance from it; the elastic distance where there is no other cause."""
        if not self.rivals:
            return None, self.elastic
        name = min(self.rivals, key=self.rivals.__getitem__)
        return name, self.rivals[name]

    @property
    def identifiable(self) -> bool:
        """Whether noise cannot hide the effect, and no other single cause stands for it."""
        return min(self.elastic, self.nearest[1]) >= SMALLEST_IDENTIFIABLE_SD


@dataclass(frozen=True)
class Sealed:
    """A dataset with its truth."""

    case: Case
    truth: dict[str, Any]


def truth_of(
    request: Request,
    *,
    setting: str,
    effects: Mapping[str, Mapping[str, Any]],
    accepts: Iterable[str],
    constants: tuple[float, float],
    noise: RowNoise,
    distance: Distance | None,
    protocol: str,
    rows: int,
) -> dict[str, Any]:
    """The entry of a case in ``truth.json``.

    Parameters
    ----------
    setting : "homogeneous" or "tool".
    effects : what is hidden, with its parameters.
    accepts : for a law outside the library, the causes that describe it well enough to count as right.
    constants : true C10 and C20 [Pa] of a sudden load.
    distance : None for a control.
    rows : number of measured rows.
    """
    outside = request.kind == "outside"
    near = (None, None) if distance is None else distance.nearest
    return {
        "family": request.family,
        "setting": setting,
        "kind": request.kind,
        "hidden": list(effects) if effects else "nothing",
        "causes": [] if outside else sorted(causes_of(effects)),
        "accepts": sorted(set(accepts)),
        "parameters": {name: dict(values) for name, values in effects.items()},
        "C10_Pa": constants[0],
        "C20_Pa": constants[1],
        "noise_rows": [noise.measured, noise.imposed],
        "noise_stated": noise.stated,
        "protocol": protocol,
        "rows": rows,
        "identifiable": None if distance is None else distance.identifiable,
        "distance_elastic_sd": None if distance is None else round(distance.elastic, 2),
        "distance_nearest_sd": None if near[1] is None else round(near[1], 2),
        "nearest_cause": near[0],
    }
