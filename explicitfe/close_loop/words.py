"""What the search found, in sentences: the verdict, where the remainder lives, effects in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.close_loop.search import Outcome, Round
from explicitfe.close_loop.statistics.covariance import outside
from explicitfe.close_loop.thresholds import THRESHOLDS
from explicitfe.effects import EFFECTS

# The report names at most this many parts of the data: those with the largest misfit.
NAMED_PARTS = 3


def title(effect: str) -> str:
    """An effect in words."""
    return EFFECTS[effect].about.title if effect in EFFECTS else effect.replace("-", " ")


def sentence_case(text: str) -> str:
    """The text with a capital first letter; names inside stay as they are."""
    return text[:1].upper() + text[1:]


def list_of(names: Sequence[str]) -> str:
    """Effects in words: a, b and c."""
    words = [title(name) for name in names]
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def failure(message: str) -> str:
    """The verdict in one sentence, where the fit failed."""
    return f"The fit failed: {message} This says nothing about what the model lacks."


def sentence(outcome: Outcome, undetermined: Sequence[str] = ()) -> str:
    """The verdict in one sentence; ``undetermined`` are effects that were found, but whose strength is not determined."""
    if outcome.verdict == "failed":
        return failure(outcome.message)
    if outcome.verdict == "no-missing-effect" and outcome.no_consequence:
        slight = f"{sentence_case(list_of(outcome.no_consequence))} is significant, and of no consequence"
        return f"Nothing is missing that matters. {slight}: tests that were left out are foretold no better with it."
    if outcome.verdict == "no-missing-effect" and not outcome.rounds[0].at_floor:
        return "Something may be missing, but that noise alone leaves as much is too probable for an alarm."
    if outcome.verdict == "no-missing-effect":
        return "Nothing is missing that these data can show: the elastic model leaves no more than noise."
    if outcome.verdict == "limited-by-numerics":
        return (
            "What the elastic model leaves is no more than the errors of mesh and steps may explain; "
            "they are too large here to say whether anything is missing."
        )
    if outcome.verdict == "unexplained":
        nearest = sentence_case(list_of(outcome.nearest)) if outcome.nearest else ""
        helps = f" {nearest} helps, and leaves too much of it to be what is missing." if nearest else ""
        return f"Something is missing, and none of the effects that were considered explains it.{helps}"
    if outcome.verdict == "ambiguous":
        first = outcome.rounds[0]
        if first.ambiguous_with:
            return f"These data cannot tell {title(first.best or '')} from {list_of(first.ambiguous_with)}."
        return f"{sentence_case(list_of(outcome.effects))} explains it, but one test alone cannot confirm it."
    remainder = {
        "at-floor": "what is left is no more than noise",
        "form": "what little is left may be the form that it has in these data",
        "unexplained": "something else is left that none of the effects considered explains",
        "ambiguous": "something else is left that could be more than one effect",
    }[outcome.remainder]
    strength = f", the strength of {list_of(undetermined)} is not determined" if undetermined else ""
    return f"The model lacks {list_of(outcome.effects)}{strength}; {remainder}."


def where(last: Round) -> str:
    """Where the remainder lives: in which phase, early or late, at low or high load, in which curves."""
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
        return "What is left is spread over all curves."
    words = [f"{name} ({times:.1f} times the mean)" for times, name in sorted(concentrated, reverse=True)[:NAMED_PARTS]]
    return f"What is left is largest {', '.join(words)}."
