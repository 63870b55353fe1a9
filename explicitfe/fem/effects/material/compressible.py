"""Poisson's ratio below that of the model, and the volumetric energy of a tissue that loses volume under pressure.

Where the volume hardly changes, every energy with the same bulk modulus K gives the same pressure. Elsewhere energies differ in
the second order of J - 1. U'(J) = K (J - 1 - s/2 (J - 1)^2 + ...) with s = -U'''(1) / K, which is

U(J) = (1 - s) K/2 (J - 1)^2 + s K/4 (J^2 - 1 - 2 ln J)

here: s = 0 is the quadratic energy of many finite element programs, s = 1 that of Simo and Taylor (1982), which all laws have
without this effect. U is convex for s between 0 and 2. Data do not state s, and a flat tool of 14 mm goes 0.03 mm deeper into
20 mm of tissue with s = 0 than with s = 1 at Poisson's ratio 0.45 and 0.8 N.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import LawT, ModelT
from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, in_materials, number
from explicitfe.fem.materials import volumetric
from explicitfe.platform.compiled.jit import Template

AT = MEMORY = 0
# Poisson's ratio without the effect: under a flat tool it is 2 micrometres off the incompressible limit.
NEARLY_INCOMPRESSIBLE = 0.4999
# s of the volumetric energy that every law has.
LAW_STIFFENING = 1.0


class Compressible(MaterialEffect):
    """Poisson's ratio, instead of that of the material, and how the pressure rises with the loss of volume."""

    about: ClassVar[Description] = Description(
        title="compressible tissue",
        equation="K = 2 G (1 + nu) / (3 (1 - 2 nu)), U' = K (J - 1 - s/2 (J - 1)^2 + ...)",
        source="linear elasticity; Simo & Taylor (1982) for s = 1",
        where="material",
        strength="1 - 2 nu",
        plausible=0.4,
        needs="a wide and a narrow tool on a thin layer; with one tool it equals a change of C10",
        neighbours="C10 itself, drainage (needs time), layer",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "poisson": Sought((0.49, 0.47, 0.4), 0.2, NEARLY_INCOMPRESSIBLE, none=NEARLY_INCOMPRESSIBLE),
        "volume_stiffening": Sought((0.5,), 0.0, 2.0),
    }
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    changes_volume = True
    poisson: float = Field(ge=0.0, lt=0.5, description="Poisson's ratio")
    volume_stiffening: float = Field(
        default=LAW_STIFFENING, ge=0.0, le=2.0, description="s = -U'''(1) / K: 0 is K/2 (J - 1)^2, 1 is Simo and Taylor's energy"
    )

    @property
    def strength(self) -> float:
        return 1.0 - 2.0 * self.poisson

    def in_law(self, law: LawT) -> LawT:
        return law.model_copy(update={"poisson": self.poisson})

    def in_materials(self, effects: Sequence[MaterialEffect]) -> tuple[MaterialEffect, ...]:
        """With the volumetric energy of the law nothing is computed beside it."""
        return tuple(effects) if self.volume_stiffening == LAW_STIFFENING else (*effects, self)

    def apply(self, model: ModelT) -> ModelT:
        return in_materials(self, replace(model, material=self.in_law(model.material)))

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"dilate": dilate, "dilation_energy": dilation_energy}

    def values(self, increment_s: float) -> tuple[float, ...]:
        return (self.volume_stiffening,)


def dilate(J, K, blocks, block):
    """The elastic pressure U'(J) [Pa]; K is the bulk modulus."""
    s = number(blocks, block, AT)
    return (1.0 - s) * K * (J - 1.0) + s * volumetric.pressure(J, K)


def dilation_energy(J, K, blocks, block):
    """The volumetric energy U(J) [Pa]."""
    s = number(blocks, block, AT)
    return 0.5 * (1.0 - s) * K * (J - 1.0) * (J - 1.0) + s * volumetric.energy(J, K)
