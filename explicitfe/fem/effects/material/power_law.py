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

from explicitfe.fem.effects.effect import Description, Sought
from explicitfe.fem.effects.material.viscoelastic import PronySeries

# With these numbers the series is within 4e-4 of the power law for times up to 1e4 tau, and within 6e-4 up to 1e5 tau.
TERMS_OF_POWER_LAW = 18
DECADES_PER_TERM = 0.42
FASTEST_RATE_TAU = 5.5


class PowerLaw(PronySeries):
    """Exponent and time of the fall."""

    about: ClassVar[Description] = Description(
        title="power-law relaxation",
        equation="S = integral of (1 + (t - s) / tau)^-n dS_el(s)",
        source="Williams (1964) AIAA J. 2:785-808; as a series: Beylkin & Monzon (2010) Appl. Comput. Harmon. Anal. 28:131-149",
        where="material",
        strength="n",
        plausible=0.4,
        needs="a long hold, or rates that differ by decades",
        neighbours="viscoelastic (stops relaxing after its time), softening, drainage",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "exponent": Sought((0.03, 0.1, 0.3), 0.0, 0.9),
        "tau_s": Sought((5e-4, 5e-3, 5e-2), 1e-5, 10.0, scale="duration_s", kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("time",)
    variant_of: ClassVar[str] = "viscoelastic"
    exponent: float = Field(ge=0.0, lt=1.0, description="n, the slope of the fall on logarithmic axes")
    tau_s: float = Field(gt=0.0, description="time after which the stress falls as a power [s]")

    @property
    def strength(self) -> float:
        return self.exponent

    @property
    def series(self) -> tuple[np.ndarray, np.ndarray]:
        rates, shares = _series(self.exponent)
        return shares, self.tau_s / rates


@lru_cache(maxsize=1000)
def _series(exponent: float) -> tuple[np.ndarray, np.ndarray]:
    """Rates of the terms over 1 / tau, and the share of the sudden stress that each loses; 1 less their sum would relax later."""
    from scipy.special import gamma, gammainc

    step = np.log(10.0) * DECADES_PER_TERM
    rates = np.exp(np.log(FASTEST_RATE_TAU) - step * np.arange(TERMS_OF_POWER_LAW))
    if exponent == 0.0:
        return rates, np.zeros(TERMS_OF_POWER_LAW)
    weights = step * rates**exponent * np.exp(-rates) / gamma(exponent)
    later = float(gammainc(exponent, rates[-1] * np.exp(-0.5 * step)))
    return rates, weights * (1.0 - later) / weights.sum()
