"""A drive that sticks and slips: the guide drags at the tool until it lets go, again and again.

Stick and slip of a mass on a spring whose kinetic friction is half the static one (Bowden & Leben 1939): the drag grows with the
distance, from nothing to its largest value, and falls to nothing at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class StickSlip(Measurement):
    """Largest drag of a guide, and the distance after which it slips."""

    about: ClassVar[Description] = Description(
        title="stick-slip of the drive",
        equation="F_read = F + D s, s = distance since the last slip / w, slipping at |s| = 1",
        source="Bowden & Leben (1939) Proc. R. Soc. A 169:371-391",
        where="measurement",
        strength="D (N)",
        plausible=0.1,
        needs="rows closer than the distance between two slips",
        neighbours="viscoelastic (has no jumps), force-offset, noise that is correlated",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "drag_N": Sought((0.03, 0.1), 0.0, 0.5, scale="force_N"),
        "slip_distance_mm": Sought((0.03, 0.06, 0.12, 0.25, 0.5), 0.01, 2.0, scale="displacement_mm", kind="log"),
    }
    sought_without_tool: ClassVar[Mapping[str, Sought]] = {
        "drag_Pa": Sought((0.03, 0.1), 0.0, 0.5, scale="stress_Pa"),
        "slip_distance_strain": Sought((0.03, 0.06, 0.12, 0.25, 0.5), 0.01, 2.0, scale="strain", kind="log"),
    }
    without_tool = True
    drag_N: float = Field(default=0.0, ge=0.0, description="largest drag [N]")
    slip_distance_mm: float = Field(default=1.0, gt=0.0, description="distance between two slips [mm]")
    drag_Pa: float = Field(default=0.0, ge=0.0, description="largest drag where stresses are read [Pa]")
    slip_distance_strain: float = Field(default=0.1, gt=0.0, description="strain between two slips, where strains are read")

    @property
    def strength(self) -> float:
        return self.drag_N or self.drag_Pa

    def read_load(self, true: np.ndarray, record: Record) -> np.ndarray:
        return true + self._drag(record)

    def true_load(self, read: np.ndarray, record: Record) -> np.ndarray:
        return read - self._drag(record)

    def _drag(self, record: Record) -> np.ndarray:
        largest, distance = (
            (self.drag_N, 1e-3 * self.slip_distance_mm) if record.with_tool else (self.drag_Pa, self.slip_distance_strain)
        )
        bent, drag = 0.0, np.zeros(len(record.motion))
        for row, step in enumerate(np.diff(record.motion), 1):
            bent = float(np.fmod(bent + step / distance, 1.0))
            drag[row] = largest * bent
        return drag
