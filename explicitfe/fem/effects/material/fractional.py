"""Fractional Zener relaxation: the isochoric stress of a sudden strain falls as 1 - g + g E_alpha(-(t / tau)^alpha).

E_alpha is the Mittag-Leffler function: a stretched exponential for t << tau, and the power law t^-alpha for t >> tau. Its
distribution of relaxation rates r = tau e^u is known and positive (Caputo & Mainardi 1971, Mainardi 2010, eq. 3.36),

    E_alpha(-t^alpha) = integral of K(u) exp(-t e^u) du,   K(u) = sin(pi alpha) / (2 pi (cosh(alpha u) + cos(pi alpha))),

so that it is a Prony series, here by the midpoint rule in v with u = a sinh(v). K has its poles at u = i pi (1 - alpha) / alpha =
i a, which the substitution moves to v = i pi / 2 for every alpha, so that the rule converges exponentially. The two tails that
the rule leaves out are one term each, of the mean rate of the slow tail and the mean time of the fast one.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Sought
from explicitfe.fem.effects.material.viscoelastic import PronySeries

# With these numbers the series is within 5e-4 of the function for times from 1e-6 to 1e4 tau and exponents from 0.1 to 0.95.
TERMS_OF_FRACTIONAL = 20
SLOW_DECADES, FAST_DECADES = 5.0, 6.5
POINTS_IN_TAIL = 16  # of a Gauss-Laguerre rule


class Fractional(PronySeries):
    """Share, exponent and time of the fall."""

    about: ClassVar[Description] = Description(
        title="fractional relaxation",
        equation="S = integral of (1 - g + g E_alpha(-((t - s) / tau)^alpha)) dS_el(s)",
        source="Caputo & Mainardi (1971) Pure Appl. Geophys. 91:134-147; Mainardi (2010) Fractional Calculus and Waves in Linear "
        "Viscoelasticity, sections 3.1 to 3.3",
        where="material",
        strength="g",
        plausible=0.95,
        needs="a long hold, or rates that differ by decades",
        neighbours="power-law (relaxes to nothing), viscoelastic (one time a term), softening, drainage",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "g": Sought((0.3, 0.6, 0.9), 0.0, 0.999, kind="rest"),
        "alpha": Sought((0.25, 0.6), 0.1, 0.9),
        "tau_s": Sought((1e-3, 0.02, 0.4), 1e-4, 100.0, scale="duration_s", kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("time",)
    variant_of: ClassVar[str] = "viscoelastic"
    g: float = Field(ge=0.0, lt=1.0, description="share of the sudden stress that is lost in the end")
    alpha: float = Field(ge=0.1, le=0.95, description="order of the derivative: the smaller, the more decades the fall takes")
    tau_s: float = Field(gt=0.0, description="time about which the stress falls [s]")

    @property
    def strength(self) -> float:
        return self.g

    @property
    def series(self) -> tuple[np.ndarray, np.ndarray]:
        rates, shares = _series(self.alpha)
        return self.g * shares, self.tau_s / rates


def _density(alpha: float, u: np.ndarray) -> np.ndarray:
    """K at logarithms u of the rate; its integral is 1."""
    return np.sin(np.pi * alpha) / (2.0 * np.pi * (np.cosh(alpha * u) + np.cos(np.pi * alpha)))


def _tail(alpha: float, u: float) -> tuple[float, float]:
    """Integral of K from u on, and the logarithm of the harmonic mean of the rates there."""
    share = 0.5 - float(np.arctan(np.tan(0.5 * np.pi * alpha) * np.tanh(0.5 * alpha * u))) / (np.pi * alpha)
    points, weights = np.polynomial.laguerre.laggauss(POINTS_IN_TAIL)
    return share, u + float(np.log(share / (weights @ _density(alpha, u + points))))


@lru_cache(maxsize=1000)
def _series(alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """Rates of the terms over 1 / tau, and the share of the function that each has; the shares add up to 1."""
    a = np.pi * (1.0 - alpha) / alpha
    slow, fast = np.log(10.0) * SLOW_DECADES, np.log(10.0) * FAST_DECADES
    ends = np.linspace(-np.arcsinh(slow / a), np.arcsinh(fast / a), TERMS_OF_FRACTIONAL - 1)
    v = 0.5 * (ends[1:] + ends[:-1])
    u = a * np.sinh(v)
    shares = _density(alpha, u) * np.cosh(v)
    (slow_share, slow_u), (fast_share, fast_u) = _tail(alpha, slow), _tail(alpha, fast)  # K is even
    shares *= (1.0 - slow_share - fast_share) / shares.sum()
    return np.exp(np.concatenate([[-slow_u], u, [fast_u]])), np.concatenate([[slow_share], shares, [fast_share]])
