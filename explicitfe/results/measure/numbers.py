"""Measures under dotted names, such as ``points.tip.up_mm``: columns of sweeps, and expected results of scenarios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result
from explicitfe.results.measure.document import FormantFigures
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.steps import step_at

Number = float | int | bool | None


def flat(value: object, name: str = "") -> dict[str, Number]:
    """The numbers of nested tables under dotted names, formants as ``F1_hz`` and so on; other lists and texts are omitted."""
    if isinstance(value, list) and value and all(isinstance(part, FormantFigures) for part in value):
        value = {f"F{k}_hz": part.frequency_hz for k, part in enumerate(value, 1)}
    elif isinstance(value, BaseModel):
        value = {key: getattr(value, key) for key in type(value).model_fields}
    if isinstance(value, Mapping):
        before = f"{name}." if name else ""
        return {key: number for inner, part in value.items() for key, number in flat(part, f"{before}{inner}").items()}
    return {name: value} if value is None or isinstance(value, (bool, int, float)) else {}


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
