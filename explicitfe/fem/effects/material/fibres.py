"""Passive fibres that stiffen in tension (Holzapfel, Gasser & Ogden 2000).

W4 = k1 / (2 k2) (exp(k2 (I4_bar - 1)^2) - 1) where I4_bar > 1, nothing in compression.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from explicitfe.fem.effects.effect import Conditions, Description, MaterialEffect, Sought, number
from explicitfe.platform.compiled.jit import Template
from explicitfe.platform.compiled.simd import exp, maximum

AT = MEMORY = 0
# Fibres in a test along them and across them, where the load is along z.
DIRECTIONS = {"fibre": (0.0, 0.0, 1.0), "cross-fibre": (1.0, 0.0, 0.0)}


class Fibres(MaterialEffect):
    """Stiffness and direction of fibres that bear tension only."""

    about: ClassVar[Description] = Description(
        title="passive fibres",
        equation="W + k1 / (2 k2) (exp(k2 (I4_bar - 1)^2) - 1) where I4_bar > 1",
        source="Holzapfel, Gasser & Ogden (2000) J. Elasticity 61:1-48, eq. 66",
        where="material",
        strength="k1 (Pa)",
        plausible=20000.0,
        needs="tests in two directions; compression across the fibres stretches them",
        neighbours="third-yeoh (the same in all directions), layer",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "k1_Pa": Sought((0.2, 1.0, 5.0), 0.0, 100.0, scale="modulus_Pa"),
        "k2": Sought((0.1, 1.0, 5.0), 0.01, 50.0, kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("two directions",)
    in_revolution = False
    k1_Pa: float = Field(ge=0.0, description="stiffness [Pa]")
    k2: float = Field(default=1.0, gt=0.0, description="how fast they stiffen")
    direction: tuple[float, float, float] = Field(default=(0.0, 0.0, 1.0), description="of the fibres in the reference shape")

    @model_validator(mode="after")
    def _a_direction(self) -> Fibres:
        if not any(self.direction):
            raise ValueError("direction must not be zero")
        return self

    @property
    def strength(self) -> float:
        return self.k1_Pa

    @property
    def breaks_symmetry(self) -> bool:
        return any(self.direction[:2])

    def in_test(self, conditions: Conditions) -> Self:
        """Turned into the direction in which the test loads them, where the test has one."""
        direction = DIRECTIONS.get(str(conditions.get("direction")))
        return self if direction is None else self.model_copy(update={"direction": direction})

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"pull": pull}

    def values(self, increment_s: float) -> tuple[float, ...]:
        a = np.array(self.direction) / np.linalg.norm(self.direction)
        return self.k1_Pa, self.k2, float(a[0]), float(a[1]), float(a[2])


def pull(F, square, inverse_C, blocks, block):
    """Isochoric second Piola-Kirchhoff stress of the fibres [Pa], (11, 22, 33, 12, 13, 23), and their energy [Pa].

    ``square`` is J^(-2/3), ``inverse_C`` C^-1 in the same order.
    """
    k1, k2 = number(blocks, block, AT), number(blocks, block, AT + 1)
    ax, ay, az = number(blocks, block, AT + 2), number(blocks, block, AT + 3), number(blocks, block, AT + 4)
    x = F[0] * ax + F[1] * ay + F[2] * az
    y = F[3] * ax + F[4] * ay + F[5] * az
    z = F[6] * ax + F[7] * ay + F[8] * az
    I4 = x * x + y * y + z * z
    beyond = maximum(square * I4 - 1.0, 0.0 * I4)
    grown = exp(k2 * beyond * beyond)
    a = 2.0 * k1 * beyond * grown * square
    b = -(1.0 / 3.0) * a * I4
    stress = (
        a * ax * ax + b * inverse_C[0],
        a * ay * ay + b * inverse_C[1],
        a * az * az + b * inverse_C[2],
        a * ax * ay + b * inverse_C[3],
        a * ax * az + b * inverse_C[4],
        a * ay * az + b * inverse_C[5],
    )
    return stress, 0.5 * k1 / k2 * (grown - 1.0)
