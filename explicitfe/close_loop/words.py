"""What the loop found, in sentences: the verdict, where the rest lives, what to measure next."""

from __future__ import annotations

import numpy as np

from explicitfe.close_loop.search import Closed, Step
from explicitfe.close_loop.statistics.fingerprints import outside
from explicitfe.effects import EFFECTS

LIVES = 1.5  # times the mean square: a part of the data where the rest lives
PART = 0.05  # of the rows: a part must be so large


def title(effect: str) -> str:
    """An effect in words."""
    return EFFECTS[effect].about.title if effect in EFFECTS else effect.replace("-", " ")


def sentence_case(text: str) -> str:
    """With a capital first letter, names inside left as they are."""
    return text[:1].upper() + text[1:]


def listed(names: list[str] | tuple[str, ...]) -> str:
    """a, b and c."""
    words = [title(name) for name in names]
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def sentence(closed: Closed) -> str:
    """The verdict in one sentence."""
    if closed.verdict == "failed":
        return f"The fit failed: {closed.message} This says nothing about what the model lacks."
    if closed.verdict == "no-missing-effect":
        return "Nothing is missing that these data can show: the elastic model leaves no more than noise."
    if closed.verdict == "unexplained":
        helps = f" {sentence_case(listed(closed.nearest))} would help, and leaves most of it." if closed.nearest else ""
        return f"Something is missing, and none of the effects that were considered explains it.{helps}"
    if closed.verdict == "ambiguous":
        first = closed.steps[0]
        if first.ambiguous_with:
            return f"These data cannot tell {title(first.best or '')} from {listed(first.ambiguous_with)}."
        return f"{sentence_case(listed(closed.effects))} explains it, but one test alone cannot confirm it."
    rest = {
        "at-floor": "what is left is no more than noise",
        "unexplained": "something else is left that none of the effects considered explains",
        "ambiguous": "something else is left that could be more than one effect",
    }[closed.remainder]
    return f"The model lacks {listed(closed.effects)}; {rest}."


def where(step: Step) -> str:
    """Where what is left lives: in which phase, early or late, at low or high load, in which curves."""
    if step.at_floor:
        return ""
    # by rows and not by Sigma: a reader looks for it in the curves
    rest = outside(step.fit.movable, step.fit.residual) ** 2
    parts: dict[str, np.ndarray] = {}
    for one, part in zip(step.covariance.series, step.covariance.slices(), strict=True):
        rows = np.zeros(len(rest), dtype=bool)
        rows[part] = True
        size = np.abs(one.measured)
        masks = {
            **{f"in {name}": one.phase == name for name in ("loading", "unloading")},
            "in the hold": one.phase == "hold",
            "early": one.time_s < 0.2 * one.time_s[-1],
            "late": one.time_s > 0.8 * one.time_s[-1],
            "at low load": size < 0.25 * size.max(),
            "at high load": size > 0.75 * size.max(),
            f"in curve {one.id}": np.ones(len(size), dtype=bool),
        }
        for name, mask in masks.items():
            whole = parts.setdefault(name, np.zeros(len(rest), dtype=bool))
            whole[part] |= mask
    mean = float(rest.mean())
    found = [
        (float(rest[mask].mean()) / mean, name)
        for name, mask in parts.items()
        if PART * len(rest) <= mask.sum() < (1.0 - PART) * len(rest) and rest[mask].mean() > LIVES * mean
    ]
    if not found:
        return "What is left is spread over all curves."
    words = [f"{name} ({times:.1f} times the mean)" for times, name in sorted(found, reverse=True)[:3]]
    return f"What is left is largest {', '.join(words)}."
