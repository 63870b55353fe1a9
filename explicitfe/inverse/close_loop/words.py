"""Effects in words, and where the residual is concentrated."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.evidence import Causes
from explicitfe.inverse.close_loop.statistics.covariance import Covariance, outside
from explicitfe.inverse.close_loop.statistics.refit import BestFit
from explicitfe.results.documents.verdict_text import JOINED_BY, NOTHING

# The report names at most this many parts of the data: those with the largest misfit.
NAMED_PARTS = 3
# The first fifth of a test is called early, the last late; the lowest quarter of the load low, the highest high.
EARLY_SHARE, LOW_LOAD_SHARE = 0.2, 0.25
# A part is named if its mean square exceeds that of all rows by this factor, and if it is no smaller share of them than this.
CONCENTRATED_FACTOR, SMALLEST_PART_SHARE = 1.5, 0.05
# Causes with several forms; the name of a cause is that of its usual form.
CAUSES = {"viscoelastic": "relaxation", "stiffness-gradient": "stiffness that changes with depth"}


def title(effect: str) -> str:
    """An effect in words."""
    return EFFECTS[effect].about.title if effect in EFFECTS else effect.replace("-", " ")


def title_of_cause(cause: str) -> str:
    """A cause in words."""
    return CAUSES.get(cause) or title(cause)


def set_in_words(causes: Causes) -> str:
    """A set of causes as a key of the posterior."""
    return JOINED_BY.join(sorted(causes)) or NOTHING


def where(fit: BestFit, covariance: Covariance) -> str:
    """Where the residual is concentrated: in which phase, early or late, at low or high load, in which curves."""
    # The square of what the constants cannot explain, row by row.
    squares = outside(fit.movable, fit.residual) ** 2
    early, low = EARLY_SHARE, LOW_LOAD_SHARE
    parts: dict[str, np.ndarray] = {}
    for one, part in zip(covariance.series, covariance.slices(), strict=True):
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
    smallest = SMALLEST_PART_SHARE
    concentrated = [
        (float(squares[mask].mean()) / mean, name)
        for name, mask in parts.items()
        if smallest * len(squares) <= mask.sum() < (1.0 - smallest) * len(squares)
        and squares[mask].mean() > CONCENTRATED_FACTOR * mean
    ]
    if not concentrated:
        return "The residual is spread over all curves."
    words = [f"{name} ({times:.1f} times the mean)" for times, name in sorted(concentrated, reverse=True)[:NAMED_PARTS]]
    return f"The residual is largest {', '.join(words)}."
