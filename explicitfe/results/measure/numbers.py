"""Measures under dotted names, such as ``points.tip.up_mm``: columns of sweeps, and expected results of scenarios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from explicitfe.platform.host.nested import leaves
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result
from explicitfe.results.measure.document import Airway
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.steps import step_at

Number = float | int | bool | None


def flat(value: object, name: str = "") -> dict[str, Number]:
    """The numbers of measures under dotted names, formants as ``F1_hz`` and so on; other lists and texts are omitted."""
    numbers = {key: number for key, number in leaves(value, name, with_lists=False) if isinstance(number, Number)}
    airway = value if isinstance(value, Airway) else getattr(value, "airway", None)
    for k, formant in enumerate(airway.formants if isinstance(airway, Airway) else (), 1):
        numbers[f"{name or 'airway'}.formants.F{k}_hz"] = formant.frequency_hz
    return numbers


def numbers_of_curve(curve: Sequence[Mapping[str, Any]]) -> dict[str, Number]:
    """Force and displacement at each load of an indentation that was reached; the first load is number 1."""
    return {f"load.{k}.{key}": point[key] for k, point in enumerate(curve, 1) for key in point}


def numbers_at(result: Result, time_s: float | None = None, formants: bool = False) -> dict[str, Number]:
    """All numbers of a result: measures of a run in time at the sample nearest to ``time_s``, or the curve of an indentation.

    Raises
    ------
    InputError : see :func:`explicitfe.results.measure.measure.measure`.
    """
    if kind_of(result.model) != "transient":
        return numbers_of_curve(result.summary.get("curve", ()))
    return flat(measures_of(result, step_at(result, time_s), formants))
