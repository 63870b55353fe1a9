"""The table of a scenario that tells how wide the lips are open: an end of the airway, which moves nothing."""

from __future__ import annotations

from pydantic import Field, model_validator

from explicitfe.fem.inputs.table import MOST_ROWS_OF_A_COURSE, Table, Vector


class LipsTable(Table):
    """The opening of the lips: a tube in front of the incisors, of an area and a length."""

    area_mm2: float | None = Field(default=None, ge=0.0, description="area of the opening; 0: closed")
    length_mm: float | None = Field(default=None, gt=0.0, description="from the incisors to the front of the lips")
    table: list[Vector] = Field(
        default=[], max_length=MOST_ROWS_OF_A_COURSE, description="[time_ms, area_mm2, length_mm] rows instead, linear in between"
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> LipsTable:
        if bool(self.table) == (self.area_mm2 is not None) or (self.area_mm2 is None) != (self.length_mm is None):
            raise ValueError("give area_mm2 and length_mm, or a table of [time_ms, area_mm2, length_mm] rows, and not both")
        times = [time for time, _, _ in self.table]
        if times != sorted(set(times)) or any(time < 0.0 for time in times):
            raise ValueError("the times of table must rise, from 0 on")
        if any(area < 0.0 or not length > 0.0 for _, area, length in self.table):
            raise ValueError("areas must not be negative and lengths must be positive")
        return self
