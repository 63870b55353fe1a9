"""A load cell that was not at zero."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class ForceOffset(Measurement):
    """Constant error of the force, or of the stress."""

    about: ClassVar[Description] = Description(
        title="offset of the load cell",
        equation="F_read = F + F0",
        source="-",
        where="measurement",
        strength="F0 (N)",
        plausible=0.1,
        needs="rows before contact or small depths",
        neighbours="preload, contact-offset",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"offset_N": Sought((-0.02, -0.1, 0.02, 0.1), -0.5, 0.5, scale="force_N")}
    sought_without_tool: ClassVar[Mapping[str, Sought]] = {
        "offset_Pa": Sought((-0.02, -0.1, 0.02, 0.1), -0.5, 0.5, scale="stress_Pa")
    }
    without_tool = True
    offset_N: float = Field(default=0.0, description="reading without a load [N]")
    offset_Pa: float = Field(default=0.0, description="the same where stresses are read [Pa]")

    @property
    def strength(self) -> float:
        return self.offset_N or self.offset_Pa

    def read_load(self, true: np.ndarray, record: Record) -> np.ndarray:
        return true + self._offset(record)

    def true_load(self, read: np.ndarray, record: Record) -> np.ndarray:
        return read - self._offset(record)

    def _offset(self, record: Record) -> float:
        return self.offset_N if record.with_tool else self.offset_Pa
