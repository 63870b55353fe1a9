"""A set that stays: part of the network forms anew in the deformed state (two networks; Tobolsky, Prettyman & Dillon 1944).

The second network is free of stress in the state A^-1 in which it formed and is neo-Hookean about it:

    W2 = G2 / 2 (A : C_bar - 3),    A = 1 at first.

It forms while the tissue is strained further than ever: with x, the largest I1_bar - 3 so far, dA = 4 (C_bar^-1 - A) dx / x. On
the first way up it therefore bears little; on the way back it pulls towards the state it formed in. Time does not count.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, number, remember, remembered, renew
from explicitfe.fem.materials.kinematics import plus, right_cauchy_green, times
from explicitfe.platform.compiled.jit import Template
from explicitfe.platform.compiled.simd import maximum

AT = MEMORY = 0
# An I1_bar - 3 below which no network forms: a strain of 2e-5.
SMALLEST_STRETCH_AT_REST = 1e-9


class PermanentSet(MaterialEffect):
    """Shear modulus of the network that forms again."""

    about: ClassVar[Description] = Description(
        title="permanent set",
        equation="W + G2 / 2 (A : C_bar - 3), dA = 4 (C_bar^-1 - A) dx / x, x the largest I1_bar - 3 so far",
        source="two networks: Tobolsky, Prettyman & Dillon (1944) J. Appl. Phys. 15:380-395",
        where="material",
        strength="G2 (Pa)",
        plausible=1000.0,
        needs="unloading to low load, or a second cycle",
        neighbours="softening (returns to zero strain at zero load), viscoelastic (recovers with time), backlash",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"modulus_Pa": Sought((0.05, 0.2, 1.0), 0.0, 20.0, scale="modulus_Pa")}
    requires: ClassVar[tuple[str, ...]] = ("unloading",)
    remembers = True
    depends_on_path = True
    modulus_Pa: float = Field(ge=0.0, description="G2, shear modulus of the network that forms again [Pa]")

    @property
    def strength(self) -> float:
        return self.modulus_Pa

    @property
    def memory(self) -> int:
        return 7

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"pull": set_back}

    def values(self, increment_s: float) -> tuple[float, ...]:
        return (self.modulus_Pa,)


def set_back(F, square, inverse_C, blocks, block):
    """Isochoric second Piola-Kirchhoff stress of the second network [Pa], (11, 22, 33, 12, 13, 23), and its energy [Pa].

    What is remembered is x, and A - 1 in the same order.
    """
    C = right_cauchy_green(F)
    before = remembered(blocks, block, MEMORY)
    largest = maximum(before, square * (C[0] + C[1] + C[2]) - 3.0)
    ratio = before / (largest + SMALLEST_STRETCH_AT_REST)
    kept = ratio * ratio
    kept = kept * kept
    grown, stretch = 1.0 - kept, 1.0 / square
    formed = (
        stretch * inverse_C[0] - 1.0,
        stretch * inverse_C[1] - 1.0,
        stretch * inverse_C[2] - 1.0,
        stretch * inverse_C[3],
        stretch * inverse_C[4],
        stretch * inverse_C[5],
    )
    remember(blocks, block, MEMORY, largest)
    a = renew(blocks, block, MEMORY + 1, kept, grown, formed)
    A = (a[0] + 1.0, a[1] + 1.0, a[2] + 1.0, a[3], a[4], a[5])
    trace = A[0] * C[0] + A[1] * C[1] + A[2] * C[2] + 2.0 * (A[3] * C[3] + A[4] * C[4] + A[5] * C[5])
    modulus = number(blocks, block, AT)
    stress = times(modulus * square, plus(A, times(-(1.0 / 3.0) * trace, inverse_C)))
    return stress, 0.5 * modulus * (square * trace - 3.0)
