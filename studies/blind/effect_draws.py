"""Strengths of hidden effects: one table for homogeneous tests and for tests under a tool."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from studies.blind.draws import LARGEST_STRENGTHS, signed_strength, strength
from studies.blind.grid import Parameters


class Scales(NamedTuple):
    """Sizes of a case, to which the strengths of its effects are relative.

    Attributes
    ----------
    one : 1.
    span_s, depth_mm, force_N, energy_Pa, strain : longest time, largest depth, force, strain energy and strain.
    modulus_Pa, shear_Pa : C10 and the shear modulus.
    third_Pa : third Yeoh constant that contributes as much as the first two.
    flexibility_mm_N, rate_N_s, slip_mm_kPa : depth over force, force over time, height over shear modulus.
    stress : largest stress or force of the elastic test.
    way : largest way of the tool [m], or strain.
    tangent_Pa : small-strain modulus of the test.
    """

    one: float = 1.0
    span_s: float = np.nan
    depth_mm: float = np.nan
    force_N: float = np.nan
    energy_Pa: float = np.nan
    strain: float = np.nan
    modulus_Pa: float = np.nan
    shear_Pa: float = np.nan
    third_Pa: float = np.nan
    flexibility_mm_N: float = np.nan
    rate_N_s: float = np.nan
    slip_mm_kPa: float = np.nan
    stress: float = np.nan
    way: float = np.nan
    tangent_Pa: float = np.nan


def third_constant_Pa(C10_Pa: float, C20_Pa: float, x: float) -> float:
    """C30 whose slope of the energy at I1 - 3 = x is that of the other two."""
    return (C10_Pa + 2.0 * C20_Pa * x) / (3.0 * x**2)


Drawn = float | list[float] | int
Make = Callable[[np.random.Generator, float], Drawn]


def _from_one(rng: np.random.Generator, drawn: float) -> float:
    """A ratio above 1, or its inverse."""
    return drawn ** float(rng.choice([-1.0, 1.0]))


class Range(NamedTuple):
    """A parameter of an effect, drawn evenly on a logarithmic scale between multiples of a scale; fixed if these are equal."""

    name: str
    low: float
    high: float
    of: str = "one"
    signed: bool = False
    make: Make = lambda rng, drawn: drawn

    def draw(self, rng: np.random.Generator, scales: Scales, largest: float) -> Drawn:
        """A value; no larger than the largest plausible strength."""
        scale = getattr(scales, self.of)
        if self.low == self.high:
            return self.make(rng, self.low * scale)
        return self.make(rng, (signed_strength if self.signed else strength)(rng, self.low * scale, self.high * scale, largest))


# The first parameter of an effect is bounded by the largest plausible strength.
HOMOGENEOUS: dict[str, tuple[Range, ...]] = {
    "viscoelastic": (Range("g", 0.02, 0.6, make=lambda _, g: [g]), Range("tau_s", 0.01, 0.5, "span_s", make=lambda _, t: [t])),
    "softening": (Range("inverse_r", 0.03, 0.7), Range("m_Pa", 0.05, 0.5, "energy_Pa")),
    "third-yeoh": (Range("C30_Pa", 0.02, 1.0, "third_Pa"),),
    "fibres": (Range("k1_Pa", 0.02, 5.0, "modulus_Pa"), Range("k2", 0.3, 3.0)),
    "cycle-drift": (Range("per_cycle", 0.003, 0.1, signed=True),),
    "contact-offset": (Range("offset_mm", 0.005, 0.15, "depth_mm", signed=True),),
    "compliance": (Range("compliance_mm_N", 0.005, 0.3, "flexibility_mm_N"),),
    "force-offset": (Range("offset_N", 0.005, 0.2, "force_N", signed=True),),
    "force-drift": (Range("rate_N_s", 0.005, 0.2, "rate_N_s", signed=True),),
    "power-law": (Range("t0_s", 3e-4, 0.02, "span_s"), Range("share", 0.3, 0.9), Range("exponent", 0.15, 0.35)),
    "threshold": (
        Range("strain", 1.0, 1.0, "strain", make=lambda rng, strain: round(float(rng.uniform(0.3, 0.7) * strain), 4)),
        Range("modulus_Pa", 0.5, 6.0, "tangent_Pa"),
    ),
    "stick-slip": (
        Range("way", 0.08, 0.25, "way"),
        Range("drag", 0.02, 0.12, "stress"),
        Range("seed", 1.0, 1.0, make=lambda rng, _: int(rng.integers(1 << 31))),
    ),
}
UNDER_A_TOOL: dict[str, tuple[Range, ...]] = {
    "viscoelastic": (Range("g", 0.05, 0.5, make=lambda _, g: [g]), Range("tau_s", 0.02, 0.5, "span_s", make=lambda _, t: [t])),
    "softening": (Range("inverse_r", 0.1, 0.7), Range("m_Pa", 0.02, 0.3, "energy_Pa")),
    "friction": (Range("coefficient", 0.05, 1.0),),
    "third-yeoh": (Range("C30_Pa", 0.05, 1.0, "third_Pa"),),
    "compressible": (Range("poisson", 0.01, 0.3, make=lambda _, drawn: 0.5 * (1.0 - drawn)),),
    "layer": (Range("thickness_mm", 0.5, 4.0), Range("ratio", 1.3, 6.0, make=_from_one)),
    "stiffness-gradient": (Range("g", 0.05, 0.7, signed=True),),
    "base-slip": (Range("compliance_mm_kPa", 50.0, 5e3, "slip_mm_kPa"),),
    "adhesion": (Range("stress_Pa", 0.02, 0.4, "shear_Pa"),),
    "contact-offset": (Range("offset_mm", 0.01, 0.15, "depth_mm", signed=True),),
    "compliance": (Range("compliance_mm_N", 0.005, 0.2, "flexibility_mm_N"),),
    "force-offset": (Range("offset_N", 0.005, 0.2, "force_N", signed=True),),
    "force-drift": (Range("rate_N_s", 0.01, 0.2, "rate_N_s", signed=True),),
    "gravity": (Range("acceleration_m_s2", 9.81, 9.81),),
}


def draw_effect(rng: np.random.Generator, name: str, table: dict[str, tuple[Range, ...]], scales: Scales) -> Parameters:
    """Parameters of an effect as a model file states them."""
    largest = LARGEST_STRENGTHS.get(name, np.inf)
    return {parameter.name: parameter.draw(rng, scales, np.inf if k else largest) for k, parameter in enumerate(table[name])}
