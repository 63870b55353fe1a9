"""Ogden with one to three terms: W = sum of 2 mu_i / alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3) + U(J).

l1, l2, l3 are the isochoric principal stretches (Ogden 1972). The convention is that of Abaqus: the initial shear modulus is the
sum of the mu_i. Constants of the original convention, W = sum of m_i / alpha_i (...), convert by mu_i = m_i alpha_i / 2.

The law is available for homogeneous tests only: in hex8 a step with one term costs 2.5 times a Yeoh step
(studies/benchmarks/ogden_step.py), and elements offer only laws that cost at most twice as much.
"""

from __future__ import annotations

from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from explicitfe.fem.materials.law import Law

SMALLEST_ALPHA = 0.01  # Nearer to 0 the energy is a difference of nearly equal numbers.
LARGEST_ALPHA = 100.0


class Ogden(Law):
    """Constants of the Ogden law; the initial shear modulus is mu1 + mu2 + mu3.

    With mu_i >= 0 each term is stable by itself for any sign of alpha_i.
    """

    reads: ClassVar[tuple[str, ...]] = ("mu1_Pa", "alpha1", "mu2_Pa", "alpha2", "mu3_Pa", "alpha3")

    law: Literal["ogden"] = "ogden"
    mu1_Pa: float = Field(gt=0.0, description="shear modulus of the first term [Pa]")
    alpha1: float = Field(description="exponent of the first term; 2 alone is the neo-Hooke law")
    mu2_Pa: float = Field(default=0.0, ge=0.0, description="shear modulus of the second term [Pa]")
    alpha2: float = Field(default=2.0, description="exponent of the second term")
    mu3_Pa: float = Field(default=0.0, ge=0.0, description="shear modulus of the third term [Pa]")
    alpha3: float = Field(default=2.0, description="exponent of the third term")

    @model_validator(mode="after")
    def _exponents(self) -> Self:
        for key in ("alpha1", "alpha2", "alpha3"):
            value = getattr(self, key)
            if not SMALLEST_ALPHA <= abs(value) <= LARGEST_ALPHA:
                raise ValueError(f"{key} = {value:g}: its magnitude must lie between {SMALLEST_ALPHA:g} and {LARGEST_ALPHA:g}.")
        return self

    @property
    def shear_modulus_Pa(self) -> float:
        return self.mu1_Pa + self.mu2_Pa + self.mu3_Pa

    @property
    def terms(self) -> list[tuple[float, float]]:
        """(mu [Pa], alpha) of the terms that are not zero."""
        pairs = ((self.mu1_Pa, self.alpha1), (self.mu2_Pa, self.alpha2), (self.mu3_Pa, self.alpha3))
        return [(mu, alpha) for mu, alpha in pairs if mu > 0.0]

    def stretch_derivative(self, stretch: np.ndarray) -> np.ndarray:
        return np.sum([2.0 * mu / alpha * stretch**alpha for mu, alpha in self.terms], axis=0)
