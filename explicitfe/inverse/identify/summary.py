"""Rows of numbers of an identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from explicitfe.inverse.identify.assumptions import Hidden
from explicitfe.inverse.identify.compare_laws import LawFit
from explicitfe.inverse.identify.fit import contact_interval
from explicitfe.inverse.identify.group_fit import GroupFit, root_mean_square
from explicitfe.inverse.identify.laws import YEOH
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.identify.paper import AGREEMENT_M, AGREEMENT_SHARE, ALPHA_M, BETA_M, PaperFit
from explicitfe.inverse.identify.total import changes_of_constants, headline, total_interval
from explicitfe.inverse.identify.warnings import group_warnings
from explicitfe.inverse.measured.curve import PRINTED_UNITS, Curve
from explicitfe.results.documents.identification import (
    ComparedLaw,
    HiddenRow,
    IdentifiedConstant,
    IdentifiedCurve,
    IdentifiedGroup,
    IdentifiedModulus,
    LawMisfit,
    MeanErrors,
    PaperRows,
)

ChangeKey = Literal["C10_change", "C20_change", "C30_change", "C01_change"]
CHANGES_OF: dict[str, tuple[ChangeKey, ...]] = {
    "yeoh": ("C10_change", "C20_change"),
    "yeoh-3": ("C10_change", "C20_change", "C30_change"),
    "neo-hooke": ("C10_change",),
    "mooney-rivlin": ("C10_change", "C01_change"),
}


def group_rows(fitted: GroupFit, assumed: Sequence[str], poisson: float) -> IdentifiedGroup:
    """The numbers and warnings of one group; ``assumed`` are the assumptions on its tests, in words."""
    fit, paper = fitted.fit, fitted.paper
    curves = _curve_rows(fitted)
    rows: IdentifiedGroup = {
        "status": "fitted" if paper is None else paper.status,
        "law": fit.law.name,
        "constants": _constants(fitted),
        "shear_modulus": _modulus(fitted, 1.0),
        "youngs_modulus": _modulus(fitted, 2.0 * (1.0 + poisson)),
        "misfit": _misfit(fitted),
        "laws": [_law_row(row, fitted) for row in fitted.laws],
        "undetermined": list(fit.undetermined),
        "correlation": fit.correlation if paper is None else None,
        "at_bound": list(fitted.at_bound),
        "chi2": fitted.chi2,
        "degrees_of_freedom": fit.free,
        "rows": sum(len(o.measured) for o in fitted.observed),
        "noise": "estimated from the residual" if fit.noise_estimated else "as the dataset states it",
        "noise_sd": fitted.noise_sd,
        "numerical_sd": fitted.numerical_sd,
        "interpolation_error": fitted.interpolation_error,
        "widened_by": fit.widening.factor,
        "unit": fitted.unit,
        "error": {side: _mean_errors(curves, side) for side in ("fit", "holdout")},
        "curves": curves,
        "assumed": list(assumed),
        "hides": [_hidden_row(hidden, fitted.scale, fit.law.name) for hidden in fitted.hidden],
    }
    if paper is not None:
        rows["paper"] = _paper_rows(paper, fitted.loads_N, fitted.measured_m)
    else:
        totals = {name: entry["total95"] for name, entry in rows["constants"].items()}
        rows["headline"] = headline(fitted, rows["shear_modulus"]["total95"], totals)
    rows["warnings"] = group_warnings(fitted)
    return rows


def _constants(fitted: GroupFit) -> dict[str, IdentifiedConstant]:
    fit, paper = fitted.fit, fitted.paper
    if paper is not None:
        return {name: {"value": float(value)} for name, value in zip(YEOH.constants, paper.constants, strict=True)}
    changes = changes_of_constants(fitted)
    return {
        name: {
            "value": float(fit.constants[k]),
            "sd": float(fit.sd[k]),
            "total95": total_interval(float(fit.constants[k]), fit.profile[name], changes[:, k]),
            "ci95": [float(x) for x in fit.profile[name]],
            "ci95_of_noise": [float(x) for x in fit.profile_of_noise[name]],
            "ci95_curvature": [float(x) for x in fit.curvature[name]],
        }
        for k, name in enumerate(fit.law.constants)
    }


def _modulus(fitted: GroupFit, factor: float) -> IdentifiedModulus:
    """A multiple of the small-strain shear modulus; the paper's method has no intervals."""
    modulus: IdentifiedModulus = {"value": factor * fitted.fit.law.shear_modulus_Pa(fitted.constants)}
    if fitted.paper is None:
        interval = fitted.fit.shear_modulus_interval
        changes = changes_of_constants(fitted) @ fitted.fit.law.shear_modulus_gradient()
        modulus["total95"] = [factor * x for x in total_interval(fitted.fit.shear_modulus[0], interval, changes)]
        modulus["ci95"] = [factor * x for x in interval]
    return modulus


def _misfit(fitted: GroupFit) -> LawMisfit:
    fit, test = fitted.fit, fitted.range_test
    residuals = [o.predicted(fitted.constants) - o.measured for o in fitted.observed]
    shares = [r / float(np.abs(o.measured).max()) for r, o in zip(residuals, fitted.observed, strict=True)]
    return {
        "rms": fitted.scale * root_mean_square(np.concatenate([residuals[number] for number in fitted.of_unit])),
        "nrmse": root_mean_square(np.concatenate(shares)),
        "reduced_chi2": None if fitted.chi2 is None else fitted.chi2 / max(fit.free, 1),
        "model_form": fit.widening.model_form,
        "lower_half_shear_modulus_Pa": None if test is None else test.shear_modulus_Pa,
        "depends_on_range": test is not None and test.significant,
    }


def _law_row(row: LawFit, fitted: GroupFit) -> ComparedLaw:
    if row.fit is None:
        return {"law": row.law.name, "problem": row.problem}
    fit = row.fit
    errors = [o.errors(fit.constants)["nrmse"] for o in row.observed]
    weights = [len(o.measured) for o in row.observed]
    return {
        "law": row.law.name,
        "constants": {name: float(c) for name, c in zip(fit.law.constants, fit.constants, strict=True)},
        "shear_modulus_Pa": fit.shear_modulus[0],
        "nrmse": float(np.sqrt(np.average(np.square(errors), weights=weights))),
        "reduced_chi2": None if fit.noise_estimated else fit.chi2 / max(fit.free, 1),
        "held_out_nrmse": row.held_out,
        "aicc_difference": row.aicc - min(other.aicc for other in fitted.laws),
        "bic_difference": row.bic - min(other.bic for other in fitted.laws),
        "weight": row.weight,
        "unstable_at_stretch": None if row.loss is None else row.loss.stretch,
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
        if observed.contact_m is not None and not held_out:
            contact, half = contact_interval(observed, fitted.fit, fitted.observed.index(observed))
            before = int((curve.displacement_m[: len(observed.measured)] < contact).sum())
            rows[curve.id] |= {
                "contact_mm": 1e3 * contact,
                "contact_ci95_mm": [1e3 * (contact - half), 1e3 * (contact + half)],
                "rows_before_contact": before,
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


def _hidden_row(hidden: Hidden, scale: float, law: str) -> HiddenRow:
    if hidden.change is None:
        return {"if": hidden.name, "left_open": hidden.left_open, "problem": hidden.problem}
    row: HiddenRow = {
        "if": hidden.name,
        "left_open": hidden.left_open,
        "left": scale * hidden.left,
        "left_in_noise": hidden.left_in_noise,
    }
    for key, change in zip(CHANGES_OF[law], hidden.change, strict=True):
        row[key] = float(change)
    return row
