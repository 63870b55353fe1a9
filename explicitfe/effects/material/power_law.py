"""Relaxation without a time of its own: the isochoric stress of a sudden strain falls as (1 + t / tau)^-n.

This is the modified power law (Williams 1964): a straight line on logarithmic axes after tau. Since

    (1 + t / tau)^-n = integral of s^(n - 1) e^-s e^(-s t / tau) ds / Gamma(n),

it is a Prony series with times tau / s, here taken by the trapezoidal rule in log s (Beylkin & Monzon 2010), which converges
exponentially. What relaxes later than the slowest time counts as permanent.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.compiled.jit import Template
from explicitfe.effects.effect import Description, MaterialEffect, Sought
from explicitfe.effects.material.viscoelastic import branch_energy, prony_numbers, relax

# Until 10 000 tau, eight terms with these rates are within 1 % of the power law for exponents up to 0.3, within 1.2 % up to 0.5.
TERMS_OF_SERIES = 8
DECADES_PER_TERM = 0.7
FASTEST_RATE_TAU = 1.25


class PowerLaw(MaterialEffect):
    """Exponent and time of the fall."""

    about: ClassVar[Description] = Description(
        title="power-law relaxation",
        equation="S = integral of (1 + (t - s) / tau)^-n dS_el(s)",
        source="Williams (1964) AIAA J. 2:785-808; as a series: Beylkin & Monzon (2010) Appl. Comput. Harmon. Anal. 28:131-149",
        where="material",
        strength="n",
        plausible=0.4,
        needs="time: a long hold, or rates that differ by decades",
        neighbours="viscoelastic (stops relaxing after its time), softening, drainage",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "exponent": Sought((0.03, 0.1, 0.3), 0.0, 0.9),
        "tau_s": Sought((5e-4, 5e-3, 5e-2), 2e-4, 0.5, scale="duration_s", kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("time",)
    variant_of: ClassVar[str] = "viscoelastic"
    remembers = True
    depends_on_path = True
    exponent: float = Field(ge=0.0, lt=1.0, description="n, the slope of the fall on logarithmic axes")
    tau_s: float = Field(gt=0.0, description="time after which the stress falls as a power [s]")

    @property
    def strength(self) -> float:
        return self.exponent

    @property
    def long_term_share(self) -> float:
        return 1.0 - sum(_shares(self.exponent))

    @property
    def memory(self) -> int:
        return 6 + 6 * TERMS_OF_SERIES

    @property
    def shape(self) -> Mapping[str, int]:
        return {"TERMS": TERMS_OF_SERIES}

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"relax": relax, "branch_energy": branch_energy}

    def values(self, increment_s: float) -> tuple[float, ...]:
        """As those of a Prony series."""
        times = self.tau_s / _rates()
        return prony_numbers(_shares(self.exponent), times.tolist(), increment_s)


def _rates() -> np.ndarray:
    """Rates of the terms, over 1 / tau, the fastest first."""
    return FASTEST_RATE_TAU * 10.0 ** (-DECADES_PER_TERM * np.arange(TERMS_OF_SERIES))


@lru_cache(maxsize=1000)
def _shares(exponent: float) -> tuple[float, ...]:
    """Share of the sudden stress that each term loses; 1 less their sum is what would relax later."""
    from scipy.special import gamma, gammainc

    if exponent == 0.0:
        return (0.0,) * TERMS_OF_SERIES
    step, rates = np.log(10.0) * DECADES_PER_TERM, _rates()
    weights = step * rates**exponent * np.exp(-rates) / gamma(exponent)
    later = float(gammainc(exponent, rates[-1] * np.exp(-0.5 * step)))
    return tuple(float(share) for share in weights * (1.0 - later) / weights.sum())
