"""Numbers in the pictures of a group, in the units of the axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.inverse.identify.fit import FEW_CONSTANTS, Fit, profile_curve
from explicitfe.inverse.identify.fitted_test import FittedTest
from explicitfe.inverse.identify.group_fit import GroupFit
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.identify.paper import PaperFit
from explicitfe.inverse.measured.curve import PRINTED_UNITS, Curve
from explicitfe.inverse.predict.setup import Setup

if TYPE_CHECKING:
    from explicitfe.results.documents.fitted_curves import ConstantProfile, FittedCurve, PaperTrace

# A profile is drawn over this many values, to so many standard deviations on either side.
PROFILE_POINTS = 25
PROFILE_SDS = 3.0
LINE_POINTS = 200  # The model's line has so many points.


@dataclass(frozen=True)
class GroupPictures:
    """The pictures of a group.

    Attributes
    ----------
    constants : the fitted constants by their names.
    profiles : likelihood of each constant; None for the paper's method, which has ``paper``, and for laws of many constants.
    test : the first test, to be drawn deformed; None for a homogeneous state and for laws that elements do not support.
    """

    curves: list[FittedCurve]
    constants: dict[str, float]
    profiles: list[ConstantProfile] | None
    paper: PaperTrace | None
    test: FittedTest | None


def pictures_of(fitted: GroupFit, setup: Setup | None) -> GroupPictures:
    """The pictures of a group whose first curve has this test."""
    group, constants, paper = fitted.group, fitted.constants, fitted.paper
    few = len(constants) <= FEW_CONSTANTS
    curves = [_curve(curve, o, "fit", constants) for curve, o in zip(group.fitted, fitted.observed, strict=True)]
    curves += [_curve(curve, o, "holdout", constants) for curve, o in zip(group.predicted, fitted.predicted, strict=True)]
    first = group.fitted[0]
    test = None
    if setup is not None and first.tool is not None:
        by_force = first.tool.control == "force"
        loads = (first.force_N if by_force else first.displacement_m)[: group.rows[first.id]]
        test = FittedTest(setup, constants, by_force, loads)
    return GroupPictures(
        curves=curves,
        constants=dict(zip(fitted.fit.law.constants, constants.tolist(), strict=True)),
        profiles=[_profile(k, fitted) for k in range(len(constants))] if few and paper is None else None,
        paper=None if paper is None else _trace(paper, fitted),
        test=test,
    )


def _curve(curve: Curve, observed: Observed, split: str, constants: np.ndarray) -> FittedCurve:
    x_unit, x_scale = PRINTED_UNITS.get(curve.imposed, ("", 1.0))
    y_unit, y_scale = PRINTED_UNITS[curve.predicted]
    line = np.linspace(observed.imposed.min(), observed.imposed.max(), LINE_POINTS)
    contact, by_force = observed.contact(constants), observed.model.by_force
    return {
        "id": curve.id,
        "split": split,
        "x_label": _label(curve.imposed, x_unit),
        "y_label": _label(curve.predicted, y_unit),
        "x": x_scale * observed.imposed,
        "measured": y_scale * observed.measured,
        "sd": y_scale * (observed.sd(constants) if observed.noise_known else np.zeros(len(observed.measured))),
        "predicted": y_scale * observed.predicted(constants),
        "line_x": x_scale * line,
        "line_y": y_scale * (observed.model(line - contact * (not by_force), *map(float, constants)) + contact * by_force),
    }


def _profile(number: int, fitted: GroupFit) -> ConstantProfile:
    fit: Fit = fitted.fit
    name, best = fit.law.constants[number], float(fit.constants[number])
    wider = fit.widening.factor
    half = wider * max(float(fit.sd[number]), (fit.curvature[name][1] - best) / 2.0)
    low = max(best - PROFILE_SDS * half, fit.law.lower[number])
    values = np.linspace(low, min(best + PROFILE_SDS * half, fit.law.upper[number]), PROFILE_POINTS)
    return {
        "name": name,
        "best": best,
        "sd": float(fit.sd[number]),
        "values": values,
        "rise": profile_curve(fitted.observed, fit, number, values) / wider**2,
        "ci95": fit.profile[name],
        "widened_by": wider,
    }


def _trace(paper: PaperFit, fitted: GroupFit) -> PaperTrace:
    return {
        "loads_N": fitted.loads_N,
        "measured_mm": 1e3 * fitted.measured_m,
        "displacements_mm": 1e3 * np.array([run.displacement_m for run in paper.trace]),
        "constants": np.array([[run.C10_Pa, run.C20_Pa] for run in paper.trace]),
    }


def _label(column: str, unit: str) -> str:
    name = column.rsplit("_", 1)[0] if column.endswith(("_m", "_N", "_Pa")) else column
    return f"{name.replace('_', ' ')} ({unit})" if unit else name.replace("_", " ")
