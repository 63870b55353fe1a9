"""Friction inside the tissue that does not depend on the rate: the modulus falls with the amplitude of a cycle (Payne effect).

A branch beside the elastic law is neo-Hookean until its stress reaches a yield stress, and then slides (Kaliske & Rothert 1998):

    Q_trial = Q + dS,  S = G (1 - tr C / 3 C^-1) J^(-2/3),   Q = Q_trial min(1, y / |Q|),  |Q|^2 = tr(Q C Q C) / 2,

so that |Q| is the shear stress in a simple shear, and y = G times the shear at which it slides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, number, remember_tensor, remembered_tensor
from explicitfe.fem.materials.kinematics import minus, plus, right_cauchy_green, squared_size, times
from explicitfe.platform.compiled.jit import Template
from explicitfe.platform.compiled.simd import maximum, square_root

AT = MEMORY = 0


class Payne(MaterialEffect):
    """Modulus of a branch, and the shear at which it slides."""

    about: ClassVar[Description] = Description(
        title="friction inside the tissue (Payne)",
        equation="S + Q, dQ = dS_G while |Q| < G y, sliding at |Q| = G y",
        source="Kaliske & Rothert (1998) Int. J. Solids Struct. 35:2057-2071",
        where="material",
        strength="G (Pa)",
        plausible=1000.0,
        needs="unloading; best cycles of several amplitudes",
        neighbours="softening (no loop before an earlier maximum), viscoelastic (depends on the rate), friction of the tool",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "modulus_Pa": Sought((0.05, 0.2, 1.0), 0.0, 20.0, scale="modulus_Pa"),
        "yield_shear": Sought((0.02, 0.07, 0.2), 2e-3, 1.0, kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("unloading",)
    remembers = True
    depends_on_path = True
    modulus_Pa: float = Field(ge=0.0, description="G, shear modulus of the branch [Pa]")
    yield_shear: float = Field(gt=0.0, description="y, the shear at which it slides")

    @property
    def strength(self) -> float:
        return self.modulus_Pa

    @property
    def memory(self) -> int:
        return 12

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"pull": slide}

    def values(self, increment_s: float) -> tuple[float, ...]:
        return self.modulus_Pa, self.yield_shear


def slide(F, square, inverse_C, blocks, block):
    """Isochoric second Piola-Kirchhoff stress of the branch [Pa], (11, 22, 33, 12, 13, 23), and its energy [Pa].

    What is remembered is its stress without sliding, S, and Q.
    """
    C = right_cauchy_green(F)
    G = number(blocks, block, AT)
    m, b = G * square, -(1.0 / 3.0) * (C[0] + C[1] + C[2])
    s0, s1, s2 = m * (1.0 + b * inverse_C[0]), m * (1.0 + b * inverse_C[1]), m * (1.0 + b * inverse_C[2])
    s3, s4, s5 = m * b * inverse_C[3], m * b * inverse_C[4], m * b * inverse_C[5]
    S = (s0, s1, s2, s3, s4, s5)
    Q = plus(remembered_tensor(blocks, block, MEMORY + 6), minus(S, remembered_tensor(blocks, block, MEMORY)))
    trace = squared_size(Q, C)
    yields = G * number(blocks, block, AT + 1)
    size = square_root(0.5 * maximum(trace, 0.0 * trace))
    left = yields / (maximum(size, yields) + 1e-200)
    Q = times(left, Q)
    remember_tensor(blocks, block, MEMORY, S)
    remember_tensor(blocks, block, MEMORY + 6, Q)
    return Q, left * left * trace / (4.0 * G + 1e-200)
