"""What cases of all families draw alike: constants, strengths of effects, noise."""

from __future__ import annotations

import numpy as np

from studies.blind.case import CaseRequest
from studies.blind.noise import Noise

C10_RANGE_PA = (100.0, 3000.0)  # the tongue's is 192 Pa (Gerard et al. 2005)
LARGEST_C20_OVER_C10 = 1.5
CORRELATED_NOISE_SHARE = 0.2  # in this share of the cases with an effect the noise is correlated from row to row
ROW_CORRELATION_RANGE = (0.5, 0.95)  # from row to row
# The largest strengths that the library calls plausible; no hidden effect exceeds them.
LARGEST_STRENGTHS = {
    "third-yeoh": 1000.0,
    "fibres": 20000.0,
    "contact-offset": 1.0,
    "compliance": 1.0,
    "force-offset": 0.1,
    "force-drift": 0.001,
    "base-slip": 100.0,
    "adhesion": 500.0,
}


def draw_constants(rng: np.random.Generator) -> tuple[float, float]:
    """C10 and C20 [Pa]; one tissue of ten does not stiffen."""
    C10 = float(f"{np.exp(rng.uniform(*np.log(C10_RANGE_PA))):.4g}")
    C20 = 0.0 if rng.random() < 0.1 else float(f"{rng.uniform(0.0, LARGEST_C20_OVER_C10) * C10:.4g}")
    return C10, C20


def draw_noise(rng: np.random.Generator, request: CaseRequest, largest: float) -> Noise:
    """Noise of a case whose largest value is ``largest``, in the unit of its rows."""
    correlated = request.subjects == ("correlated",) or (request.kind != "control" and rng.random() < CORRELATED_NOISE_SHARE)
    rho = round(float(rng.uniform(*ROW_CORRELATION_RANGE)), 3) if correlated else 0.0
    scatter = request.subjects == ("scatter",)
    scale = round(float(rng.uniform(0.03, 0.10)), 4) if scatter else 0.0
    return Noise(request.level, request.level * largest, rho, scale, 0.01 * largest if scatter else 0.0)


def strength(rng: np.random.Generator, low: float, high: float, largest: float = np.inf) -> float:
    """A strength between two values, even on a logarithmic scale, but never above the largest plausible one."""
    high = min(high, largest)
    low = min(low, high)
    return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")


def signed_strength(rng: np.random.Generator, low: float, high: float, largest: float = np.inf) -> float:
    """A strength of either sign."""
    return float(rng.choice([-1.0, 1.0])) * strength(rng, low, high, largest)
