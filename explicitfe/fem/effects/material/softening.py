"""Softening after a larger past load: eta S, eta = 1 - erf((Wm - W) / (m + beta Wm)) / r (Ogden & Roxburgh 1999).

Wm is the largest isochoric energy so far. On the way up eta is 1; below, the tissue is softer until it gets there again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, number, remember, remembered
from explicitfe.platform.compiled.jit import Template
from explicitfe.platform.compiled.simd import erf, exp, maximum

AT = MEMORY = 0
ROOT_PI = 1.0 / math.sqrt(math.pi)


class Softening(MaterialEffect):
    """Constants of the Ogden-Roxburgh softening; W in Pa."""

    about: ClassVar[Description] = Description(
        title="softening by past load (Mullins)",
        equation="S = eta S_iso, eta = 1 - erf((Wm - W) / (m + beta Wm)) / r",
        source="Ogden & Roxburgh (1999) Proc. R. Soc. A 455:2861-2877",
        where="material",
        strength="1/r",
        plausible=0.8,
        needs="unloading, or reloading below an earlier maximum",
        neighbours="viscoelastic (depends on time, relaxes in a hold); friction (loop at the first cycle too); cycle-drift",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "inverse_r": Sought((0.15, 0.4, 0.8), 0.0, 0.99),
        "m_Pa": Sought((0.02, 0.1, 0.5), 2e-3, 10.0, scale="energy_Pa", kind="log"),
        "beta": Sought((0.0, 0.15), 0.0, 1.0),
    }
    requires: ClassVar[tuple[str, ...]] = ("unloading",)
    remembers = True
    depends_on_path = True
    inverse_r: float = Field(ge=0.0, lt=1.0, description="1/r, the largest share of the stress that can be lost")
    m_Pa: float = Field(gt=0.0, description="energy below which little softens [Pa]")
    beta: float = Field(default=0.1, ge=0.0, description="how the width of the transition grows with the past energy")

    @property
    def strength(self) -> float:
        return self.inverse_r

    @property
    def memory(self) -> int:
        return 1

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"soften": soften, "recoverable": recoverable}

    def values(self, increment_s: float) -> tuple[float, ...]:
        return self.inverse_r, self.m_Pa, self.beta


def soften(W, blocks, block):
    """The factor eta of the isochoric stress at energy W [Pa]."""
    largest = maximum(remembered(blocks, block, MEMORY), W)
    remember(blocks, block, MEMORY, largest)
    x = (largest - W) / (number(blocks, block, AT + 1) + number(blocks, block, AT + 2) * largest)
    return 1.0 - number(blocks, block, AT) * erf(x)


def recoverable(W, blocks, block):
    """The energy that unloading would give back [Pa]: the integral of eta dW from 0 to W at the past maximum."""
    largest = maximum(remembered(blocks, block, MEMORY), W)
    width = number(blocks, block, AT + 1) + number(blocks, block, AT + 2) * largest
    x, top = (largest - W) / width, largest / width
    area = top * erf(top) + ROOT_PI * exp(-(top * top)) - x * erf(x) - ROOT_PI * exp(-(x * x))
    return W - number(blocks, block, AT) * width * area
