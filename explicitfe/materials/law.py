"""What every material law has in common: constants with units, checked where they are read."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from pydantic import BaseModel, ConfigDict, Field


class Law(BaseModel, ABC):
    """Constants of one material law, as a scenario or a material table states them (units in the key names)."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    law: str
    poisson: float = Field(
        default=0.499, ge=0.0, lt=0.5, description="initial Poisson's ratio; 0.5 would need an infinite bulk modulus"
    )
    density_kg_m3: float = Field(default=1040.0, gt=0.0, description="density [kg/m^3]")
    source: str = Field(default="", description="where the constants come from")

    @property
    @abstractmethod
    def shear_modulus_Pa(self) -> float:
        """Initial shear modulus [Pa]."""

    @abstractmethod
    def constants(self) -> tuple[float, ...]:
        """What the compiled law reads, in the order that its ``energy`` and ``stress`` document."""

    def scaled(self, constants: np.ndarray, factor: np.ndarray) -> np.ndarray:
        """Constants (m, k) of elements that are stiffer by a factor (m,): moduli all, unless a law has others."""
        return constants * factor[:, None]
