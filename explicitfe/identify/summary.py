"""What an identification says: rows of numbers, and warnings in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from explicitfe.identify.assumptions import Hidden, sentence
from explicitfe.identify.fit import NAMES, Fit, Observed
from explicitfe.identify.forward import UniformResponse
from explicitfe.identify.group_fit import GroupFit
from explicitfe.identify.paper import AGREEMENT_M, AGREEMENT_SHARE, ALPHA_M, BETA_M, PaperFit
from explicitfe.measured.curve import PRINTED_UNITS, Curve, Dataset
from explicitfe.measured.select import Group
from explicitfe.results.identification import (
    HiddenRow,
    IdentifiedConstant,
    IdentifiedCurve,
    IdentifiedGroup,
    MeanErrors,
    PaperRows,
)

# Numerical noise above this share of the data's noise deserves a warning.
NUMERICAL_NOISE_SHARE = 0.5
# At this compression the free sides of an incompressible solid between platens lose their stability (Biot 1963).
FOLDING_COMPRESSION = 0.56
# A law with more chi2 per degree of freedom does not describe the data: its residual is twice the noise.
MISFIT_CHI2_RATIO = 4.0
# A first value above this share of the largest one was measured before the test began: the zero of the sensor is off.
OFFSET_SHARE = 0.01
# The tool stands at zero where it is nearer to it than this.
ZERO_DISPLACEMENT_M = 1e-9


def group_rows(fitted: GroupFit, assumed: Sequence[str]) -> IdentifiedGroup:
    """All that is said of one group; ``assumed`` is what was supposed of its tests, in words."""
    fit, paper = fitted.fit, fitted.paper
    curves = _curve_rows(fitted)
    rows: IdentifiedGroup = {
        "status": "fitted" if paper is None else paper.status,
        "constants": _constants(fit, paper),
        "correlation": fit.correlation if paper is None else None,
        "at_bound": list(fitted.at_bound),
        "chi2": fitted.chi2,
        "degrees_of_freedom": fit.count - 2 + len(fit.at_bound),
        "rows": fit.count,
        "noise": "estimated from the residual" if fit.noise_estimated else "as the dataset states it",
        "noise_sd": fitted.noise_sd,
        "numerical_sd": fitted.numerical_sd,
        "interpolation_error": fitted.interpolation_error,
        "widened_by": fit.widening.factor,
        "unit": fitted.unit,
        "error": {side: _mean_errors(curves, side) for side in ("fit", "holdout")},
        "curves": curves,
        "assumed": list(assumed),
        "hides": [_hidden_row(hidden, fitted.scale) for hidden in fitted.hidden],
    }
    if paper is not None:
        rows["paper"] = _paper_rows(paper, fitted.loads_N, fitted.measured_m)
    rows["warnings"] = _warnings(fitted)
    return rows


def _constants(fit: Fit, paper: PaperFit | None) -> dict[str, IdentifiedConstant]:
    if paper is not None:
        return {name: {"value": float(value)} for name, value in zip(NAMES, paper.constants, strict=True)}
    return {
        name: {
            "value": float(fit.constants[k]),
            "sd": float(fit.sd[k]),
            "ci95": [float(x) for x in fit.profile[name]],
            "ci95_of_noise": [float(x) for x in fit.profile_of_noise[name]],
            "ci95_curvature": [float(x) for x in fit.curvature[name]],
        }
        for k, name in enumerate(NAMES)
    }


def _curve_rows(fitted: GroupFit) -> dict[str, IdentifiedCurve]:
    rows: dict[str, IdentifiedCurve] = {}

    def add(curve: Curve, observed: Observed, held_out: bool) -> None:
        unit, scale = PRINTED_UNITS[curve.predicted]
        errors = observed.errors(fitted.constants)
        rows[curve.id] = {
            "split": "holdout" if held_out else "fit",
            "unit": unit,
            "rows": len(observed.measured),
            "rows_left_out": len(curve.time_s) - len(observed.measured),
            "rmse": scale * errors["rmse"],
            "nrmse": errors["nrmse"],
            "largest_error": scale * errors["largest"],
            "first_value": scale * float(observed.measured[0]),
        }

    for curve, observed in zip(fitted.group.fitted, fitted.observed, strict=True):
        add(curve, observed, held_out=False)
    for curve, observed in zip(fitted.group.predicted, fitted.predicted, strict=True):
        add(curve, observed, held_out=True)
    return rows


def _mean_errors(curves: Mapping[str, IdentifiedCurve], side: str) -> MeanErrors | None:
    rows = [row for row in curves.values() if row["split"] == side]
    if not rows:
        return None
    return {"nrmse": float(np.mean([r["nrmse"] for r in rows])), "rmse": float(np.mean([r["rmse"] for r in rows]))}


def _paper_rows(paper: PaperFit, loads_N: np.ndarray, measured_m: np.ndarray) -> PaperRows:
    errors = np.abs(paper.errors_m)
    return {
        "alpha_mm": 1e3 * ALPHA_M,
        "beta_mm": 1e3 * BETA_M,
        "tolerance": f"the larger of {100.0 * AGREEMENT_SHARE:g} % and {1e6 * AGREEMENT_M:g} µm",
        "loads_N": loads_N.tolist(),
        "measured_mm": (1e3 * measured_m).tolist(),
        "errors_mm": (1e3 * paper.errors_m).tolist(),
        "within": paper.within.tolist(),
        "largest_relative_error": float((errors / measured_m).max()),
        "trace": [
            {
                "C10_Pa": run.C10_Pa,
                "C20_Pa": run.C20_Pa,
                "changed": run.changed,
                "displacements_mm": (1e3 * run.displacement_m).tolist(),
            }
            for run in paper.trace
        ],
    }


def _hidden_row(hidden: Hidden, scale: float) -> HiddenRow:
    if hidden.change is None:
        return {"if": hidden.name, "problem": hidden.problem}
    return {
        "if": hidden.name,
        "C10_change": float(hidden.change[0]),
        "C20_change": float(hidden.change[1]),
        "left": scale * hidden.left,
        "left_in_noise": hidden.left_in_noise,
    }


# ---- warnings ----


def _warnings(fitted: GroupFit) -> list[str]:
    """What a reader must know before using the constants."""
    unit, scale = fitted.unit, fitted.scale
    warnings = []
    if fitted.at_bound:
        warnings.append("C20 is at its bound 0: the data stiffen less than any such law, and the interval is one-sided.")
    warnings += _about_residuals(fitted)
    if fitted.numerical_sd > NUMERICAL_NOISE_SHARE * fitted.noise_sd and not fitted.fit.noise_estimated:
        warnings.append(
            f"Numerical noise ({fitted.numerical_sd:.2g} {unit}) is no longer small against that of the data "
            f"({fitted.noise_sd:.2g} {unit}): take a larger --refinement."
        )
    warnings += _about_curves(fitted)
    about_hidden = sentence(
        fitted.hidden, float(fitted.constants[0]), {"mm": "µm"}.get(unit, unit), scale * (1e3 if unit == "mm" else 1.0)
    )
    return warnings + ([about_hidden] if about_hidden else [])


def _about_residuals(fitted: GroupFit) -> list[str]:
    """Warnings about the size of the residuals, and about their correlation."""
    fit = fitted.fit
    warnings = []
    if fit.noise_estimated:
        warnings.append("The dataset does not state the noise of all curves: it is estimated from the residual, misfit included.")
    elif fitted.chi2 is not None and fit.count > 2 and fit.chi2 > MISFIT_CHI2_RATIO * (fit.count - 2):
        share = np.sqrt(fit.chi2 / (fit.count - 2))
        warnings.append(f"The residual is {share:.1f} times the noise: the law does not describe these data.")
    widening = fit.widening
    if widening.correlation:
        warnings.append(
            f"Neighbouring residuals are correlated ({widening.correlation:.2f}): {widening.rows} rows count as about "
            f"{widening.effective:.0f}."
        )
    if widening.factor > 1.0 and fitted.paper is None:
        times = f"{widening.factor:.{0 if widening.factor >= 10.0 else 1}f}"
        warnings.append(
            f"The 95 % intervals are {times} times as wide as from independent noise alone, as the residual asks for."
        )
    return warnings


def _about_curves(fitted: GroupFit) -> list[str]:
    """Warnings about single curves: offsets, folded sides, rows that are left out."""
    unit, scale = fitted.unit, fitted.scale
    pairs = list(zip(fitted.group.fitted, fitted.observed, strict=True))
    warnings = []
    offsets = [f"{curve.id} {scale * o.measured[0]:.3g} {unit}" for curve, o in pairs if _has_offset(curve, o)]
    if offsets:
        warnings.append(f"The first row is not zero and the law has no offset: {', '.join(offsets)}.")
    folded = [curve.id for curve, o in pairs if _folds(curve, o)]
    if folded:
        warnings.append(
            f"Below a stretch of {1.0 - FOLDING_COMPRESSION:.2f} the sides of a simulated specimen fold (Biot's surface "
            f"instability); the fit supposes that they stayed straight: {', '.join(folded)}."
        )
    pairs += zip(fitted.group.predicted, fitted.predicted, strict=True)
    lost = sum(len(curve.time_s) - len(o.measured) for curve, o in pairs)
    if lost:
        warnings.append(
            f"Only loading is used, an elastic law knows no other way: {lost} rows of hold and unloading are left out."
        )
    return warnings


def _has_offset(curve: Curve, observed: Observed) -> bool:
    if curve.tool is None or abs(observed.imposed[0]) >= ZERO_DISPLACEMENT_M:
        return False
    return bool(abs(observed.measured[0]) > OFFSET_SHARE * np.abs(observed.measured).max())


def _folds(curve: Curve, observed: Observed) -> bool:
    response = observed.model.response
    return isinstance(response, UniformResponse) and curve.displacement_m.max() > FOLDING_COMPRESSION * response.height_m


def warnings_of_dataset(
    dataset: Dataset, groups: Sequence[Group], left_out: Mapping[str, str], failures: Mapping[str, str]
) -> list[str]:
    """What a reader must know of the dataset as a whole."""
    warnings = [f'Curve "{name}" is left out, {why}.' for name, why in left_out.items()]
    if not any(group.predicted for group in groups):
        warnings.append("Every curve is fitted: nothing shows whether the constants predict what they were not fitted to.")
    warnings += [f'Constants "{name}" failed: {message}' for name, message in failures.items()]
    return warnings
