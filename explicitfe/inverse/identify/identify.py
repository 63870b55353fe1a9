"""``explicitfe identify``: constants of a material law from measured curves, with their uncertainty and sensitivity."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from explicitfe.fem.materials.homogeneous import INCOMPRESSIBLE
from explicitfe.inverse.identify.assumptions import Hidden, alternatives, effect_by_refit, what_a_fit_hides
from explicitfe.inverse.identify.compare_laws import (
    LawFit,
    compared,
    fit_stable,
    held_out_error,
    model_form_factor,
    range_test,
    stretches_in_data,
)
from explicitfe.inverse.identify.fit import Fit, Problem, least_squares_fit, with_intervals
from explicitfe.inverse.identify.forward import FIRST_Q, CurveModel, PointResponse, ToolResponse, ratio
from explicitfe.inverse.identify.forward_models import POISSON_OF_ELEMENTS, ForwardModels
from explicitfe.inverse.identify.group_fit import GroupFit
from explicitfe.inverse.identify.laws import ALL, YEOH, FitLaw, requested_laws
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.identify.paper import PaperFit, by_simulator, first_guess, force_steps, identify_by_paper
from explicitfe.inverse.identify.pictures import GroupPictures, pictures_of
from explicitfe.inverse.identify.summary import group_rows
from explicitfe.inverse.identify.warnings import dataset_warnings
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.select import Group, select
from explicitfe.inverse.predict.setup import Setup
from explicitfe.platform.errors import InputError, Progress, RunError, Share, nearest, shortened, silent
from explicitfe.platform.host.compilation import announcing
from explicitfe.results.documents.identification import Identification, IdentifiedGroup

METHODS = ("least-squares", "paper")
LARGEST_POISSON_OF_ELEMENTS = 0.4995  # Towards 0.5 the bulk modulus grows without limit.
REFINEMENT_LIMITS = (0.2, 4.0)

# Three runs around the estimate of q = C20 / (C10 + C20) reach so many standard deviations to either side, within these limits:
# nearer they would be one run, farther the response is not smooth enough for a spline.
WINDOW_SDS = 4.0
WINDOW_LIMITS_Q = (0.05, 0.3)
# The response gets another run at the optimum while it deviates from the last run there by more than this share of the force, but
# no more than so many runs.
INTERPOLATION_ERROR_SHARE = 5e-4
MOST_CHECKING_RUNS = 4
# Near the end of what was planned, progress goes on ever more slowly, as more runs may be needed; the last part is for writing.
STEADY_PROGRESS_SHARE = 0.9
LARGEST_PROGRESS_SHARE = 0.98


def identify_constants(
    dataset: Path | str,
    *,
    law: str | None = None,
    method: str = "least-squares",
    fit: Sequence[str] = (),
    constants_by: str | None = None,
    poisson: float | None = None,
    refinement: float = 1.5,
    progress: Progress = silent,
) -> tuple[Identification, dict[str, GroupPictures]]:
    """Identify the constants of a material law for each group of curves of a dataset; see :func:`explicitfe.identify`.

    Returns
    -------
    identification : the document.
    pictures : what the pictures of each group show.
    """
    begin = time.perf_counter()
    if method not in METHODS:
        raise InputError(f"`method` {shortened(method)}: {nearest(method, METHODS)}")
    if poisson is not None and not 0.0 <= poisson <= INCOMPRESSIBLE:
        raise InputError(f"`poisson` {poisson:g}: the value must lie between 0 and {INCOMPRESSIBLE:g}, which is incompressible.")
    if not REFINEMENT_LIMITS[0] <= refinement <= REFINEMENT_LIMITS[1]:
        raise InputError(f"`refinement` {refinement:g}: the value must lie between 0.2 and 4.")
    if method == "paper" and law not in (None, YEOH.name):
        raise InputError(f"`law` {shortened(law)}: the paper's method identifies Yeoh constants only; omit `law` or `method`.")
    requested_laws(law, homogeneous=True)
    data = read_dataset(dataset).specimens("constants are identified from", several=True)
    if constants_by is not None:
        data = data.regrouped(constants_by)
    groups, left_out = select(data, fit)
    if poisson is not None and poisson > LARGEST_POISSON_OF_ELEMENTS and any(c.tool for group in groups for c in group.fitted):
        raise InputError(f"`poisson` {poisson:g}: elements under a tool need a value of at most {LARGEST_POISSON_OF_ELEMENTS:g}.")
    models = ForwardModels(groups, poisson, refinement)
    laws = [YEOH] if method == "paper" else requested_laws(law, homogeneous=models.homogeneous)
    if method == "paper":
        for group in groups:
            if any(curve.fit_contact for curve in group.fitted):
                raise InputError('the paper\'s method does not fit the contact; remove contact = "fit" of [[curve]].')
            force_steps(group.fitted, group.rows)
    if models.setups:  # Tests of a point need no kernels.
        progress("load", 0.0)
        with announcing("indentation tests"):
            models.compile([chosen for chosen in laws if law in (ALL, chosen.name)] or laws[:1])
        progress("load", 1.0)
    work = _Work(progress, models.runs_planned(groups, method, laws))

    rows: dict[str, IdentifiedGroup] = {}
    pictures: dict[str, GroupPictures] = {}
    failures: dict[str, str] = {}
    for group in groups:
        try:
            fitted = _fit_group(group, models, method, laws, work, best=law == ALL)
        except RunError as error:
            failures[group.name] = str(error)
            rows[group.name] = {"status": "failed", "message": str(error), "warnings": []}
            continue
        rows[group.name] = group_rows(fitted, models.assumed(group), models.reported_poisson)
        setup = models.setups.get(group.fitted[0].id) if fitted.fit.law.in_elements else None
        setup = setup if setup is not None and _elements_accept(setup, fitted.fit) else None
        pictures[group.name] = pictures_of(fitted, None if setup is None else replace(setup, law=fitted.fit.law.key))
        work.done()
    if len(failures) == len(groups):
        name, message = next(iter(failures.items()))
        raise RunError(message if len(groups) == 1 else f'constants "{name}" and all others: {message}')
    identification: Identification = {
        "dataset": data.name,
        "title": data.title,
        "path": str(data.path),
        "test": data.test,
        "method": method,
        "law": law or YEOH.name,
        "poisson": models.reported_poisson,
        "refinement": refinement,
        "groups": rows,
        "left_out": left_out,
        "forward_runs": models.runs,
        "warnings": dataset_warnings(data, groups, left_out, failures),
        "wall_s": 0.0,
        "files": [],
    }
    identification["wall_s"] = time.perf_counter() - begin
    progress("identify", 1.0)
    return identification, pictures


class _Work:
    """The share of the planned forward runs that is done; it never falls, though more runs may be needed than planned."""

    def __init__(self, progress: Progress, planned: int) -> None:
        self._progress, self._planned = progress, max(planned, 1)
        self._done = 0.0
        self._shown = 0.0

    def running(self, share: float) -> None:
        """Show the share of a run that has begun."""
        self._show(self._done + share)

    def done(self, runs: float = 1.0) -> None:
        """Count finished runs."""
        self._done += runs
        self._show(self._done)

    def within(self, runs: int) -> Callable[[float], None]:
        """Progress of several runs that report as one."""
        start = self._done

        def progress(share: float) -> None:
            self._done = start + share * runs
            self._show(self._done)

        return progress

    def _show(self, done: float) -> None:
        share, steady = done / self._planned, STEADY_PROGRESS_SHARE
        if share >= steady:
            share = 1.0 - (1.0 - steady) * float(np.exp(-(share - steady) / (1.0 - steady)))
        self._shown = max(self._shown, LARGEST_PROGRESS_SHARE * share)
        self._progress("identify", Share(self._shown, f"step {min(int(done) + 1, self._planned)} of about {self._planned}"))


def _fit_group(group: Group, models: ForwardModels, method: str, laws: Sequence[FitLaw], work: _Work, *, best: bool) -> GroupFit:
    """Fit one group by a method, compare the laws, and vary the assumptions.

    Parameters
    ----------
    laws : the laws to fit; the first one is reported, or with ``best`` the one with the lowest AICc.

    Raises
    ------
    RunError : the simulator or the method failed; that says nothing about the tissue.
    """
    errors: dict[str, float] = {}
    candidates = compared([_fit_law(group, models, law, work, errors) for law in laws])
    # Of two laws with equal criteria the one with fewer constants, which stands first.
    chosen = min(candidates, key=lambda row: row.aicc) if best else candidates[0]
    if chosen.fit is None:
        raise RunError(chosen.problem)
    observed, fit, law = chosen.observed, chosen.fit, chosen.fit.law
    predicted = [models.observed(curve, group.rows[curve.id], law) for curve in group.predicted]
    paper: PaperFit | None = None
    loads_N, measured_m = np.zeros(0), np.zeros(0)
    if method == "paper":
        loads_N, measured_m = force_steps(group.fitted, group.rows)
        paper = _paper_fit(group, models, work, loads_N, measured_m)
    test = range_test(observed, fit)
    fit = with_intervals(observed, fit, model_form_factor(fit, candidates, test) if paper is None else 1.0)
    for response in _tool_responses(predicted):
        response.add([*FIRST_Q, ratio(*fit.constants)], work.within(1))
    error = errors.get(law.name, 0.0)
    fitted = GroupFit(group, observed, predicted, fit, error, candidates, test, paper, loads_N, measured_m)
    first = next((curve for curve in group.fitted if curve.tool is not None), None)
    if not law.in_elements:
        return fitted
    hidden = _without_runs(group, models, observed, fit) if paper is None else []
    if first is None:
        return replace(fitted, hidden=hidden)
    # Alternatives are those of the first curve's test, so only curves of this test can show their effect.
    setup = models.setups[first.id]
    if not _elements_accept(setup, fit):
        return replace(fitted, hidden=hidden)
    alike = [n for n, curve in enumerate(group.fitted) if curve.tool is not None and models.setups[curve.id].key == setup.key]
    others = [n for n in range(len(observed)) if n not in alike]
    beside = Problem([observed[n] for n in others], [fit.sds[n] for n in others], law) if others else None
    fit_of_alike = replace(fit, constants=fitted.constants, sds=tuple(fit.sds[number] for number in alike))
    simulated, runs = what_a_fit_hides(
        setup, [observed[number] for number in alike], fit_of_alike, alternatives(setup, first), work.done, beside
    )
    models.other_runs += runs
    return replace(fitted, hidden=[*simulated, *hidden])


def _elements_accept(setup: Setup, fit: Fit) -> bool:
    """Whether elements accept the law with these constants."""
    try:
        replace(setup, law=fit.law.key).tables(*map(float, fit.constants))
    except ValueError:
        return False
    return True


def _without_runs(group: Group, models: ForwardModels, observed: Sequence[Observed], fit: Fit) -> list[Hidden]:
    """Effect of the assumptions that need no simulations: the contact at displacement 0, and an incompressible closed form."""
    hidden = []
    tools = [None if curve.tool is None else curve.tool.shape for curve in group.fitted]
    touching = [
        replace(o, contact_m=0.0) if shape not in (None, "bonded-disc") and o.contact_m is None else o
        for o, shape in zip(observed, tools, strict=True)
    ]
    if any(other is not o for other, o in zip(touching, observed, strict=True)):
        hidden.append(effect_by_refit("a fitted contact instead of contact at 0", observed, touching, fit, left_open=True))
    if models.poisson is None and None in tools:
        softer = [
            replace(o, model=CurveModel(PointResponse(o.model.response.kind, POISSON_OF_ELEMENTS, fit.law)))
            if isinstance(o.model.response, PointResponse)
            else o
            for o in observed
        ]
        hidden.append(effect_by_refit(f"Poisson's ratio {POISSON_OF_ELEMENTS:g}", observed, softer, fit, left_open=False))
    return hidden


def _fit_law(group: Group, models: ForwardModels, law: FitLaw, work: _Work, errors: dict[str, float]) -> LawFit:
    """Fit one law to a group; ``errors`` receives the interpolation error of its responses."""
    observed = [models.observed(curve, group.rows[curve.id], law) for curve in group.fitted]
    try:
        responses = _tool_responses(observed)
        for response in responses:
            response.add(FIRST_Q, work.within(len(FIRST_Q)))
        if responses:
            fit, errors[law.name] = _least_squares(observed, law, work)
            loss = None  # Constants under a tool are not negative.
        else:
            work.done()
            fit, loss = fit_stable(observed, law, models.of_closed_forms, stretches_in_data(observed))
        return LawFit(law, observed, fit, held_out=held_out_error(observed, fit.law), loss=loss)
    except RunError as error:
        return LawFit(law, observed, None, str(error))


def _paper_fit(group: Group, models: ForwardModels, work: _Work, loads_N: np.ndarray, measured_m: np.ndarray) -> PaperFit:
    """The paper's iteration; see :func:`identify_by_paper`."""
    setup = models.setups[group.fitted[0].id]
    if any(models.setups[curve.id].key != setup.key for curve in group.fitted):
        raise InputError("the paper's method needs curves of one test; choose them by `fit`.")
    start = first_guess(setup, loads_N[0], measured_m[0])
    fit = identify_by_paper(by_simulator(setup, loads_N), measured_m, start, progress=lambda runs: work.done())
    models.other_runs += len(fit.trace)
    if fit.status == "not-converged":
        raise RunError(
            f"the paper's iteration did not converge in {len(fit.trace)} runs: at the largest load it misses by "
            f"{1e6 * fit.errors_m[-1]:+.0f} µm; take `method` least-squares."
        )
    return fit


