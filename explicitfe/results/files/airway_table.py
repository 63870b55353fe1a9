"""What a result knows of the airway around the tongue: the table of the model, ``models/tongue/airway.toml``."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0.0)]


class AirwayPart(BaseModel):
    """A table of it."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class WallTable(AirwayPart):
    """The walls of the pharynx.

    Attributes
    ----------
    height_mm, half_width_mm : (k,) z, rising, and how far the posterior wall reaches to each side, where the side walls stand.
    y_mm : (l,) from 0, rising.
    back_mm : (k, l) x of the posterior wall.
    side_front_mm, front_radius_mm : x of the front edge of the side walls, and the radius that rounds its inner side; results of
        earlier versions have a sharp one.
    thickness_mm : of the walls as a surface that the tongue touches.
    """

    title: str
    height_mm: list[float] = Field(min_length=2)
    half_width_mm: list[Positive]
    y_mm: list[float] = Field(min_length=2)
    back_mm: list[list[float]]
    side_front_mm: float
    front_radius_mm: Annotated[float, Field(ge=0.0)] = 0.0
    thickness_mm: Positive

    @model_validator(mode="after")
    def _shapes_agree(self) -> WallTable:
        rows, columns = len(self.height_mm), len(self.y_mm)
        if len(self.half_width_mm) != rows or [len(row) for row in self.back_mm] != [columns] * rows:
            raise ValueError("the wall has a row for each height_mm, and in it a figure for each y_mm")
        if any(sorted(set(values)) != values for values in (self.height_mm, self.y_mm)):
            raise ValueError("height_mm and y_mm must rise")
        return self


class LarynxTable(AirwayPart):
    """What is assumed below the lowest section that is measured."""

    tube_length_mm: Positive
    tube_area_mm2: Positive
    opening_mm: float
    lowest_section_mm: float


class NeutralLips(AirwayPart):
    """The opening of the lips where a scenario says nothing of them."""

    area_mm2: Positive
    length_mm: Positive


class AirwayTable(AirwayPart):
    """The airway of a model."""

    wall: WallTable
    larynx: LarynxTable
    lips: NeutralLips
