"""A composed law in the report, and its model file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.inverse.close_loop.compared import Entry
from explicitfe.inverse.close_loop.discovery.law import LAW, Discovery, discover
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict.experiment import experiments
from explicitfe.results.documents.loop_report import DiscoveredLawReport, LoopReport, ReportedTerm

LAW_FILE = "discovered.toml"


def add_discovered_law(report: LoopReport, system: Specimens, held_out: Sequence[Curve], last: Entry) -> dict[str, str]:
    """Look for a law where the model of the last round leaves something unexplained, and put it into the report.

    Parameters
    ----------
    held_out : curves that are only predicted.

    Returns
    -------
    Name and text of the model file with the law; empty where none is told.
    """
    if report.remainder == "at-floor" or (system.only and LAW not in system.only):
        return {}
    discovery = discover(system, last)
    if discovery is None:
        return {}
    fit, holdout = (_error(system, discovery, curves) for curves in (system.curves, held_out))
    report.discovered_law = DiscoveredLawReport(
        text=discovery.text,
        terms=[ReportedTerm(polynomial=what, coefficient_Pa=value, tau_s=tau) for what, tau, value in discovery.terms],
        instead_of=list(discovery.instead_of),
        cv_nrmse=discovery.cv,
        cv_nrmse_before=discovery.cv_before,
        error_fit=fit,
        error_holdout=holdout,
        file=LAW_FILE,
    )
    before = report.final.error.holdout
    misses = ""
    if holdout is not None and before is not None and before.nrmse is not None:
        misses = f", held-out curves by {100.0 * holdout:.2g} instead of {100.0 * before.nrmse:.2g} %"
    report.warnings.append(
        f"a law composed from these data ({LAW_FILE}) misses left-out tests by {100.0 * discovery.cv:.2g} instead of "
        f"{100.0 * discovery.cv_before:.2g} %{misses}; it describes and names no cause: {discovery.text}."
    )
    tissue = discovery.tissue.model_copy(update={"title": f"{report.dataset}: discovered law"})
    return {LAW_FILE: tissue.text}


def _error(system: Specimens, discovery: Discovery, curves: Sequence[Curve]) -> float | None:
    """Mean error of curves with the law, as a share of each one's largest value; None where none can be computed."""
    tests = experiments(curves)
    shares = []
    for test, run in zip(tests, system.simulator.run([(test, discovery.tissue) for test in tests]), strict=True):
        for curve, values in zip(test, [] if isinstance(run, str) else run, strict=False):
            measured = curve.columns[curve.predicted]
            shares.append(float(np.sqrt(np.mean((values - measured) ** 2)) / np.abs(measured).max()))
    return float(np.mean(shares)) if shares else None
