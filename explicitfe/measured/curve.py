"""Measured curves in SI, and the datasets they make up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np

from explicitfe.errors import InputError, nearest, shortened
from explicitfe.measured.rig import RigLimits
from explicitfe.measured.tables import (
    IDENTITY_CONDITIONS,
    PROGRAMME_CONDITIONS,
    Conditions,
    ConditionValue,
    MeasuredNoise,
    MeasuredSpecimen,
    MeasuredTool,
    RegistrationTable,
    Split,
    TestKind,
)

Kind = Literal["force-displacement", "uniaxial", "shear", "trajectory"]
TIME = "time_s"

# Column of the file -> name and factor in SI.
COLUMNS: dict[Kind, dict[str, tuple[str, float]]] = {
    "force-displacement": {"displacement_mm": ("displacement_m", 1e-3), "force_N": ("force_N", 1.0)},
    "uniaxial": {"stretch": ("stretch", 1.0), "nominal_stress_Pa": ("nominal_stress_Pa", 1.0)},
    "shear": {"shear_strain": ("shear_strain", 1.0), "shear_stress_Pa": ("shear_stress_Pa", 1.0)},
}
# Kind of curve -> key of [noise] that it can have -> the column that is noisy.
NOISE: dict[Kind, dict[str, str]] = {
    "force-displacement": {"force_sd_N": "force_N", "displacement_sd_mm": "displacement_mm"},
    "uniaxial": {"stress_sd_Pa": "nominal_stress_Pa", "stretch_sd": "stretch"},
    "shear": {"stress_sd_Pa": "shear_stress_Pa", "stretch_sd": "shear_strain"},
    "trajectory": {"displacement_sd_mm": "the coordinates"},
}
# Column in SI -> unit in which it is printed, and factor.
PRINTED_UNITS = {
    "displacement_m": ("mm", 1e3),
    "force_N": ("N", 1.0),
    "nominal_stress_Pa": ("Pa", 1.0),
    "shear_stress_Pa": ("Pa", 1.0),
}

# Two digitisations of one curve read its rates and peaks off a picture: they agree within this share.
_SAME_PROGRAMME_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Curve:
    """One measured curve, in SI.

    Parameters
    ----------
    id, file, constants, group, split, conditions : as in the file; split is None where the program chooses.
    kind : what the columns are.
    specimen, tool, noise : the dataset's tables with the curve's own laid over them; tool is None for a homogeneous state,
        specimen too for a trajectory.
    time_s (k,) : 0 in the first row, strictly increasing [s].
    columns : name in SI -> (k,), see :data:`COLUMNS`; empty for a trajectory.
    sensors : name -> positions (k, 3) [m]; a trajectory only.
    """

    id: str
    file: str
    kind: Kind
    constants: str
    group: str
    split: Split | None
    specimen: MeasuredSpecimen | None
    tool: MeasuredTool | None
    noise: MeasuredNoise
    conditions: Conditions
    time_s: np.ndarray
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    sensors: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def defect(self) -> str | None:
        """What is wrong with the curve, in words; None if nothing is known."""
        defect = self.conditions.get("defect")
        return None if defect is None else str(defect)

    def number(self, condition: str) -> float | None:
        """A condition that is a number; None where the curve has none, or has a word there."""
        value = self.conditions.get(condition)
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None

    @property
    def imposed(self) -> str:
        """Name of the column that the test imposed; a trajectory has none."""
        return self._driven()[0]

    @property
    def predicted(self) -> str:
        """Name of the column that a model has to predict; a trajectory has none."""
        return self._driven()[1]

    @property
    def displacement_m(self) -> np.ndarray:
        """Of the tool, positive into the tissue (k,) [m]."""
        return self.columns["displacement_m"]

    @property
    def force_N(self) -> np.ndarray:
        """On the tool, positive in compression (k,) [N]."""
        return self.columns["force_N"]

    @property
    def stretch(self) -> np.ndarray:
        """Length over length at rest (k,)."""
        return self.columns["stretch"]

    @property
    def nominal_stress_Pa(self) -> np.ndarray:
        """First Piola stress, tension positive (k,) [Pa]."""
        return self.columns["nominal_stress_Pa"]

    @property
    def shear_strain(self) -> np.ndarray:
        """Amount of simple shear (k,)."""
        return self.columns["shear_strain"]

    @property
    def shear_stress_Pa(self) -> np.ndarray:
        """Shear stress (k,) [Pa]."""
        return self.columns["shear_stress_Pa"]

    def _driven(self) -> tuple[str, str]:
        first, second = self.columns
        return (second, first) if self.tool is not None and self.tool.control == "force" else (first, second)


@dataclass(frozen=True, eq=False)
class Dataset:
    """Curves of one test.

    Parameters
    ----------
    path : the dataset.toml.
    scenario, sensors, registration : of a trajectory; sensors maps a sensor to the model's named point. Without a scenario
        there is nothing to compare with.
    rig : what the machine can do, where the dataset says it.
    """

    name: str
    title: str
    test: TestKind
    source: str
    license: str
    notes: str
    path: Path
    curves: tuple[Curve, ...]
    scenario: Path | None = None
    sensors: dict[str, str] = field(default_factory=dict)
    registration: RegistrationTable | None = None
    rig: RigLimits | None = None

    def constants_groups(self) -> dict[str, tuple[Curve, ...]]:
        """Name of the constants -> the curves that share them, in the order of the file."""
        groups: dict[str, tuple[Curve, ...]] = {}
        for curve in self.curves:
            groups[curve.constants] = (*groups.get(curve.constants, ()), curve)
        return groups

    def regrouped(self, key: str) -> Dataset:
        """The same curves with their constants shared by ``group`` or by a key of their conditions.

        Raises
        ------
        InputError : a curve has no such condition, or a held-out curve is left without a fit curve.
        """
        common = set.intersection(*(set(curve.conditions) for curve in self.curves)) | {"group"}
        if key not in common:
            lacking = next(curve.id for curve in self.curves if key not in curve.conditions)
            raise InputError(
                f'{self.path}: the constants cannot be grouped by "{shortened(key)}": curve "{lacking}" has no such condition; '
                f"{nearest(key, common)}"
            )
        names = [curve.group if key == "group" else _name_of(curve.conditions[key]) for curve in self.curves]
        curves = tuple(replace(curve, constants=name) for curve, name in zip(self.curves, names, strict=True))
        check_constants(curves, str(self.path))
        return replace(self, curves=curves)


def same_measurement(one: Curve, other: Curve) -> bool:
    """Whether two curves differ in ``digitisation`` only, so that they must stand on one side of a split.

    The programme's numbers may differ by 5 %, for they are digitised too; a group that was left out says nothing.
    """
    if one.conditions.get("digitisation") == other.conditions.get("digitisation"):
        return False
    if one.group != other.group and one.group != one.id and other.group != other.id:
        return False
    if (one.specimen, one.tool, one.constants) != (other.specimen, other.tool, other.constants):
        return False
    if any(one.conditions.get(key) != other.conditions.get(key) for key in IDENTITY_CONDITIONS):
        return False
    for key in PROGRAMME_CONDITIONS:
        a, b = one.number(key), other.number(key)
        if a is None or b is None:
            if a is not b:
                return False
        elif not math.isclose(a, b, rel_tol=_SAME_PROGRAMME_SHARE):
            return False
    return True


def check_constants(curves: Sequence[Curve], path: str) -> None:
    """Raise InputError where a held-out curve has constants that no fit curve shares."""
    fitted = {curve.constants for curve in curves if curve.split != "holdout"}
    for curve in curves:
        if curve.constants not in fitted:
            raise InputError(
                f'{path}: curve "{curve.id}" is held out, and no fit curve shares its constants "{curve.constants}"; '
                f'give one of them split = "fit", or let the curves share their constants.'
            )


def check_sides(curves: Sequence[Curve], path: str) -> None:
    """Raise InputError where one measurement stands on both sides of the split."""
    for one, other in combinations(curves, 2):
        if {one.split, other.split} == {"fit", "holdout"} and same_measurement(one, other):
            raise InputError(
                f'{path}: curves "{one.id}" and "{other.id}" are digitisations of one measurement and stand on two sides of '
                f"the split; give both the same split."
            )


def _name_of(value: ConditionValue) -> str:
    """A condition as a name: true for True, "a, b" for an array."""
    if isinstance(value, bool):
        return str(value).lower()
    return ", ".join(map(_name_of, value)) if isinstance(value, list) else str(value)


def programme_of(curve: Curve) -> np.ndarray:
    """What the test imposed over time: that column (k,) in SI."""
    return curve.columns[curve.imposed]


def sd_of(curve: Curve, column: str) -> float | None:
    """Standard deviation of the noise of a column, in SI; None where it is unknown."""
    for key, of in NOISE[curve.kind].items():
        name, factor = COLUMNS[curve.kind][of]
        value = getattr(curve.noise, key)
        if name == column and value is not None:
            return float(value * factor)
    return None
