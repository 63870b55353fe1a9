"""The zero of displacement is not first touch; without a tool, the zero of strain is not the state at rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.effect import Description, Measurement, Sought
from explicitfe.fem.effects.record import Record


class ContactOffset(Measurement):
    """How far the tool is from first touch where the displacement is called zero, or how strained a specimen is at strain zero.

    A negative strain in a test that goes to one side only is slack: the specimen bears nothing until it is taken up.
    """

    about: ClassVar[Description] = Description(
        title="offset of the contact point",
        equation="d_tool = d + d0",
        source="-",
        where="measurement",
        strength="d0 (mm)",
        plausible=1.0,
        needs="rows at small depths",
        neighbours="preload, force-offset, tilt",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"offset_mm": Sought((-0.03, -0.1, 0.03, 0.1), -0.5, 0.5, scale="displacement_mm")}
    sought_without_tool: ClassVar[Mapping[str, Sought]] = {
        "offset_strain": Sought((-0.03, -0.1, 0.03, 0.1), -0.5, 0.5, scale="strain")
    }
    without_tool = True
    offset_mm: float = Field(default=0.0, description="way of the tool into the tissue at displacement 0 [mm]; negative: a gap")
    offset_strain: float = Field(default=0.0, description="strain at strain 0, in the test's direction; negative: slack")

    @property
    def strength(self) -> float:
        return self.offset_mm or self.offset_strain

    def true_motion(self, read: np.ndarray, record: Record) -> np.ndarray:
        if record.with_tool:
            return read + 1e-3 * self.offset_mm
        moved = record.side * read + self.offset_strain
        return record.side * (np.maximum(moved, 0.0) if record.one_sided and record.kind == "uniaxial" else moved)

    def read_motion(self, true: np.ndarray, record: Record) -> np.ndarray:
        offset = 1e-3 * self.offset_mm if record.with_tool else self.offset_strain
        return true - record.side * offset
