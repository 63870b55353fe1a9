"""Friction inside the tissue that does not depend on the rate: the modulus falls with the amplitude of a cycle (Payne effect).

A branch beside the elastic law is neo-Hookean until its stress reaches a yield stress, and then slides (Kaliske & Rothert 1998):

    Q_trial = Q + dS,  S = G (1 - tr C / 3 C^-1) J^(-2/3),   Q = Q_trial min(1, y / |Q|),  |Q|^2 = tr(Q C Q C) / 2,

so that |Q| is the shear stress in a simple shear, and y = G times the shear at which it slides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.compiled.jit import Template
from explicitfe.compiled.simd import maximum, square_root
from explicitfe.effects.effect import Description, MaterialEffect, Sought, number, remember, remembered
from explicitfe.materials.kinematics import right_cauchy_green

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
    q0 = remembered(blocks, block, MEMORY + 6) + s0 - remembered(blocks, block, MEMORY)
    q1 = remembered(blocks, block, MEMORY + 7) + s1 - remembered(blocks, block, MEMORY + 1)
    q2 = remembered(blocks, block, MEMORY + 8) + s2 - remembered(blocks, block, MEMORY + 2)
    q3 = remembered(blocks, block, MEMORY + 9) + s3 - remembered(blocks, block, MEMORY + 3)
    q4 = remembered(blocks, block, MEMORY + 10) + s4 - remembered(blocks, block, MEMORY + 4)
    q5 = remembered(blocks, block, MEMORY + 11) + s5 - remembered(blocks, block, MEMORY + 5)
    # M = Q C
    m00, m01, m02 = q0 * C[0] + q3 * C[3] + q4 * C[4], q0 * C[3] + q3 * C[1] + q4 * C[5], q0 * C[4] + q3 * C[5] + q4 * C[2]
    m10, m11, m12 = q3 * C[0] + q1 * C[3] + q5 * C[4], q3 * C[3] + q1 * C[1] + q5 * C[5], q3 * C[4] + q1 * C[5] + q5 * C[2]
    m20, m21, m22 = q4 * C[0] + q5 * C[3] + q2 * C[4], q4 * C[3] + q5 * C[1] + q2 * C[5], q4 * C[4] + q5 * C[5] + q2 * C[2]
    trace = m00 * m00 + m11 * m11 + m22 * m22 + 2.0 * (m01 * m10 + m02 * m20 + m12 * m21)
    yields = G * number(blocks, block, AT + 1)
    size = square_root(0.5 * maximum(trace, 0.0 * trace))
    left = yields / (maximum(size, yields) + 1e-200)
    q0, q1, q2, q3, q4, q5 = left * q0, left * q1, left * q2, left * q3, left * q4, left * q5
    remember(blocks, block, MEMORY, s0)
    remember(blocks, block, MEMORY + 1, s1)
    remember(blocks, block, MEMORY + 2, s2)
    remember(blocks, block, MEMORY + 3, s3)
    remember(blocks, block, MEMORY + 4, s4)
    remember(blocks, block, MEMORY + 5, s5)
    remember(blocks, block, MEMORY + 6, q0)
    remember(blocks, block, MEMORY + 7, q1)
    remember(blocks, block, MEMORY + 8, q2)
    remember(blocks, block, MEMORY + 9, q3)
    remember(blocks, block, MEMORY + 10, q4)
    remember(blocks, block, MEMORY + 11, q5)
    return (q0, q1, q2, q3, q4, q5), left * left * trace / (4.0 * G + 1e-200)
