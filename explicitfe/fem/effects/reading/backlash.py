"""Play between the drive, whose motion is recorded, and the tool or the grip: after each turn the tool waits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class Backlash(Measurement):
    """Width of the play. On the way in the drive pushes the tool; on the way back it goes so far before the tool follows."""

    about: ClassVar[Description] = Description(
        title="backlash of the drive",
        equation="d_tool = min(max(d_tool before, d), d + b)",
        source="play operator (Krasnosel'skii & Pokrovskii 1983)",
        where="measurement",
        strength="b (mm)",
        plausible=0.3,
        needs="unloading",
        neighbours="softening and friction (lose a share of the load), viscoelastic (relaxes in a hold)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"play_mm": Sought((0.01, 0.03, 0.1), 0.0, 0.3, scale="displacement_mm")}
    sought_without_tool: ClassVar[Mapping[str, Sought]] = {"play_strain": Sought((0.01, 0.03, 0.1), 0.0, 0.3, scale="strain")}
    requires: ClassVar[tuple[str, ...]] = ("unloading",)
    without_tool = True
    play_mm: float = Field(default=0.0, ge=0.0, description="width of the play [mm]")
    play_strain: float = Field(default=0.0, ge=0.0, description="the same where strains are read")

    @property
    def strength(self) -> float:
        return self.play_mm or self.play_strain

    def true_motion(self, read: np.ndarray, record: Record) -> np.ndarray:
        followed, play = np.empty_like(read), self._play(record)
        now = record.side * read[0]
        for row, drive in enumerate(record.side * read):
            now = min(max(now, drive), drive + play)
            followed[row] = now
        return record.side * followed

    def read_motion(self, true: np.ndarray, record: Record) -> np.ndarray:
        """On the way back the drive is ahead by the width of the play."""
        back, ahead = False, np.zeros(len(true))
        for row, step in enumerate(np.diff(record.side * true), 1):
            back = step < 0.0 if step else back
            ahead[row] = self._play(record) if back else 0.0
        return true - record.side * ahead

    def _play(self, record: Record) -> float:
        return 1e-3 * self.play_mm if record.with_tool else self.play_strain
