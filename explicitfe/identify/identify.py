"""``explicitfe identify``: from a folder of measured curves to the constants of the tissue, and to what they hang on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.errors import InputError, Progress, RunError, nearest, silent
from explicitfe.identify.assumptions import Hidden, alternatives, what_a_fit_hides
from explicitfe.identify.fit import Fit, Observed, least_squares_fit
from explicitfe.identify.forward import FIRST_Q, ToolResponse, ratio
from explicitfe.identify.forward_models import ForwardModels
from explicitfe.identify.paper import (
    PaperFit,
    by_simulator,
    first_guess,
    force_steps,
    identify_by_paper,
)
from explicitfe.identify.pictures import pictures_of_group
from explicitfe.identify.summary import (
    constants_rows,
    curve_rows,
    hidden_row,
    mean_errors,
    numerical_sd,
    overall_warnings,
    paper_rows,
    root_mean_square,
    warnings_of_group,
)
from explicitfe.identify.write import SUMMARY_FILE, write
from explicitfe.measured.curve import PRINTED_UNITS
from explicitfe.measured.read import read_dataset
from explicitfe.measured.select import Group, select
from explicitfe.results.folder import checked_target

METHODS = ("least-squares", "paper")

WINDOW_SD = 4.0  # of q: the runs around the estimate reach so far
WINDOW = 0.05  # of q, at least
CHECKS = 4  # runs that verify the interpolation, at most
INTERPOLATION = 5e-4  # of a force: above this deviation at the optimum the response gets another run there


def identify(
    dataset_path: Path | str,
    *,
    method: str = "least-squares",
    out: Path | str | None = None,
    fit_where: Sequence[str] = (),
    constants_by: str | None = None,
    poisson: float = 0.499,
    refinement: float = 1.5,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Identify C10 and C20 of each group of constants of a dataset.

    Parameters
    ----------
    dataset_path : the folder, or its dataset.toml.
    method : "least-squares", or "paper", the iteration of Gerard et al. (2005).
    out : folder for identify.json, pictures, and a scenario with the fitted constants; nothing is written if left out.
    fit_where : "KEY=VALUE" on conditions: what does not match is predicted only.
    constants_by : ``group`` or a condition: constants are shared by curves that agree in it.
    poisson : Poisson's ratio, supposed.
    refinement : divides the element sizes of the forward model.
    overwrite : replace the pictures of an earlier identification in ``out``.
    report : told "compile" or "identify" and the share that is done.

    Returns
    -------
    What ``explicitfe identify --json`` prints; see docs/identify.md.

    Raises
    ------
    InputError : the dataset or an option cannot be used. Nothing is written.
    RunError : no group could be identified.
    """
    begin = time.perf_counter()
    if method not in METHODS:
        raise InputError(f"--method {method}: {nearest(method, METHODS)}")
    if not 0.0 <= poisson <= 0.4995:
        raise InputError(f"--poisson {poisson:g}: it must lie between 0 and 0.4995.")
    if not 0.2 <= refinement <= 4.0:
        raise InputError(f"--refinement {refinement:g}: it must lie between 0.2 and 4.")
    target = None if out is None else checked_target(Path(out), overwrite, summary=SUMMARY_FILE, what="identification")
    dataset = read_dataset(dataset_path)
    if constants_by is not None:
        dataset = dataset.regrouped(constants_by)
    groups, left_out = select(dataset, fit_where)
    tests = ForwardModels(groups, poisson, refinement)
    if method == "paper":
        for group in groups:
            force_steps(group.fitted, group.rows)
    progress("compile", 0.0)
    tests.compile()
    progress("compile", 1.0)
    work = _Work(progress, tests.runs_planned(groups, method))

    found: dict[str, Any] = {}
    pictures: dict[str, dict[str, Any]] = {}
    failures: dict[str, str] = {}
    for group in groups:
        try:
            found[group.name], pictures[group.name] = _identify(group, tests, method, work)
        except RunError as error:
            failures[group.name] = str(error)
            found[group.name] = {"status": "failed", "message": str(error), "warnings": []}
    if len(failures) == len(groups):
        name, message = next(iter(failures.items()))
        raise RunError(message if len(groups) == 1 else f'constants "{name}" and all others: {message}')
    summary: dict[str, Any] = {
        "dataset": dataset.name,
        "title": dataset.title,
        "path": str(dataset.path),
        "test": dataset.test,
        "method": method,
        "law": "yeoh",
        "poisson": poisson,
        "refinement": refinement,
        "groups": found,
        "left_out": left_out,
        "forward_runs": tests.runs,
        "warnings": overall_warnings(dataset, groups, left_out, failures),
        "wall_s": 0.0,
        "files": [],
    }
    summary["wall_s"] = time.perf_counter() - begin
    if target is not None:
        write(target, summary, pictures)
    summary["wall_s"] = time.perf_counter() - begin
    progress("identify", 1.0)
    return summary


class _Work:
    """Share of the planned forward runs that is done; it never goes back, though more may be needed than planned."""

    def __init__(self, progress: Progress, planned: int) -> None:
        self._progress, self._planned = progress, max(planned, 1)
        self._done = 0.0
        self._shown = 0.0

    def running(self, share: float) -> None:
        """Inside a run."""
        self._show(self._done + share)

    def done(self, runs: float = 1.0) -> None:
        self._done += runs
        self._show(self._done)

    def within(self, runs: int) -> Callable[[float], None]:
        """For several runs that report as one."""
        start = self._done

        def progress(share: float) -> None:
            self._done = start + share * runs
            self._show(self._done)

        return progress

    def _show(self, done: float) -> None:
        # close to the end, what was not planned moves it ever less
        share = done / self._planned
        self._shown = max(self._shown, 0.98 * (share if share < 0.9 else 1.0 - 0.1 * np.exp(-(share - 0.9) / 0.1)))
        self._progress("identify", float(self._shown))


