"""What an identification says: rows of numbers, and warnings in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from explicitfe.identify.assumptions import Hidden, sentence
from explicitfe.identify.fit import NAMES, Fit, Observed
from explicitfe.identify.forward import UniformResponse
from explicitfe.identify.paper import (
    ALPHA_M,
    BETA_M,
    NEAR_M,
    SHARE,
    PaperFit,
)
from explicitfe.measured.curve import PRINTED_UNITS, Dataset
from explicitfe.measured.select import Group

ROUGH = 0.5  # of the noise: above this numerical noise deserves a word


FOLDS = 0.56  # compression at which the free sides of a compressed incompressible solid lose stability (Biot 1963)


MISFIT = 4.0  # chi2 over degrees of freedom


CORRELATED = 0.5  # of neighbouring residuals


OFFSET = 0.01  # of the largest value: what is measured before the test begins


def constants_rows(fit: Fit, paper: PaperFit | None) -> dict[str, Any]:
    if paper is not None:
        return {name: {"value": float(value)} for name, value in zip(NAMES, paper.constants, strict=True)}
    return {
        name: {
            "value": float(fit.constants[k]),
            "sd": float(fit.sd[k]),
            "ci95": [float(x) for x in fit.profile[name]],
            "ci95_curvature": [float(x) for x in fit.curvature[name]],
        }
        for k, name in enumerate(NAMES)
    }


def curve_rows(
    group: Group, observed: Sequence[Observed], predicted: Sequence[Observed], constants: np.ndarray
) -> dict[str, dict[str, Any]]:
    rows = {}
    for side, curves, seen in (("fit", group.fitted, observed), ("holdout", group.predicted, predicted)):
        for curve, o in zip(curves, seen, strict=True):
            unit, scale = PRINTED_UNITS[curve.predicted]
            errors = o.errors(constants)
            rows[curve.id] = {
                "split": side,
                "unit": unit,
                "rows": len(o.measured),
                "rows_left_out": len(curve.time_s) - len(o.measured),
                "rmse": scale * errors["rmse"],
                "nrmse": errors["nrmse"],
                "largest_error": scale * errors["largest"],
                "first_value": scale * float(o.measured[0]),
            }
    return rows


def mean_errors(curves: dict[str, dict[str, Any]], side: str) -> dict[str, float] | None:
    rows = [row for row in curves.values() if row["split"] == side]
    if not rows:
        return None
    return {"nrmse": float(np.mean([r["nrmse"] for r in rows])), "rmse": float(np.mean([r["rmse"] for r in rows]))}


def numerical_sd(observed: Sequence[Observed], constants: np.ndarray) -> float:
    """Rms numerical noise of the predictions, SI."""
    parts = []
    for o in observed:
        value, slope = o.model.with_slope(o.imposed, *map(float, constants))
        # the roughness is one of forces
        in_force = np.abs(o.imposed * slope) if o.model.by_force else np.abs(value)
        parts.append(o.model.response.roughness * in_force)
    return root_mean_square(np.concatenate(parts))


def paper_rows(paper: PaperFit, loads_N: np.ndarray, measured_m: np.ndarray) -> dict[str, Any]:
    errors = np.abs(paper.errors_m)
    return {
        "alpha_mm": 1e3 * ALPHA_M,
        "beta_mm": 1e3 * BETA_M,
        "tolerance": f"the larger of {100.0 * SHARE:g} % and {1e6 * NEAR_M:g} µm",
        "loads_N": loads_N.tolist(),
        "measured_mm": (1e3 * measured_m).tolist(),
        "errors_mm": (1e3 * paper.errors_m).tolist(),
        "within": paper.within.tolist(),
        "largest_relative_error": float((errors / measured_m).max()),
        "trace": [
            {
                "C10_Pa": step.C10_Pa,
                "C20_Pa": step.C20_Pa,
                "changed": step.changed,
                "displacements_mm": (1e3 * step.displacement_m).tolist(),
            }
            for step in paper.trace
        ],
    }


def hidden_row(hidden: Hidden, scale: float) -> dict[str, Any]:
    if hidden.change is None:
        return {"if": hidden.name, "problem": hidden.problem}
    return {
        "if": hidden.name,
        "C10_change": float(hidden.change[0]),
        "C20_change": float(hidden.change[1]),
        "left": scale * hidden.left,
        "left_in_noise": hidden.left_in_noise,
    }


def warnings_of_group(
    group: Group,
    observed: Sequence[Observed],
    fit: Fit,
    summary: dict[str, Any],
    hidden: Sequence[Hidden],
    constants: np.ndarray,
    unit: str,
    scale: float,
) -> list[str]:
    """What a reader must know before using the constants."""
    words = []
    if summary["at_bound"]:
        words.append("C20 is at its bound 0: the data stiffen less than any such law, and the interval is one-sided.")
    if fit.noise_estimated:
        words.append("The dataset does not state the noise of all curves: it is estimated from the residual, misfit included.")
    elif summary["chi2"] is not None and fit.count > 2 and fit.chi2 > MISFIT * (fit.count - 2):
        times = np.sqrt(fit.chi2 / (fit.count - 2))
        words.append(
            f"The residual is {times:.1f} times the noise: the law does not describe these data, and the intervals count "
            "noise only."
        )
    rests = [o.predicted(constants) - o.measured for o in observed]
    top = sum(float(r[1:] @ r[:-1]) for r in rests)
    bottom = sum(float(r @ r) for r in rests)
    if fit.count > 20 and bottom > 0.0 and top / bottom > CORRELATED:
        effective = fit.count * (1.0 - top / bottom) / (1.0 + top / bottom)
        words.append(
            f"Neighbouring residuals are correlated ({top / bottom:.2f}): {fit.count} rows count as about "
            f"{max(effective, 1.0):.0f}, and honest intervals are about "
            f"{np.sqrt(fit.count / max(effective, 1.0)):.0f} times as wide."
        )
    if summary["numerical_sd"] > ROUGH * summary["noise_sd"] and not fit.noise_estimated:
        words.append(
            f"Numerical noise ({summary['numerical_sd']:.2g} {unit}) is no longer small against that of the data "
            f"({summary['noise_sd']:.2g} {unit}): take a larger --refinement."
        )
    offsets = [
        f"{curve.id} {scale * o.measured[0]:.3g} {unit}"
        for curve, o in zip(group.fitted, observed, strict=True)
        if curve.tool is not None and abs(o.imposed[0]) < 1e-9 and abs(o.measured[0]) > OFFSET * np.abs(o.measured).max()
    ]
    if offsets:
        words.append(f"The first row is not zero and the law has no offset: {', '.join(offsets)}.")
    folded = [
        curve.id
        for curve, o in zip(group.fitted, observed, strict=True)
        if isinstance(o.model.response, UniformResponse) and curve.displacement_m.max() > FOLDS * o.model.response.height_m
    ]
    if folded:
        words.append(
            f"Below a stretch of {1.0 - FOLDS:.2f} the sides of a simulated specimen fold (Biot's surface instability); the fit "
            f"supposes that they stayed straight: {', '.join(folded)}."
        )
    lost = sum(row["rows_left_out"] for row in summary["curves"].values())
    if lost:
        words.append(f"Only loading is used, an elastic law knows no other way: {lost} rows of hold and unloading are left out.")
    warning = sentence(hidden, float(constants[0]), {"mm": "µm"}.get(unit, unit), scale * (1e3 if unit == "mm" else 1.0))
    return words + ([warning] if warning else [])


def overall_warnings(dataset: Dataset, groups: Sequence[Group], left_out: dict[str, str], failures: dict[str, str]) -> list[str]:
    words = [f'Curve "{name}" is left out, {why}.' for name, why in left_out.items()]
    if not any(group.predicted for group in groups):
        words.append("Every curve is fitted: nothing shows whether the constants predict what they were not fitted to.")
    words += [f'Constants "{name}" failed: {message}' for name, message in failures.items()]
    return words


def root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
