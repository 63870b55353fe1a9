"""Material laws: one file a law, one line a law in the table below.

A law's module has a pydantic class of constants (a :class:`~explicitfe.materials.law.Law`), ``CONSTANTS``, the number of
numbers that its kernels read, and the leaves ``energy``, ``stress``, ``isochoric`` and ``slope``. ``delta`` is
what the deformation inside an element, unseen by its one integration point, adds to I1_bar. The leaves use arithmetic
only, so that the same statement runs on floats (tests, one point) and on vectors (elements).
"""

from __future__ import annotations

from types import ModuleType

from explicitfe.materials import neo_hooke, yeoh
from explicitfe.materials.law import Law

LAWS: dict[str, tuple[type[Law], ModuleType]] = {
    "yeoh": (yeoh.Yeoh, yeoh),
    "neo-hooke": (neo_hooke.NeoHooke, neo_hooke),
}


def law_of(name: str) -> ModuleType:
    """The module of leaves of the law called ``name``."""
    return LAWS[name][1]


__all__ = ["LAWS", "Law", "law_of"]
