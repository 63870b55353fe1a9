"""Going on with a run that was stopped or killed, from the newest state that its result file holds."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from explicitfe.compiled.simd import WIDTH
from explicitfe.errors import InputError, Progress, silent
from explicitfe.host import stopping
from explicitfe.results import RUNNING, RestartState, Result, open_result
from explicitfe.results.layout import running_path
from explicitfe.results.names import to_final
from explicitfe.results.provenance import provenance
from explicitfe.results.run_summary import RunSummary
from explicitfe.run.analysis import Analysis, Begun
from explicitfe.run.inputs import sums_of
from explicitfe.run.prepare import analysis_of
from explicitfe.scenario.read import kind_of
from explicitfe.scenario.sentences import explain
from explicitfe.scenario.table import validated
from explicitfe.solve.transient import FINISHED, INTERRUPTED

RUNNING_SUFFIX = ".running"
MOST_SHOWN_CHARACTERS = 60  # of a value in a sentence


class Resumed(NamedTuple):
    """A run that was gone on with: its analysis, for tables and pictures, and what it came to."""

    analysis: Analysis[Any, Any]
    summary: RunSummary


def resume(path: Path | str, *, overwrite: bool = False, threads: int | None = None, progress: Progress = silent) -> RunSummary:
    """Go on with the run of a result file that was stopped or killed; its end is bit for bit that of a run that was not.

    With another number of threads, or on another machine, it is the same up to rounding. A run that is finished stays as it is.

    Parameters
    ----------
    path : the result, or what is left of it: ``<scenario>.vtkhdf`` or ``<scenario>.running.vtkhdf``.
    overwrite : replace a finished result that stands where the run's own will stand.
    threads : that share a step from here on; as the scenario has it if left out.
    progress : called with the stage and the share of it that is done.

    Raises
    ------
    InputError : the file is no result, is being written, ended in a way that nothing follows, or its model cannot be built
        again as it was.
    """
    return resumed(path, overwrite=overwrite, threads=threads, progress=progress).summary


def resumed(path: Path | str, *, overwrite: bool = False, threads: int | None = None, progress: Progress = silent) -> Resumed:
    """What :func:`resume` does, with the analysis for whoever shows it."""
    begin = time.perf_counter()
    path = Path(path)
    with open_result(path) as result:
        analysis = replace(_analysis_of(result, threads), prepare_s=time.perf_counter() - begin)
        return _resumed(analysis, result, target_of(path), overwrite, progress)


def begun_at(target: Path) -> Path | None:
    """Where a run whose result is to be ``target`` was begun before: the file of a killed one, or else what stands there."""
    return next((path for path in (running_path(target), target) if path.exists()), None)


def go_on(analysis: Analysis[Any, Any], path: Path, *, overwrite: bool, progress: Progress) -> Resumed:
    """Go on with what ``path`` holds of the run that a scenario describes now.

    Raises
    ------
    InputError : as for :func:`resume`; or the file was begun with other values than the scenario has now.
    """
    with open_result(path) as result:
        before, now = (_without_threads(model["scenario"]) for model in (result.model, analysis.describe()))
        difference = _first_difference(before, now)
        if difference is not None:
            raise InputError(
                f"{path} was begun with other values: {difference}; leave --resume out and add --overwrite to begin anew, or "
                f"go on with what it is by 'explicitfe resume {path}'."
            )
        return _resumed(analysis, result, target_of(path), overwrite, progress)


def target_of(path: Path) -> Path:
    """What the result of a run is called in the end, given what it is called now."""
    return path.with_name(f"{path.stem.removesuffix(RUNNING_SUFFIX)}.vtkhdf") if path.stem.endswith(RUNNING_SUFFIX) else path


# ---- inside ----


def _resumed(analysis: Analysis[Any, Any], result: Result, target: Path, overwrite: bool, progress: Progress) -> Resumed:
    path = result.path
    if result.live:
        raise InputError(f"{path} is being written by another run; wait until that ends.")
    if result.status == FINISHED:
        summary: RunSummary = result.summary  # type: ignore[assignment]
        result.close()
        if path != target:  # killed after the last sample, before it got its name
            to_final(path, target, overwrite)
        return Resumed(analysis, summary)
    if result.status not in (RUNNING, INTERRUPTED):
        raise InputError(
            f"{path} ended with {result.status}, and nothing follows from there: {result.message or 'it says no more'} "
            "Change the scenario and run it anew."
        )
    if target != path and target.exists() and not overwrite:
        raise InputError(f"a result {target} exists where this run's own will stand; add --overwrite to replace it in the end.")
    _check_sameness(analysis, result)
    state = result.restart_state()
    begun = Begun(path, state, _rows_until(result, state))
    result.close()
    with stopping.watching():
        summary = analysis.run(target, overwrite=overwrite, progress=progress, begun=begun)
    return Resumed(analysis, summary)


def _analysis_of(result: Result, threads: int | None) -> Analysis[Any, Any]:
    """The analysis of a stored run, built anew from the scenario with all settings and defaults that the result holds."""
    model = result.model
    try:
        data = model["scenario"]
        if threads is not None:
            data["analysis"]["threads"] = threads
        path = Path(model["scenario_file"])
        scenario = validated(kind_of(data), data)
        notes = tuple(model["notes"])
    except (KeyError, TypeError):
        raise InputError(f"{result.path} does not hold what is needed to go on; run the scenario again.") from None
    except ValidationError as error:
        raise InputError(f"{result.path}: {explain(error, data, kind_of(data))}") from None
    return replace(analysis_of(path, scenario, result.scenario_text), notes=notes)


def _check_sameness(analysis: Analysis[Any, Any], result: Result) -> None:
    """InputError unless a run that goes on from here would be the one that was begun."""
    ours, theirs = provenance()["explicitfe"], result.provenance["explicitfe"]
    if ours != theirs:
        raise InputError(f"{result.path} was begun with explicitfe {theirs}, this is {ours}; run the scenario again.")
    mesh = analysis.model.mesh
    same = np.array_equal(mesh.points, result.mesh.points) and np.array_equal(mesh.hexes, result.mesh.hexes)
    if not same:
        raise InputError(f"{result.path} was begun on another mesh than {analysis.path} has now; run the scenario again.")
    sums = sums_of(analysis.path, analysis.scenario)
    changed = next((name for name, before in result.model.get("file_sums", {}).items() if sums.get(name) != before), None)
    if changed is not None:
        raise InputError(
            f"{changed}, which {analysis.path} names, is not what it was when {result.path} was begun; put it back, or "
            "run the scenario again."
        )
    state = result.restart_state()
    if state is not None and state.arrays["lanes"] != WIDTH:
        lanes = int(state.arrays["lanes"])
        raise InputError(
            f"{result.path} was begun with vectors of {lanes} lanes, here they have {WIDTH}; set EXPLICITFE_LANES={lanes}, "
            "or run the scenario again."
        )


def _rows_until(result: Result, state: RestartState | None) -> dict[str, np.ndarray]:
    """The history of the samples up to a state; empty where there is none."""
    count = 0 if state is None else int(state.arrays["samples"])
    return {name: result.history(name)[:count] for name in result.history_names}


def _without_threads(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """A scenario but for how many threads compute it: that may change on the way."""
    analysis = {key: value for key, value in scenario["analysis"].items() if key != "threads"}
    return {**scenario, "analysis": analysis}


def _first_difference(before: Any, now: Any, keys: str = "") -> str | None:
    """The first key whose values differ, with both, or None."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*before, *now]):
            inner = _first_difference(before.get(key), now.get(key), f"{keys}.{key}" if keys else str(key))
            if inner is not None:
                return inner
        return None
    if isinstance(before, list) and isinstance(now, list | tuple) and len(before) == len(now):
        differences = (_first_difference(b, n, f"{keys}.{k}") for k, (b, n) in enumerate(zip(before, now, strict=True)))
        return next((text for text in differences if text is not None), None)
    return None if before == now else f"{keys} was {_short(before)}, and is {_short(now)}"


def _short(value: object) -> str:
    text = "not given" if value is None else str(value)
    return text if len(text) <= MOST_SHOWN_CHARACTERS else f"{text[:MOST_SHOWN_CHARACTERS]}..."
