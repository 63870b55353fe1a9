"""Resuming an interrupted or killed run from the newest restart state in its result file."""

from __future__ import annotations

import shlex
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import validated
from explicitfe.fem.solve.transient import FINISHED, INTERRUPTED
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.errors import InputError, Progress, silent
from explicitfe.platform.host import stopping
from explicitfe.platform.host.result_files import final_path, find_result, running_path
from explicitfe.results.documents.run_summary import RunSummary
from explicitfe.results.files import RUNNING, RestartState, Result, open_result
from explicitfe.results.files.names import to_final
from explicitfe.results.files.provenance import provenance
from explicitfe.simulate.run.analysis import Analysis, Begun
from explicitfe.simulate.run.inputs import sums_of
from explicitfe.simulate.run.prepare import analysis_of
from explicitfe.simulate.scenario.read import kind_of

MOST_SHOWN_CHARACTERS = 60  # of a value in a sentence


def resume(path: Path | str, *, overwrite: bool = False, threads: int | None = None, progress: Progress = silent) -> RunSummary:
    """Resume an interrupted run; see :func:`explicitfe.resume`."""
    begin = time.perf_counter()
    path = find_result(Path(path), unfinished_first=True)
    with open_result(path) as result:
        analysis = replace(_analysis_of(result, threads), prepare_s=time.perf_counter() - begin)
        return _resume(analysis, result, overwrite, progress)


def stored_before(target: Path) -> Path | None:
    """The stored result of an earlier run with the same target: the unfinished one, or else the finished one; None without."""
    return next((path for path in (running_path(target), target) if path.exists()), None)


def resume_analysis(analysis: Analysis[Any, Any], path: Path, *, overwrite: bool, progress: Progress) -> RunSummary:
    """Resume the run stored in ``path`` for a scenario that has been read again.

    Raises
    ------
    InputError : as for :func:`resume`; or the stored run has other values than the scenario has now.
    """
    with open_result(path) as result:
        before, now = (_without_threads(model["scenario"]) for model in (result.model, analysis.describe()))
        difference = _first_difference(before, now)
        if difference is not None:
            raise InputError(
                f"cannot resume {path}, because the scenario has changed: {difference}. Use `overwrite` instead of `resume` to "
                f"start again, or 'explicitfe resume {shlex.quote(str(path))}' to continue with the stored values."
            )
        return _resume(analysis, result, overwrite, progress)


# ---- inside ----


def _resume(analysis: Analysis[Any, Any], result: Result, overwrite: bool, progress: Progress) -> RunSummary:
    path, target = result.path, final_path(result.path)
    if result.live:
        raise InputError(f"{path} is being written by another run; wait until it ends.")
    if result.status == FINISHED:
        summary: RunSummary = result.summary  # type: ignore[assignment]
        result.close()
        if path != target:  # killed between its last sample and its renaming
            to_final(path, target, overwrite)
        return summary
    if result.status not in (RUNNING, INTERRUPTED):
        raise InputError(
            f'{path} cannot be resumed, because its run failed ("{result.status}": {result.message or "no message is stored."}) '
            "Change the scenario and run it again."
        )
    if target != path and target.exists() and not overwrite:
        raise InputError(f"a finished result {target} exists; add `overwrite` to replace it when this run has finished.")
    _check_sameness(analysis, result)
    state = result.restart_state()
    begun = Begun(path, state, _rows_until(result, state))
    result.close()
    with stopping.watching():
        return analysis.run(target, overwrite=overwrite, progress=progress, begun=begun)


def _analysis_of(result: Result, threads: int | None) -> Analysis[Any, Any]:
    """The analysis of a stored run, built again from the scenario with all settings and defaults in the result."""
    model = result.model
    try:
        data = model["scenario"]
        if threads is not None:
            data["analysis"]["threads"] = threads
        path = Path(model["scenario_file"])
        scenario = validated(kind_of(data), data)
        notes = tuple(model["notes"])
    except (KeyError, TypeError):
        raise InputError(f"{result.path} lacks the data that are needed to resume; run the scenario again.") from None
    except ValidationError as error:
        raise InputError(f"{result.path}: {explain(error, data, kind_of(data))}") from None
    return replace(analysis_of(path, scenario, result.scenario_text), notes=notes)


def _check_sameness(analysis: Analysis[Any, Any], result: Result) -> None:
    """InputError unless the resumed run would be identical to an uninterrupted one."""
    begin = f"{result.path} cannot be resumed"
    ours, theirs = provenance()["explicitfe"], result.provenance["explicitfe"]
    if ours != theirs:
        raise InputError(f"{begin}: it was started with explicitfe {theirs}, this is {ours}; run the scenario again.")
    mesh = analysis.model.mesh
    same = np.array_equal(mesh.points, result.mesh.points) and np.array_equal(mesh.hexes, result.mesh.hexes)
    if not same:
        raise InputError(f"{begin}: the mesh of {analysis.path} has changed since the run was started; run the scenario again.")
    sums = sums_of(analysis.path, analysis.scenario)
    changed = next((name for name, before in result.model.get("file_sums", {}).items() if sums.get(name) != before), None)
    if changed is not None:
        raise InputError(
            f"{begin}: {changed}, which {analysis.path} refers to, has changed since the run was started; restore the file, or "
            "run the scenario again."
        )
    state = result.restart_state()
    if state is not None and state.arrays["lanes"] != WIDTH:
        lanes = int(state.arrays["lanes"])
        raise InputError(
            f"{begin}: it was started with SIMD vectors of {lanes} lanes, here they have {WIDTH}; set EXPLICITFE_LANES={lanes}, "
            "or run the scenario again."
        )


def _rows_until(result: Result, state: RestartState | None) -> dict[str, np.ndarray]:
    """The history of the samples up to a state; empty where there is none."""
    count = 0 if state is None else int(state.arrays["samples"])
    return {name: result.history(name)[:count] for name in result.history_names}


def _without_threads(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """A scenario without its number of threads, which may differ after a restart."""
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
        differences = (_first_difference(b, n, f"{keys}[{k}]") for k, (b, n) in enumerate(zip(before, now, strict=True), 1))
        return next((text for text in differences if text is not None), None)
    return None if before == now else f"{keys} was {_short(before)} and is now {_short(now)}"


def _short(value: object) -> str:
    text = "not given" if value is None else str(value)
    return text if len(text) <= MOST_SHOWN_CHARACTERS else f"{text[:MOST_SHOWN_CHARACTERS]}..."
