"""Material laws: one file per law, and one line per law of the elements in the table below.

The module of a law has a pydantic class of constants (a :class:`~.law.Law`) that names the invariants of the
isochoric energy, and two leaves: this energy and its derivatives with respect to the invariants. Stress and energy follow in
``law``. The leaves use arithmetic only, so that the same statement runs on floats (tests, one point) and on vectors (elements).

``ogden`` is not in the table: elements do not support it. ``homogeneous`` computes all laws in homogeneous tests.
"""

from __future__ import annotations

from types import ModuleType

from explicitfe.fem.materials import mooney_rivlin, neo_hooke, yeoh
from explicitfe.fem.materials.law import Law, Leaves, leaves_of
from explicitfe.platform.errors import InputError

LAWS: dict[str, tuple[type[Law], ModuleType]] = {
    "yeoh": (yeoh.Yeoh, yeoh),
    "neo-hooke": (neo_hooke.NeoHooke, neo_hooke),
    "mooney-rivlin": (mooney_rivlin.MooneyRivlin, mooney_rivlin),
}


def law_of(name: str) -> Leaves:
    """The compiled leaves of the law called ``name``.

    Raises
    ------
    InputError : elements do not support the law.
    """
    if name not in LAWS:
        raise InputError(f"law {name} is available for homogeneous tests only; laws of elements: {', '.join(LAWS)}.")
    return leaves_of(*LAWS[name])


__all__ = ["LAWS", "Law", "Leaves", "law_of"]
