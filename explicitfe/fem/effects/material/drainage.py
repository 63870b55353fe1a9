"""Slow loss of pressure, as where fluid drains: p = (1 - d) p_el + q, dq/dt + q / tau = d dp_el/dt.

What a poroelastic tissue shows first, without its length scale: the bulk modulus relaxes from K to (1 - d) K.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, number, remember, remembered
from explicitfe.platform.compiled.jit import Template

AT = MEMORY = 0


class Drainage(MaterialEffect):
    """Relaxation of the volumetric stress."""

    about: ClassVar[Description] = Description(
        title="drainage",
        equation="p = (1 - d) p_el + q, dq/dt + q / tau = d dp_el/dt",
        source="one term of Simo (1987), on the pressure; cf. Mow, Kuei, Lai & Armstrong (1980)",
        where="material",
        strength="d",
        plausible=0.999,
        needs="a hold under a wide tool on a thin layer",
        neighbours="viscoelastic (relaxes free uniaxial compression as well)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "share": Sought((0.9, 0.99, 0.999), 0.0, 0.9995, kind="rest"),
        "tau_s": Sought((0.01, 0.05, 0.25), 1e-5, 100.0, scale="duration_s", kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("tool", "time")
    remembers = True
    depends_on_path = True
    share: float = Field(ge=0.0, lt=1.0, description="d, the share of the bulk modulus that is lost in the end")
    tau_s: float = Field(gt=0.0, description="time in which it drains [s]")

    @property
    def strength(self) -> float:
        return self.share

    @property
    def memory(self) -> int:
        return 2

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"drain": drain, "held": held}

    def values(self, increment_s: float) -> tuple[float, ...]:
        """1 - d, d (1 - e^-x) / x, e^-x and d, with x = increment / tau."""
        x = increment_s / self.tau_s
        gain = self.share * (-np.expm1(-x) / x if x > 0.0 else 1.0)
        return 1.0 - self.share, float(gain), float(np.exp(-x)), self.share


def drain(p, blocks, block):
    """The pressure [Pa] that is left of the elastic one."""
    q = number(blocks, block, AT + 2) * remembered(blocks, block, MEMORY + 1)
    q = q + number(blocks, block, AT + 1) * (p - remembered(blocks, block, MEMORY))
    remember(blocks, block, MEMORY, p)
    remember(blocks, block, MEMORY + 1, q)
    return number(blocks, block, AT) * p + q


def held(U, K, blocks, block):
    """Stored volumetric energy [Pa]: (1 - d) U + q^2 / (2 d K)."""
    q = remembered(blocks, block, MEMORY + 1)
    return number(blocks, block, AT) * U + q * q / (2.0 * K * number(blocks, block, AT + 3) + 1e-200)
