"""What the page and its pictures both read out of a report: which effects, which candidates, which curves, in which order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from explicitfe.results.documents.loop_report import AssumedValue, LoopReport, MeanError, ReportCurve, ReportedModel
from explicitfe.results.documents.report_part import Side


def drawn_curves(curves: Sequence[ReportCurve]) -> list[ReportCurve]:
    """The curves that were measured: held-out ones first, then those that tell most.

    A curve tells most where the models before and after differ most, or, if they are the same, where the misfit is largest.
    """

    def by_what_it_tells(curve: ReportCurve) -> tuple[bool, float]:
        score = 0.0
        if curve.before is not None:
            after = curve.after
            other = curve.measured if after is None or np.allclose(after, curve.before, equal_nan=True) else after
            score = float(np.nanmean((curve.before - other) ** 2) / (np.nanmax(np.abs(curve.measured)) ** 2 or 1.0))
        return not curve.held_out, -score if math.isfinite(score) else 0.0

    return sorted((curve for curve in curves if len(curve.measured)), key=by_what_it_tells)


def noise_is_known(curves: Sequence[ReportCurve]) -> bool:
    """Whether the noise of every row of every curve is known."""
    return all(curve.sd is not None and bool((curve.sd > 0.0).all()) for curve in curves)


def mean_error(model: ReportedModel, side: Side) -> MeanError:
    """The mean error of a model over the fitted or the held-out curves, empty where it is unknown."""
    return (model.error.fit if side == "fit" else model.error.holdout) or MeanError()


def has_changed(report: LoopReport) -> bool:
    """Whether a model with more in it than the baseline was fitted."""
    before, after = ([mean_error(model, side).nrmse for side in ("fit", "holdout")] for model in (report.baseline, report.final))
    return any(error is not None and math.isfinite(error) for error in after) and before != after


def assumed_values(report: LoopReport) -> dict[str, list[AssumedValue]]:
    """Assumed quantity -> what follows from other values of it, where there is something."""
    return {key: rows for key, rows in report.sensitivity_to_assumed.items() if rows}