def _least_squares(observed: Sequence[Observed], law: FitLaw, work: _Work) -> tuple[Fit, float]:
    """Fit by least squares, with simulator runs where the response needs them.

    Returns
    -------
    fit : the constants, without profile intervals.
    interpolation_error : deviation of the interpolated response from the last run, relative to the force.
    """
    responses = _tool_responses(observed)
    fit = least_squares_fit(observed, law=law, profile=False)
    if len(law.constants) == 1:  # The ratio is 0, for which there is a run.
        return fit, 0.0
    q = ratio(*fit.constants)
    # With s = C20 / C10, dq = (1 - q)^2 ds.
    s = fit.constants[1] / fit.constants[0]
    gradient = np.array([-s, 1.0]) / fit.constants[0]
    spread = WINDOW_SDS * (1.0 - q) ** 2 * float(np.sqrt(max(gradient @ fit.covariance @ gradient, 0.0)))
    window = float(np.clip(spread, *WINDOW_LIMITS_Q))
    for response in responses:
        response.add([q - window, q, q + window], work.within(3))
    error = 0.0
    for _ in range(MOST_CHECKING_RUNS):
        fit = least_squares_fit(observed, fit.constants, law=law, profile=False)
        error = max(response.check(ratio(*fit.constants), work.running) for response in responses)
        work.done()
        if error < INTERPOLATION_ERROR_SHARE:
            break
    return least_squares_fit(observed, fit.constants, law=law, profile=False), error


def _tool_responses(observed: Sequence[Observed]) -> list[ToolResponse]:
    """The responses that run the simulator, each once."""
    return list({id(r): r for o in observed if isinstance(r := o.model.response, ToolResponse)}.values())
