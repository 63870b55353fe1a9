"""Two forms of one mechanism, such as relaxation by a Prony series or by a power law, are the same answer."""

from __future__ import annotations

from collections.abc import Iterable

from explicitfe.fem.effects import EFFECTS


def mechanism(name: str) -> str:
    """The usual form of an effect's mechanism; what the library does not know stands for itself."""
    effect = EFFECTS.get(name)
    return (effect.variant_of if effect is not None else "") or name


def mechanisms(names: Iterable[str]) -> set[str]:
    """The mechanisms of several effects."""
    return {mechanism(name) for name in names}
