"""Effects in words, and where the residual is concentrated."""

from __future__ import annotations

import numpy as np

from explicitfe.close_loop.search import Round
from explicitfe.close_loop.statistics.covariance import outside
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.effects import EFFECTS

# The report names at most this many parts of the data: those with the largest misfit.
NAMED_PARTS = 3


def title(effect: str) -> str:
    """An effect in words."""
    return EFFECTS[effect].about.title if effect in EFFECTS else effect.replace("-", " ")


def where(last: Round) -> str:
    """Where the residual is concentrated: in which phase, early or late, at low or high load, in which curves."""
    if last.at_floor:
        return ""
    # The square of what the constants cannot explain, row by row.
    squares = outside(last.fit.movable, last.fit.residual) ** 2
    early, low = THRESHOLDS.early_share, THRESHOLDS.low_load_share
    parts: dict[str, np.ndarray] = {}
    for one, part in zip(last.covariance.series, last.covariance.slices(), strict=True):
        load, duration = np.abs(one.measured), one.time_s[-1]
        masks = {
            **{f"in {name}": one.phase == name for name in ("loading", "unloading")},
            "in the hold": one.phase == "hold",
            "early": one.time_s < early * duration,
            "late": one.time_s > (1.0 - early) * duration,
            "at low load": load < low * load.max(),
            "at high load": load > (1.0 - low) * load.max(),
            f"in curve {one.id}": np.ones(len(load), dtype=bool),
        }
        for name, mask in masks.items():
            whole = parts.setdefault(name, np.zeros(len(squares), dtype=bool))
            whole[part] |= mask
    mean = float(squares.mean())
    smallest = THRESHOLDS.smallest_part_share
    concentrated = [
        (float(squares[mask].mean()) / mean, name)
        for name, mask in parts.items()
        if smallest * len(squares) <= mask.sum() < (1.0 - smallest) * len(squares)
        and squares[mask].mean() > THRESHOLDS.concentrated_factor * mean
    ]
    if not concentrated:
        return "The residual is spread over all curves."
    words = [f"{name} ({times:.1f} times the mean)" for times, name in sorted(concentrated, reverse=True)[:NAMED_PARTS]]
    return f"The residual is largest {', '.join(words)}."
