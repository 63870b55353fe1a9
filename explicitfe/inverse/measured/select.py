"""Select the curves and rows of a dataset that an elastic law is fitted to, those it predicts, and those omitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from explicitfe.inverse.measured.curve import Curve, SpecimenDataset, programme_of, same_measurement, sd_of
from explicitfe.inverse.measured.tables import ConditionValue
from explicitfe.platform.errors import InputError, nearest, shortened

# Rows within this many standard deviations of the largest imposed value count as largest: a hold is noise about its value.
SAME_MAXIMUM_SDS = 3.0
# The noise determines the start of a hold only if it is less than this share of the largest value.
LARGEST_SLACK_SHARE = 0.01
# A ramp that ends within this many rows of its largest value has no unloading to omit.
ROWS_OF_NO_UNLOADING = 2


@dataclass(frozen=True)
class Group:
    """Curves that share their constants.

    Attributes
    ----------
    fitted, predicted : curves, in the order of the file.
    rows : id -> number of rows used, from the first one on.
    """

    name: str
    fitted: tuple[Curve, ...]
    predicted: tuple[Curve, ...]
    rows: dict[str, int] = field(default_factory=dict)


def select(dataset: SpecimenDataset, fit_where: Sequence[str]) -> tuple[list[Group], dict[str, str]]:
    """Select the curves to fit.

    Parameters
    ----------
    fit_where : "KEY=VALUE" on conditions, ``group`` or ``id``: only curves that match all keys are fitted, the others are
        predicted. A key given twice allows both values. A held-out curve is never fitted.

    Returns
    -------
    groups : curves that share their constants.
    left_out : id of a curve -> reason why it is neither fitted nor predicted.

    Raises
    ------
    InputError : an unknown key, or constants without a curve to fit.
    """
    wanted = _wanted(dataset, fit_where)
    left_out = {c.id: f"defect: {c.defect}" for c in dataset.curves if c.defect}
    groups = []
    for name, curves in dataset.constants_groups().items():
        fitted: list[Curve] = []
        predicted: list[Curve] = []
        for curve in curves:
            if curve.id in left_out:
                continue
            side = fitted if curve.split != "holdout" and _matches(curve, wanted) else predicted
            twin = next((c for c in fitted + predicted if same_measurement(c, curve)), None)
            if twin is not None:
                left_out[curve.id] = f'a second digitisation of "{twin.id}"'
                continue
            side.append(curve)
        if not fitted:
            which = " ".join(f"`fit` {w}" for w in fit_where)
            raise InputError(
                f'{dataset.path}: no curve remains to fit the constants "{name}"'
                + (f" with {which}; allow one." if which else ": all are held out or defective.")
            )
        groups.append(Group(name, tuple(fitted), tuple(predicted), {c.id: loading_rows(c) for c in fitted + predicted}))
    return groups, left_out


def loading_rows(curve: Curve) -> int:
    """Return the number of rows up to the largest imposed value; an elastic law has no hysteresis."""
    programme = programme_of(curve)
    load = np.abs(programme - 1.0) if curve.imposed == "stretch" else np.abs(programme) if curve.kind == "shear" else programme
    slack = SAME_MAXIMUM_SDS * (sd_of(curve, curve.imposed) or 0.0)
    largest = float(load.max())
    first = int(np.argmax(load >= largest - slack)) if slack < LARGEST_SLACK_SHARE * largest else int(np.argmax(load))
    return len(load) if first >= len(load) - ROWS_OF_NO_UNLOADING else first + 1


def _wanted(dataset: SpecimenDataset, fit_where: Sequence[str]) -> dict[str, list[str]]:
    known = {"id", "group"}.union(*(curve.conditions for curve in dataset.curves))
    wanted: dict[str, list[str]] = {}
    for text in fit_where:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key or not value:
            raise InputError(f"`fit` {shortened(text)}: write KEY=VALUE, for example `fit` sample=A.")
        if key not in known:
            raise InputError(f'`fit` {shortened(text)}: no curve has the condition "{shortened(key)}"; {nearest(key, known)}')
        values = {_text(_of(curve, key)) for curve in dataset.curves} - {""}
        if value not in values:
            raise InputError(f'`fit` {shortened(text)}: no curve has {key} = "{shortened(value)}"; {nearest(value, values)}')
        wanted.setdefault(key, []).append(value)
    return wanted


def _matches(curve: Curve, wanted: dict[str, list[str]]) -> bool:
    return all(_text(_of(curve, key)) in values for key, values in wanted.items())


def _of(curve: Curve, key: str) -> ConditionValue | None:
    if key in ("id", "group"):
        return curve.id if key == "id" else curve.group
    return curve.conditions.get(key)


def _text(value: ConditionValue | None) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, int | float) else str(value)
