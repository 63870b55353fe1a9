"""Sensitivity analysis of a sweep: Sobol indices and elementary effects with bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from typing_extensions import TypedDict

from explicitfe.platform.errors import InputError
from explicitfe.results.files import FINISHED
from explicitfe.simulate.sweep.factors import Factor
from explicitfe.simulate.sweep.journal import Stored
from explicitfe.simulate.sweep.members import MORRIS_LEVELS, Members, problem_of
from explicitfe.simulate.sweep.rows import BESIDE_THE_TABLE, NUMBER, STATUS, number_of

CONFIDENCE_SHARE = 0.95
RESAMPLES_COUNT = 1000  # of the bootstrap that gives the intervals
SMALLEST_SPREAD_SHARE = 1e-9  # of a measure's size: what varies less does not vary
ABOUT_THE_RUN = (*BESIDE_THE_TABLE, "steps", "iterations", "energy_balance_error", "warnings")


class Index(TypedDict):
    """The index of one factor for one measure, and half the width of its 95 % interval."""

    factor: str
    value: float
    half_width: float


class MeasureSensitivity(TypedDict):
    """One measure: ``total`` and ``first`` are Sobol indices; ``effect`` the mean absolute elementary effect (Morris's mu*).

    An elementary effect is the change of the measure, in its unit, per range of the factor.
    """

    measure: str
    mean: float
    spread: float
    first: list[Index]
    total: list[Index]
    effect: list[Index]


class Sensitivity(TypedDict):
    """The file ``sensitivity.json``. ``members_used`` counts the runs used; a group with a failed run is omitted as a whole."""

    method: str
    members_used: int
    members_left_out: int
    measures: list[MeasureSensitivity]


def sensitivity_of(design: str, factors: Sequence[Factor], members: Members, stored: Stored, seed: int) -> Sensitivity:
    """Compute the indices of all measures that vary.

    A design consists of groups: factors + 2 runs of Saltelli's (2010), factors + 1 of a trajectory of Morris (1991). If a
    run of a group failed or lacks a measure, the group is omitted for that measure.

    Raises
    ------
    InputError : fewer than two groups are complete.
    """
    size = len(factors) + (2 if design == "sobol" else 1)
    groups = np.arange(len(members)).reshape(-1, size)
    finished = np.zeros(len(members), dtype=bool)
    columns: dict[str, np.ndarray] = {}
    for row in stored.rows():
        number = number_of(row)
        finished[number] = row[STATUS] == FINISHED
        for name, cell in row.items():
            if isinstance(cell, (int, float)) and not isinstance(cell, bool) and name not in (NUMBER, *ABOUT_THE_RUN):
                columns.setdefault(name, np.full(len(members), np.nan))[number] = cell
    whole = finished[groups].all(axis=1)
    if np.count_nonzero(whole) < 2:
        raise InputError(
            "a sensitivity analysis needs at least two groups in which all runs finished. Their messages in table.csv name the "
            "causes of failure: narrow the ranges of --vary, or add --retry failed."
        )
    problem = problem_of(factors, f"--{design}")
    inputs = np.array([members.values[number] for number in range(len(members))], dtype=float)
    measures = []
    for name, values in columns.items():
        usable = groups[whole & np.isfinite(values)[groups].all(axis=1)]
        y = values[usable.ravel()]
        if len(usable) < 2 or not np.std(y) > SMALLEST_SPREAD_SHARE * max(np.abs(y).max(initial=0.0), SMALLEST_SPREAD_SHARE):
            continue
        analyse = _sobol if design == "sobol" else _morris
        entry: MeasureSensitivity = {
            "measure": name, "mean": float(y.mean()), "spread": float(y.std()), "first": [], "total": [], "effect": [],
        }  # fmt: skip
        measures.append(entry | analyse(problem, inputs[usable.ravel()], y, seed))
    used = int(np.count_nonzero(whole)) * size
    return {"method": design, "members_used": used, "members_left_out": len(members) - used, "measures": measures}  # type: ignore[typeddict-item]


def _sobol(problem: dict[str, Any], inputs: np.ndarray, y: np.ndarray, seed: int) -> dict[str, list[Index]]:
    from SALib.analyze import sobol

    answer = sobol.analyze(
        problem, (y - y.mean()) / y.std(), calc_second_order=False, num_resamples=RESAMPLES_COUNT, conf_level=CONFIDENCE_SHARE,
        seed=seed,
    )  # fmt: skip
    return {
        "first": _indices(problem, answer["S1"], answer["S1_conf"]),
        "total": _indices(problem, answer["ST"], answer["ST_conf"]),
    }


def _morris(problem: dict[str, Any], inputs: np.ndarray, y: np.ndarray, seed: int) -> dict[str, list[Index]]:
    from SALib.analyze import morris

    answer = morris.analyze(
        problem, inputs, y, num_levels=MORRIS_LEVELS, num_resamples=RESAMPLES_COUNT, conf_level=CONFIDENCE_SHARE, scaled=False,
        seed=seed,
    )  # fmt: skip
    return {"effect": _indices(problem, answer["mu_star"], answer["mu_star_conf"])}


def _indices(problem: dict[str, Any], values: Sequence[float], half_widths: Sequence[float]) -> list[Index]:
    return [
        {"factor": name, "value": float(value), "half_width": float(half)}
        for name, value, half in zip(problem["names"], values, half_widths, strict=True)
    ]
