"""Causes of the benchmark: several forms of one mechanism are one cause, and an answer is judged by cause."""

from __future__ import annotations

from collections.abc import Iterable

RELAXATION, SOFTENING, OVER_DEPTH = "relaxation", "softening", "stiffness-over-depth"
# Effect -> cause. An effect that is not listed is a cause by its own name.
CAUSE_OF = {
    "viscoelastic": RELAXATION,
    "power-law": RELAXATION,
    "fractional": RELAXATION,
    "nonlinear-relaxation": RELAXATION,
    "softening": SOFTENING,
    "stiffness-gradient": OVER_DEPTH,
    "layer": OVER_DEPTH,
    "inclusion": OVER_DEPTH,
}


def cause_of(name: str) -> str:
    """The cause of an effect; a name that is a cause already stays as it is."""
    return CAUSE_OF.get(name, name)


def causes_of(names: Iterable[str]) -> frozenset[str]:
    """The causes of several effects."""
    return frozenset(cause_of(name) for name in names)
