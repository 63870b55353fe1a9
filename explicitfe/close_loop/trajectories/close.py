"""The loop closed on sensors of a moving tongue; what is found is written back as a scenario."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from explicitfe.close_loop.report import failed, mean_errors, told
from explicitfe.close_loop.search import close
from explicitfe.close_loop.split import Split
from explicitfe.close_loop.statistics.refit import Fitted
from explicitfe.close_loop.trajectories.levers import LEVERS
from explicitfe.close_loop.trajectories.trajectories import Trajectories, trajectory_system
from explicitfe.errors import InputError, RunError
from explicitfe.measured.curve import Dataset
from explicitfe.results import provenance

Told = tuple[dict[str, Any], list[dict[str, Any]], dict[str, str]]
MM = 1e3


def close_trajectories(
    dataset: Dataset,
    sides: Split,
    effects: Sequence[str],
    max_effects: int,
    processes: int | None,
    progress: Callable[[str, float], None],
) -> Told:
    """The report, curves for its pictures, and the scenarios before and after.

    Raises
    ------
    InputError : no scenario to compare with, or one that cannot be used.
    """
    if dataset.scenario is None:
        raise InputError(f"{dataset.path}: without a scenario there is nothing to compare with; add the key scenario.")
    system = trajectory_system(dataset, sides.fit, processes or 1, only=tuple(effects))
    head = {
        "dataset": dataset.name,
        "title": dataset.title,
        "unit": "mm",
        "split": {
            "fit": [c.id for c in sides.fit],
            "holdout": [c.id for c in sides.holdout],
            "left_out": sides.left_out,
            "rule": sides.rule,
        },
        "provenance": provenance()
        | {"dataset": str(dataset.path), "source": dataset.source, "scenario": str(dataset.scenario)}
        | {"effects_considered": list(effects) or list(LEVERS), "max_effects": max_effects},
    }
    progress("trace", 0.0)
    try:
        closed = close(
            system,
            max_effects=max_effects,
            rows=system.rows,
            single=len(sides.fit) == 1,
            watch=lambda what, share: progress("trace", share),
        )
        progress("trace", 1.0)
        with_effects = closed.verdict in ("effect-found", "ambiguous") and bool(closed.effects)
        last = closed.steps[-1] if with_effects else closed.steps[0]
        before, after = closed.steps[0].fit, last.fit
        found = head | told(closed, before, after, last)
        progress("predict", 0.0)
        curves = _errors(found, system, sides, before, after)
    except RunError as error:
        return head | failed(str(error)), [], {}
    finally:
        system.runs.close()
    progress("predict", 1.0)
    found["effect_titles"] |= {name: LEVERS[name].title.partition(" [")[0] for name in found["effect_titles"] if name in LEVERS}
    found |= {"next_experiment": None, "sensitivity_to_assumed": {}, "warnings": _warnings(sides, before, after)}
    texts = {"scenario.toml": system.scenario_text(after.model), "baseline.toml": system.scenario_text(before.model)}
    return found, curves, texts


def _errors(found: dict[str, Any], system: Trajectories, sides: Split, before: Fitted, after: Fitted) -> list[dict[str, Any]]:
    """Rms over the sensors of each curve, before and after; for the picture the coordinate that moves most."""
    every = system.for_curves((*sides.fit, *sides.holdout))
    split = {c.id: "holdout" for c in sides.holdout} | {c.id: "fit" for c in sides.fit}
    answers = dict(zip(("baseline", "final"), every.answers([before.model, after.model]), strict=True))
    noise = {one.id: float(row.sd.mean()) for one, row in zip(every.series, every.rows, strict=True)}
    shown: dict[str, dict[str, Any]] = {}
    for side, answer in answers.items():
        if answer is None:
            raise RunError("a curve cannot be computed with the model that was found.")
        rows: dict[str, dict[str, Any]] = {}
        for curve in split:
            mine = [(one, y) for one, y in zip(every.series, answer, strict=True) if one.curve == curve]
            rest = np.concatenate([MM * (y - one.measured) for one, y in mine])
            largest = max(MM * float(np.ptp(one.measured)) for one, _ in mine)
            rmse = float(np.sqrt(np.mean(rest**2)))
            floor = MM * float(np.sqrt(np.mean([noise[one.id] ** 2 for one, _ in mine])))
            rows[curve] = {"split": split[curve], "rmse": rmse, "nrmse": rmse / largest, "floor": floor / largest}
            most, predicted = max(mine, key=lambda pair: float(np.ptp(pair[0].measured)))
            here = shown.setdefault(
                curve,
                {
                    "id": f"{curve}, {most.id.removeprefix(curve).strip(' /:-')}",
                    "split": split[curve],
                    "x_label": "time (s)",
                    "y_label": "position (mm)",
                    "time_s": most.time_s,
                    "x": most.time_s,
                    "measured": MM * most.measured,
                    "sd": np.full(len(most.measured), floor),
                },
            )
            here["before" if side == "baseline" else "after"] = MM * predicted
        found[side]["error"] = {name: mean_errors(rows, name) for name in ("fit", "holdout")} | {"curves": rows}
    return list(shown.values())


def _warnings(sides: Split, before: Fitted, after: Fitted) -> list[str]:
    notes = []
    for when, fit in (("before", before), ("after", after)):
        if fit.at_bound:
            notes.append(
                f"{when}: {', '.join(dict.fromkeys(fit.at_bound))} ended at a bound: the data want more, or do not care."
            )
    if not sides.holdout:
        notes.append("no curve is held out: errors are those of curves that were fitted.")
    if len(sides.fit) == 1:
        notes.append("one curve only: nothing that it shows can be confirmed by another, so no effect is claimed.")
    return notes
