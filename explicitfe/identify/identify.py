"""``explicitfe identify``: from a folder of measured curves to the constants of the tissue, and to what they hang on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from explicitfe.errors import InputError, Progress, RunError, nearest, silent
from explicitfe.identify.assumptions import Hidden, alternatives, sentence, what_a_fit_hides
from explicitfe.identify.fit import NAMES, Fit, Observed, least_squares_fit, profile_curve
from explicitfe.identify.forward import FIRST_Q, CurveModel, PointResponse, Response, ToolResponse, UniformResponse, ratio
from explicitfe.identify.paper import (
    ALPHA_M,
    BETA_M,
    NEAR_M,
    SHARE,
    PaperFit,
    by_simulator,
    first_guess,
    force_steps,
    identify_by_paper,
)
from explicitfe.identify.writing import Deformed, write
from explicitfe.measured.curve import PRINTED_UNITS, Curve, Dataset, programme_of, sd_of
from explicitfe.measured.read import read_dataset
from explicitfe.measured.select import Group, select
from explicitfe.predict.setup import Setup, is_uniform, setup_of
from explicitfe.results.folder import checked_target

METHODS = ("least-squares", "paper")

BEYOND = 1.15  # of the largest depth measured: how far a response goes under imposed forces
WINDOW_SD = 4.0  # of q: the runs around the estimate reach so far
WINDOW = 0.05  # of q, at least
CHECKS = 4  # runs that verify the interpolation, at most
INTERPOLATION = 5e-4  # of a force: above this deviation at the optimum the response gets another run there
ROUGH = 0.5  # of the noise: above this numerical noise deserves a word
FOLDS = 0.56  # compression at which the free sides of a compressed incompressible solid lose stability (Biot 1963)
MISFIT = 4.0  # chi2 over degrees of freedom
CORRELATED = 0.5  # of neighbouring residuals
OFFSET = 0.01  # of the largest value: what is measured before the test begins
PROFILE_POINTS, PROFILE_SD = 25, 3.0


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
    target = None if out is None else checked_target(Path(out), overwrite)
    dataset = read_dataset(dataset_path)
    if constants_by is not None:
        dataset = dataset.regrouped(constants_by)
    groups, left_out = select(dataset, fit_where)
    tests = _Tests(groups, poisson, refinement)
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
        "warnings": _overall_warnings(dataset, groups, left_out, failures),
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


@dataclass
class _Tests:
    """Setups and responses, shared by all curves of one geometry."""

    groups: list[Group]
    poisson: float
    refinement: float

    def __post_init__(self) -> None:
        self.setups: dict[str, Setup] = {}
        self._responses: dict[str, Response] = {}
        largest: dict[str, float] = {}
        for group in self.groups:
            for curve in group.fitted + group.predicted:
                if curve.tool is None:
                    continue
                setup = self.setups[curve.id] = setup_of(curve, self.poisson, self.refinement)
                setup.tables(1.0, 0.0)
                # where forces are imposed, the model may sink in deeper than what was measured
                beyond = BEYOND if curve.tool.control == "force" else 1.0
                depth = beyond * float(curve.displacement_m[: group.rows[curve.id]].max())
                largest[setup.key] = max(largest.get(setup.key, 0.0), depth)
        self._largest = largest
        self.other_runs = 0

    @property
    def runs(self) -> int:
        """Simulations so far."""
        return self.other_runs + sum(response.runs for response in self._responses.values())

    def compile(self) -> None:
        """Have the machine code ready before anything is timed."""
        for setup in list(self.setups.values())[:1]:
            setup.relaxation(1.0, 0.0)

    def response(self, curve: Curve) -> Response:
        if curve.tool is None:
            kind: Literal["uniaxial", "shear"] = "shear" if curve.kind == "shear" else "uniaxial"
            return self._responses.setdefault(kind, PointResponse(kind, self.poisson))
        key = self.setups[curve.id].key
        if key not in self._responses:
            setup = self.setups[curve.id]
            self._responses[key] = UniformResponse(setup) if is_uniform(setup) else ToolResponse(setup, self._largest[key])
        return self._responses[key]

    def observed(self, curve: Curve, rows: int) -> Observed:
        by_force = curve.tool is not None and curve.tool.control == "force"
        return Observed(
            id=curve.id,
            imposed=programme_of(curve)[:rows],
            measured=curve.columns[curve.predicted][:rows],
            imposed_sd=sd_of(curve, curve.imposed),
            measured_sd=sd_of(curve, curve.predicted),
            model=CurveModel(self.response(curve), by_force),
        )

    def runs_planned(self, groups: Sequence[Group], method: str) -> int:
        """Runs that a usual identification takes."""
        count = 0
        for group in groups:
            tools = {self.setups[c.id].key for c in group.fitted if c.tool is not None}
            if tools:
                first = group.fitted[0]
                meshed = {self.setups[c.id].key for c in group.fitted if c.tool is not None and not is_uniform(self.setups[c.id])}
                count += 2 + len(alternatives(self.setups[first.id], first)) + 5 * len(meshed) + 8 * (method == "paper")
        everything = {s.key for s in self.setups.values() if not is_uniform(s)}
        return count + len(FIRST_Q) * len(everything)


def _identify(group: Group, tests: _Tests, method: str, work: _Work) -> tuple[dict[str, Any], dict[str, Any]]:
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
    curves = _curve_rows(group, observed, predicted, constants)
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
        "constants": _constants(fit, paper),
        "correlation": fit.correlation if paper is None else None,
        "at_bound": list(fit.at_bound if paper is None else ["C20_Pa"] * (paper.status == "bound")),
        "chi2": fit.chi2 if paper is None and not fit.noise_estimated else None,
        "degrees_of_freedom": fit.count - 2 + len(fit.at_bound),
        "rows": fit.count,
        "noise": "estimated from the residual" if fit.noise_estimated else "as the dataset states it",
        "noise_sd": scale * _rms(np.concatenate(fit.sds)),
        "numerical_sd": scale * _numerical(observed, constants),
        "interpolation_error": interpolation,
        "unit": unit,
        "error": {side: _mean_errors(curves, side) for side in ("fit", "holdout")},
        "curves": curves,
        "assumed": sorted({text for c in group.fitted if c.tool is not None for text in tests.setups[c.id].assumed})
        + [f"Poisson's ratio {tests.poisson:g}"],
        "hides": [_hidden_row(h, scale) for h in hidden],
    }
    if paper is not None:
        summary["paper"] = _paper_rows(paper, loads, measured)
    summary["warnings"] = _warnings(group, observed, fit, summary, hidden, constants, unit, scale)
    pictures = _pictures(group, tests, observed, predicted, fit, constants, paper, loads, measured)
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


def _constants(fit: Fit, paper: PaperFit | None) -> dict[str, Any]:
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


def _curve_rows(
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


def _mean_errors(curves: dict[str, dict[str, Any]], side: str) -> dict[str, float] | None:
    rows = [row for row in curves.values() if row["split"] == side]
    if not rows:
        return None
    return {"nrmse": float(np.mean([r["nrmse"] for r in rows])), "rmse": float(np.mean([r["rmse"] for r in rows]))}


def _numerical(observed: Sequence[Observed], constants: np.ndarray) -> float:
    """Rms numerical noise of the predictions, SI."""
    parts = []
    for o in observed:
        value, slope = o.model.with_slope(o.imposed, *map(float, constants))
        # the roughness is one of forces
        in_force = np.abs(o.imposed * slope) if o.model.by_force else np.abs(value)
        parts.append(o.model.response.roughness * in_force)
    return _rms(np.concatenate(parts))


def _paper_rows(paper: PaperFit, loads_N: np.ndarray, measured_m: np.ndarray) -> dict[str, Any]:
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


def _hidden_row(hidden: Hidden, scale: float) -> dict[str, Any]:
    if hidden.change is None:
        return {"if": hidden.name, "problem": hidden.problem}
    return {
        "if": hidden.name,
        "C10_change": float(hidden.change[0]),
        "C20_change": float(hidden.change[1]),
        "left": scale * hidden.left,
        "left_in_noise": hidden.left_in_noise,
    }


def _warnings(
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


def _overall_warnings(dataset: Dataset, groups: Sequence[Group], left_out: dict[str, str], failures: dict[str, str]) -> list[str]:
    words = [f'Curve "{name}" is left out, {why}.' for name, why in left_out.items()]
    if not any(group.predicted for group in groups):
        words.append("Every curve is fitted: nothing shows whether the constants predict what they were not fitted to.")
    words += [f'Constants "{name}" failed: {message}' for name, message in failures.items()]
    return words


# ---- pictures: numbers only ----


def _pictures(
    group: Group,
    tests: _Tests,
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


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
