"""Refusal of effects that a simulation or an element does not support."""

from __future__ import annotations

from collections.abc import Sequence

from explicitfe.fem.effects import Effect, with_leaves
from explicitfe.platform.errors import InputError


def check_effects(effects: Sequence[Effect], element: str) -> None:
    """Refuse effects that change only what is read, and effects of the material in an element that cannot compute them.

    Raises
    ------
    InputError
    """
    for effect in effects:
        if effect.acts_on == "reading":
            raise InputError(f"effects: {effect.about.title} affects the measurement only; use it with predict, or remove it.")
    compiled = with_leaves(effects)
    if compiled and element == "hex8-full":
        raise InputError(
            f'effects: element = "hex8-full" does not support effects of the material ({compiled[0].about.title}); take "hex8".'
        )
