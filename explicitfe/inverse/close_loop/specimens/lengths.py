"""Lengths of specimens and tools that may be wrong: those that a source does not state, and the errors of those that it does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.inverse.measured.curve import Curve


def with_errors_of_lengths(curves: Sequence[Curve], homogeneous: bool) -> dict[str, tuple[Curve, ...]]:
    """Name of each length -> the curves with it larger by its likely error.

    Two stated heights are two measurements, each with an error of its own. How wide a specimen is matters between platens only.
    """
    changed = with_assumed_lengths(curves, 1.0 + THRESHOLDS.assumed_length_error_share)
    share = THRESHOLDS.stated_length_error_share
    for table, key in (("specimen", "height_mm"), ("specimen" if homogeneous else "tool", "radius_mm")):
        owners = [getattr(c, table) for c in curves]
        stated = [None if owner is None or key in owner.assumed else getattr(owner, key) for owner in owners]
        for length in dict.fromkeys(value for value in stated if value is not None):
            changed[f"{100.0 * share:g} % of {table}.{key} = {length:g}"] = tuple(
                with_length(c, table, key, 1.0 + share) if value == length else c for c, value in zip(curves, stated, strict=True)
            )
    return changed


def with_assumed_lengths(curves: Sequence[Curve], factor: float) -> dict[str, tuple[Curve, ...]]:
    """Name of each assumed length -> the curves with it multiplied."""
    changed: dict[str, tuple[Curve, ...]] = {}
    for table in ("specimen", "tool"):
        keys = dict.fromkeys(k for c in curves if getattr(c, table) is not None for k in getattr(c, table).assumed)
        for key in keys:
            if key.endswith("_mm"):
                changed[f"{table}.{key}"] = tuple(with_length(c, table, key, factor) for c in curves)
    return changed


def with_length(curve: Curve, table: str, key: str, factor: float) -> Curve:
    """A curve with one length of its specimen or tool multiplied."""
    own = getattr(curve, table)
    value = None if own is None else getattr(own, key, None)
    if not isinstance(value, int | float):
        return curve
    return replace(curve, **{table: own.model_copy(update={key: factor * value})})
