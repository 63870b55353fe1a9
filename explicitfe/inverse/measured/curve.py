"""Measured curves in SI, and datasets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np

from explicitfe.inverse.measured.tables import (
    IDENTITY_CONDITIONS,
    PROGRAMME_CONDITIONS,
    Conditions,
    ConditionValue,
    MeasuredNoise,
    MeasuredSpecimen,
    MeasuredTool,
    RegistrationTable,
    RigLimits,
    Split,
    TestKind,
)
from explicitfe.platform.errors import InputError, nearest, shortened

Kind = Literal["force-displacement", "uniaxial", "equibiaxial", "planar", "shear", "trajectory"]
TIME = "time_s"

_STRETCHED = {"stretch": ("stretch", 1.0), "nominal_stress_Pa": ("nominal_stress_Pa", 1.0)}
_STRETCH_NOISE = {"stress_sd_Pa": "nominal_stress_Pa", "stretch_sd": "stretch"}
# Column of the file -> name and factor in SI.
COLUMNS: dict[Kind, dict[str, tuple[str, float]]] = {
    "force-displacement": {"displacement_mm": ("displacement_m", 1e-3), "force_N": ("force_N", 1.0)},
    "uniaxial": _STRETCHED,
    "equibiaxial": _STRETCHED,
    "planar": _STRETCHED,
    "shear": {"shear_strain": ("shear_strain", 1.0), "shear_stress_Pa": ("shear_stress_Pa", 1.0)},
}
# Kind of curve -> possible keys of [noise] -> the noisy column.
NOISE: dict[Kind, dict[str, str]] = {
    "force-displacement": {"force_sd_N": "force_N", "displacement_sd_mm": "displacement_mm"},
    "uniaxial": _STRETCH_NOISE,
    "equibiaxial": _STRETCH_NOISE,
    "planar": _STRETCH_NOISE,
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

# Two digitisations of one curve agree in rates and peaks within this share.
_SAME_PROGRAMME_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Sensor:
    """Where a sensor sits on the model.

    Attributes
    ----------
    point : named point of the model; "" for a marker.
    at_m : (3,) position of the centre of a marker at rest, in the frame of the model, m; None for a named point.
    fixed : whether it sits on what holds the body, and so does not move.
    place_sd_m : likely error of ``at_m`` along each axis, m.
    """

    point: str = ""
    at_m: np.ndarray | None = None
    fixed: bool = False
    place_sd_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Curve:
    """One measured curve, in SI.

    Parameters
    ----------
    id, file, constants, group, split, conditions : as in the file; split is None if it is chosen by the rule.
    kind : what the columns are.
    specimen, tool, noise : tables of the dataset, overridden by those of the curve; tool is None for a homogeneous state, and
        specimen too for a trajectory.
    time_s (k,) : 0 in the first row, strictly increasing [s].
    columns : name in SI -> (k,), see :data:`COLUMNS`; empty for a trajectory.
    sensors : name -> positions (k, 3) [m], NaN where a value is missing; a trajectory only.
    start_s : time at which the motion begins; None: to be seen in the rows and fitted; a trajectory only.
    fit_contact : whether the displacement of first contact is fitted; a curve under a tool only.
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
    start_s: float | None = 0.0
    fit_contact: bool = False

    @property
    def defect(self) -> str | None:
        """Description of a defect of the curve; None if there is none."""
        defect = self.conditions.get("defect")
        return None if defect is None else str(defect)

    def number(self, condition: str) -> float | None:
        """Return a numerical condition; None if the curve does not have it, or if it is not a number."""
        value = self.conditions.get(condition)
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None

    @property
    def imposed(self) -> str:
        """Name of the imposed column; not for a trajectory."""
        return self._driven()[0]

    @property
    def predicted(self) -> str:
        """Name of the predicted column; not for a trajectory."""
        return self._driven()[1]

    @property
    def displacement_m(self) -> np.ndarray:
        """Displacement of the tool, positive into the tissue (k,) [m]."""
        return self.columns["displacement_m"]

    @property
    def force_N(self) -> np.ndarray:
        """Force on the tool, positive in compression (k,) [N]."""
        return self.columns["force_N"]

    def _driven(self) -> tuple[str, str]:
        first, second = self.columns
        return (second, first) if self.tool is not None and self.tool.control == "force" else (first, second)


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Curves of one test, of specimens or of a moving body.

    Parameters
    ----------
    path : the dataset.toml.
    """

    name: str
    title: str
    test: TestKind
    source: str
    license: str
    notes: str
    path: Path
    curves: tuple[Curve, ...]

    def specimens(self, task: str, *, several: bool = False) -> SpecimenDataset:
        """The dataset, if it has tests of specimens.

        Parameters
        ----------
        task : begins the sentence of an error, such as "constants are identified from".
        several : whether it may have several kinds of tests, equibiaxial and planar ones among them.

        Raises
        ------
        InputError : it has trajectories, or other kinds of tests.
        """
        raise InputError(f"{self.path}: {task} tests of specimens, and this is a trajectory; use close-loop.")


@dataclass(frozen=True, eq=False, kw_only=True)
class TrajectoryDataset(Dataset):
    """Recordings of sensors on a moving body.

    Parameters
    ----------
    scenario : the model to compare with; without it the dataset has data only.
    sensors : name -> where it sits on the model.
    registration : from the frame of the sensors to that of the model, unless markers give it.
    fit : constants of the scenario that are fitted from the start, by the names of their effects.
    """

    scenario: Path | None = None
    sensors: dict[str, Sensor] = field(default_factory=dict)
    registration: RegistrationTable | None = None
    fit: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class SpecimenDataset(Dataset):
    """Material tests.

    Parameters
    ----------
    rig : limits of the machine, if the dataset states them.
    """

    rig: RigLimits | None = None

    @property
    def of_one_kind(self) -> bool:
        """Whether all curves are of one kind of test, and of one that effects are sought in."""
        kinds = {curve.kind for curve in self.curves}
        return len(kinds) == 1 and not kinds & {"equibiaxial", "planar"}

    def specimens(self, task: str, *, several: bool = False) -> SpecimenDataset:
        if several or self.of_one_kind:
            return self
        kinds = ", ".join(dict.fromkeys(curve.kind for curve in self.curves))
        raise InputError(
            f"{self.path}: {task} tests of one kind, uniaxial, shear or under a tool, and these are {kinds}; use identify."
        )

    def constants_groups(self) -> dict[str, tuple[Curve, ...]]:
        """Return the curves by the name of their constants, in the order of the file."""
        groups: dict[str, tuple[Curve, ...]] = {}
        for curve in self.curves:
            groups[curve.constants] = (*groups.get(curve.constants, ()), curve)
        return groups

    def regrouped(self, key: str) -> SpecimenDataset:
        """Return the same curves with constants shared by ``group`` or by a key of their conditions.

        Raises
        ------
        InputError : a curve has no such condition, or a held-out curve shares constants with no fitted curve.
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
    """Whether two curves differ only in ``digitisation``, so that they must be on the same side of a split.

    Numbers of the loading protocol may differ by 5 %, because they are digitised too. A default group is ignored.
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
    """Raise InputError if a held-out curve has constants that no fitted curve shares."""
    fitted = {curve.constants for curve in curves if curve.split != "holdout"}
    for curve in curves:
        if curve.constants not in fitted:
            raise InputError(
                f'{path}: curve "{curve.id}" is held out, and no fitted curve shares its constants "{curve.constants}"; '
                f'set split = "fit" for one of them, or use the same constants.'
            )


def check_sides(curves: Sequence[Curve], path: str) -> None:
    """Raise InputError if one measurement is on both sides of the split."""
    for one, other in combinations(curves, 2):
        if {one.split, other.split} == {"fit", "holdout"} and same_measurement(one, other):
            raise InputError(
                f'{path}: curves "{one.id}" and "{other.id}" are digitisations of one measurement, on two sides of '
                f"the split; set the same split for both."
            )


def _name_of(value: ConditionValue) -> str:
    """A condition as a name: true for True, "a, b" for an array."""
    if isinstance(value, bool):
        return str(value).lower()
    return ", ".join(map(_name_of, value)) if isinstance(value, list) else str(value)


def programme_of(curve: Curve) -> np.ndarray:
    """Return the imposed column (k,) in SI."""
    return curve.columns[curve.imposed]


def sd_of(curve: Curve, column: str) -> float | None:
    """Return the standard deviation of the noise of a column, in SI; None if it is unknown."""
    for key, of in NOISE[curve.kind].items():
        name, factor = COLUMNS[curve.kind][of]
        value = getattr(curve.noise, key)
        if name == column and value is not None:
            return float(value * factor)
    return None
