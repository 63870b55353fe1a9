"""What ``report.json`` holds, from where a loop ended, and what is left on disk: a whole folder or nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.close_loop import words
from explicitfe.close_loop.search import Outcome, Round, numerical_share
from explicitfe.close_loop.statistics.refit import BestFit, intervals
from explicitfe.results.folder import whole_folder

REPORT_FILE = "report.json"


def summary_of(closed: Outcome, before: BestFit, after: BestFit, last: Round) -> dict[str, Any]:
    """What ``report.json`` holds of a loop; ``last`` is the step of the model after, and errors are still to come."""
    covariance, first = last.covariance, closed.steps[0]
    numerical = numerical_share(covariance, last.fit, list(covariance.floors))
    rows = [
        {
            "curve": one.id,
            "sd": one.factor * float(np.sqrt(np.mean(row.sd**2))),
            "rho": row.correlation,
            "stated": row.stated,
            "n": len(row.sd),
            "n_eff": row.effective,
        }
        for one, row in zip(covariance.series, covariance.rows, strict=True)
    ]
    ambiguous = closed.steps[-1].ambiguous_with if closed.verdict in ("ambiguous", "effect-found") else ()
    best = closed.steps[-1].best
    effects = list(closed.effects) or ([first.best] if ambiguous and first.best else [])
    names = [*effects, *ambiguous, *closed.nearest, *([best] if best else [])]
    return {
        "verdict": closed.verdict,
        "remainder": closed.remainder,
        "remainder_where": words.where(last),
        "sentence": words.sentence(closed),
        "message": closed.message,
        "effects": effects,
        "effect_titles": {name: words.title(name) for name in names},
        "nearest": list(closed.nearest),
        "n_eff": covariance.effective,
        "noise": {
            "rows": rows,
            "scale_sd": covariance.scatter.scale,
            "offset_sd": covariance.scatter.offset,
            "scatter_source": covariance.scatter.source,
            "numerical": [{"what": name, "share_of_noise": share} for name, share in numerical.items()],
        },
        "baseline": {"parameters": parameters(before, first)},
        "final": {"parameters": parameters(after, last)},
        "steps": [_step(step) for step in closed.steps],
        "ambiguous_with": list(ambiguous),
        "separations": [{"a": a, "b": b, "separation": apart} for step in closed.steps for a, b, apart in step.separations],
    }


def parameters(fit: BestFit, step: Round) -> dict[str, Any]:
    """Values with 95 % intervals; those of a series as the model file states them."""
    # What is left unexplained is no noise: it widens the intervals.
    left_over = step.lack.chi2 if fit.by_rows is None else fit.by_rows
    worse = 1.0 if step.at_floor else max(left_over / max(step.lack.free, 1), 1.0)
    found: dict[str, Any] = {}
    left = 1.0
    for p, value, (low, high) in zip(fit.model.parameters, fit.model.values, intervals(fit, step.covariance, worse), strict=True):
        by = 1.0
        if p.name.startswith("viscoelastic.") and p.name.endswith(".g"):
            by, left = left, left * (1.0 - value)
        entry = {"value": by * value, "ci95": [by * low, by * high]}
        if p.name in ("C10_Pa", "C20_Pa"):
            found.setdefault(p.name, {})[p.group or "all"] = entry
        else:
            found[p.name] = entry
    return found


def failure_report(message: str) -> dict[str, Any]:
    """The same where nothing could be fitted."""
    return {
        "verdict": "failed",
        "remainder": "unexplained",
        "remainder_where": "",
        "sentence": f"The fit failed: {message} This says nothing about what the model lacks.",
        "message": message,
        "effects": [],
        "effect_titles": {},
        "n_eff": 0.0,
        "baseline": {"parameters": {}, "error": {}},
        "final": {"parameters": {}, "error": {}},
        "steps": [],
        "ambiguous_with": [],
        "separations": [],
        "next_experiment": None,
        "sensitivity_to_assumed": {},
        "warnings": [],
    }


def _step(step: Round) -> dict[str, Any]:
    rows = []
    for score in sorted(step.scores, key=lambda s: (-s.drop, s.status)):
        name = score.candidate.effect
        fit = step.refits.get(name)
        names = [p.name.rpartition(".")[2] for p in score.candidate.term.parameters]
        values = score.values if fit is None else fit.model.values[len(fit.model.x) - len(names) :]
        errors = step.cv.get(name)
        rows.append(
            {
                "effect": name,
                "status": "failed" if name in step.failures else score.status,
                "chi2_drop": score.drop,
                "chi2_drop_refitted": None if fit is None else step.fit.chi2 - fit.chi2,
                "p_holm": score.p_holm,
                "cv_nrmse": float(np.mean(list(errors.values()))) if errors else None,
                "parameters": dict(zip(names, values, strict=False)),
                "reason": step.failures.get(name, score.reason),
            }
        )
    without = step.cv.get("")
    return {
        "p_residual": step.p,
        "chi2": step.fit.chi2,
        "lack_of_fit": {"chi2": step.lack.chi2, "free": step.lack.free, "p": step.lack.p},
        "cv_nrmse": float(np.mean(list(without.values()))) if without else None,
        "candidates": rows,
        "chosen": step.chosen,
    }


def mean_errors(rows: dict[str, dict[str, Any]], side: str) -> dict[str, float] | None:
    """Mean rmse and nrmse of the curves of one side of the split."""
    mine = [row for row in rows.values() if row["split"] == side and row["rmse"] is not None]
    if not mine:
        return None
    return {key: float(np.mean([row[key] for row in mine if row[key] is not None])) for key in ("nrmse", "rmse")}


def write(target: Path, found: dict[str, Any], curves: list[dict[str, Any]], files: dict[str, str]) -> None:
    """A whole folder or nothing; ``files`` are texts by name.

    Raises
    ------
    InputError : the folder cannot be written.
    """
    from explicitfe.view.report import page as loopreport

    with whole_folder(target) as folder:
        names = [REPORT_FILE, *loopreport.write(folder, found, curves), *files]
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        found["files"] = [str(target / name) for name in names]
        (folder / REPORT_FILE).write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")