def _identify(group: Group, tests: ForwardModels, method: str, work: _Work) -> tuple[dict[str, Any], dict[str, Any]]:
    """One group: its part of the summary, and numbers for its pictures."""
    observed = [tests.observed(curve, group.rows[curve.id]) for curve in group.fitted]
    predicted = [tests.observed(curve, group.rows[curve.id]) for curve in group.predicted]
    for response in _responses(observed + predicted):
        response.add(FIRST_Q, work.within(len(FIRST_Q)))
    paper: PaperFit | None = None
    loads = np.zeros(0)
    measured = np.zeros(0)
    if method == "paper":
        loads, measured = force_steps(group.fitted, group.rows)
        setup = tests.setups[group.fitted[0].id]
        if any(tests.setups[c.id].key != setup.key for c in group.fitted):
            raise InputError("the paper's method needs curves of one test; choose them by --fit.")
        paper = identify_by_paper(
            by_simulator(setup, loads), measured, first_guess(setup, loads[0], measured[0]), progress=lambda runs: work.done()
        )
        tests.other_runs += len(paper.trace)
        if paper.status == "not-converged":
            raise RunError(
                f"the paper's iteration did not converge in {len(paper.trace)} runs: at the largest load it misses by "
                f"{1e6 * paper.errors_m[-1]:+.0f} µm; take --method least-squares."
            )
    fit, interpolation = _fitted(observed, work)
    for response in _responses(predicted):
        response.add([ratio(*fit.constants)], work.within(1))
    # What is said of misfit and assumptions belongs to the method's own constants.
    constants = fit.constants if paper is None else paper.constants
    curves = curve_rows(group, observed, predicted, constants)
    hidden: list[Hidden] = []
    first = group.fitted[0]
    if first.tool is not None:
        alike = [o for o, c in zip(observed, group.fitted, strict=True) if tests.setups[c.id].key == tests.setups[first.id].key]
        choices = alternatives(tests.setups[first.id], first)
        order = [observed.index(o) for o in alike]
        part = Fit(**{**vars(fit), "constants": constants, "sds": tuple(fit.sds[k] for k in order)})
        hidden, runs = what_a_fit_hides(tests.setups[first.id], alike, part, choices, work.done)
        tests.other_runs += runs
    unit, scale = PRINTED_UNITS[first.predicted]
    summary: dict[str, Any] = {
        "status": "fitted" if paper is None else paper.status,
        "constants": constants_rows(fit, paper),
        "correlation": fit.correlation if paper is None else None,
        "at_bound": list(fit.at_bound if paper is None else ["C20_Pa"] * (paper.status == "bound")),
        "chi2": fit.chi2 if paper is None and not fit.noise_estimated else None,
        "degrees_of_freedom": fit.count - 2 + len(fit.at_bound),
        "rows": fit.count,
        "noise": "estimated from the residual" if fit.noise_estimated else "as the dataset states it",
        "noise_sd": scale * root_mean_square(np.concatenate(fit.sds)),
        "numerical_sd": scale * numerical_sd(observed, constants),
        "interpolation_error": interpolation,
        "unit": unit,
        "error": {side: mean_errors(curves, side) for side in ("fit", "holdout")},
        "curves": curves,
        "assumed": sorted({text for c in group.fitted if c.tool is not None for text in tests.setups[c.id].assumed})
        + [f"Poisson's ratio {tests.poisson:g}"],
        "hides": [hidden_row(h, scale) for h in hidden],
    }
    if paper is not None:
        summary["paper"] = paper_rows(paper, loads, measured)
    summary["warnings"] = warnings_of_group(group, observed, fit, summary, hidden, constants, unit, scale)
    pictures = pictures_of_group(group, tests, observed, predicted, fit, constants, paper, loads, measured)
    work.done()
    return summary, pictures


def _fitted(observed: Sequence[Observed], work: _Work) -> tuple[Fit, float]:
    """The fit, with runs of the simulator where it needs them, and how far the interpolated response was from the last one."""
    responses = _responses(observed)
    fit = least_squares_fit(observed, profile=False)
    error = 0.0
    if responses:
        q = ratio(*fit.constants)
        # d q = (1 - q)^2 d s, and s is C20 / C10
        s = fit.constants[1] / fit.constants[0]
        gradient = np.array([-s, 1.0]) / fit.constants[0]
        spread = WINDOW_SD * (1.0 - q) ** 2 * float(np.sqrt(max(gradient @ fit.covariance @ gradient, 0.0)))
        window = float(np.clip(spread, WINDOW, 0.3))
        for response in responses:
            response.add([q - window, q, q + window], work.within(3))
        for _ in range(CHECKS):
            fit = least_squares_fit(observed, fit.constants, profile=False)
            error = max(response.check(ratio(*fit.constants), work.running) for response in responses)
            work.done()
            if error < INTERPOLATION:
                break
    return least_squares_fit(observed, fit.constants), error


def _responses(observed: Sequence[Observed]) -> list[ToolResponse]:
    """Those that run the simulator, each once."""
    return list({id(r): r for o in observed if isinstance(r := o.model.response, ToolResponse)}.values())


# ---- in words and rows ----


# ---- pictures: numbers only ----
