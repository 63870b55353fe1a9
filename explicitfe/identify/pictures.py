"""What the pictures of a group show: numbers in the units of the axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from explicitfe.identify.fit import NAMES, Fit, Observed, profile_curve
from explicitfe.identify.forward_models import ForwardModels
from explicitfe.identify.paper import (
    PaperFit,
)
from explicitfe.identify.write import Deformed
from explicitfe.measured.curve import PRINTED_UNITS
from explicitfe.measured.select import Group

PROFILE_POINTS, PROFILE_SD = 25, 3.0


def pictures_of_group(
    group: Group,
    tests: ForwardModels,
    observed: Sequence[Observed],
    predicted: Sequence[Observed],
    fit: Fit,
    constants: np.ndarray,
    paper: PaperFit | None,
    loads_N: np.ndarray,
    measured_m: np.ndarray,
) -> dict[str, Any]:
    """What the pictures of a group show, in the units of the axes."""
    curves = []
    for side, some, seen in (("fit", group.fitted, observed), ("holdout", group.predicted, predicted)):
        for curve, o in zip(some, seen, strict=True):
            x_unit, x_scale = PRINTED_UNITS.get(curve.imposed, ("", 1.0))
            y_unit, y_scale = PRINTED_UNITS[curve.predicted]
            fine = np.linspace(o.imposed.min(), o.imposed.max(), 200)
            curves.append(
                {
                    "id": curve.id,
                    "split": side,
                    "x_label": _label(curve.imposed, x_unit),
                    "y_label": _label(curve.predicted, y_unit),
                    "x": x_scale * o.imposed,
                    "measured": y_scale * o.measured,
                    "sd": y_scale * (o.sd(constants) if o.noise_known else np.zeros(len(o.measured))),
                    "predicted": y_scale * o.predicted(constants),
                    "line_x": x_scale * fine,
                    "line_y": y_scale * o.model(fine, *map(float, constants)),
                }
            )
    pictures: dict[str, Any] = {"curves": curves, "constants": constants.tolist()}
    if paper is None:
        pictures["profiles"] = []
        for k, name in enumerate(NAMES):
            half = max(float(fit.sd[k]), (fit.curvature[name][1] - fit.constants[k]) / 2.0)
            low = max(fit.constants[k] - PROFILE_SD * half, 1e-3 if k == 0 else 0.0)
            values = np.linspace(low, fit.constants[k] + PROFILE_SD * half, PROFILE_POINTS)
            pictures["profiles"].append(
                {
                    "name": name,
                    "best": float(fit.constants[k]),
                    "sd": float(fit.sd[k]),
                    "values": values,
                    "rise": profile_curve(observed, fit, k, values),
                    "ci95": fit.profile[name],
                }
            )
    else:
        pictures["paper"] = {
            "loads_N": loads_N,
            "measured_mm": 1e3 * measured_m,
            "displacements_mm": 1e3 * np.array([step.displacement_m for step in paper.trace]),
            "changed": [step.changed for step in paper.trace],
            "constants": np.array([[step.C10_Pa, step.C20_Pa] for step in paper.trace]),
        }
    first = group.fitted[0]
    if first.tool is not None:
        rows = group.rows[first.id]
        loads = first.force_N[:rows] if first.tool.control == "force" else first.displacement_m[:rows]
        pictures["deformed"] = Deformed(
            setup=tests.setups[first.id], constants=constants, by_force=first.tool.control == "force", loads=loads
        )
    return pictures


def _label(column: str, unit: str) -> str:
    name = column.rsplit("_", 1)[0] if column.endswith(("_m", "_N", "_Pa")) else column
    return f"{name.replace('_', ' ')} ({unit})" if unit else name.replace("_", " ")
