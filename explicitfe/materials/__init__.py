"""Material laws: one file a law, one line a law in the table below.

A law's module has a pydantic class of constants (a :class:`~explicitfe.materials.law.Law`) that says of which invariants the
isochoric energy is a function, and two leaves: that energy and its slopes by them. Stress and energy follow in ``law``. The
leaves use arithmetic only, so that the same statement runs on floats (tests, one point) and on vectors (elements).
"""

from __future__ import annotations

from types import ModuleType

from explicitfe.materials import mooney_rivlin, neo_hooke, yeoh
from explicitfe.materials.law import Law, Leaves, leaves_of

LAWS: dict[str, tuple[type[Law], ModuleType]] = {
    "yeoh": (yeoh.Yeoh, yeoh),
    "neo-hooke": (neo_hooke.NeoHooke, neo_hooke),
    "mooney-rivlin": (mooney_rivlin.MooneyRivlin, mooney_rivlin),
}


def law_of(name: str) -> Leaves:
    """The compiled leaves of the law called ``name``."""
    return leaves_of(*LAWS[name])


__all__ = ["LAWS", "Law", "Leaves", "law_of"]
