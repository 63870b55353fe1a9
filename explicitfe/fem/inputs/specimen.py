"""Geometry of an indentation: a specimen on a table, and the rigid tool that presses on it."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from explicitfe.fem.inputs.limits import ElementName
from explicitfe.fem.inputs.material import Material
from explicitfe.fem.inputs.table import Size, Table, Vector


class SpecimenTable(Table):
    """A cylinder or a block of tissue with its base at z = 0, under a tool that moves down along the z axis."""

    name: Literal["specimen"] = Field(default="specimen", description="a block or a cylinder of tissue")
    symmetry: Literal["sector", "quarter", "half", "whole"] = Field(
        default="sector", description="computed part of the specimen; a sector represents a body of revolution"
    )
    radius_mm: float | None = Field(default=None, gt=0.0, description="of a cylinder")
    height_mm: float | None = Field(default=None, gt=0.0, description="of a cylinder")
    size_mm: Size | None = Field(default=None, description="of a block, instead of radius and height: [x, y, z]")
    layer_mm: float = Field(default=0.0, ge=0.0, description="thickness of a surface layer, such as the mucosa")
    layer_stiffness_ratio: float = Field(default=1.0, gt=0.0, description="its moduli relative to the tissue below")
    base: Literal["bonded", "sliding"] = Field(
        default="bonded", description="whether the lower face is glued to the table or slides"
    )
    bonded_radius_mm: float | None = Field(
        default=None, gt=0.0, description="a bonded base is so only within this distance of the axis, and slides beyond"
    )
    material: Material = Field(default="gerard-2005", description="a name, see 'explicitfe list materials', or constants")
    element: ElementName = Field(
        default="hex8",
        description="one point with assumed-strain hourglass control, one point with plain stiffness, or eight points",
    )
    gravity_m_s2: Vector = Field(default=(0.0, 0.0, 0.0), description="acceleration of gravity; it acts before the tool touches")
    edge_size_mm: float | None = Field(
        default=None, gt=0.0, description="size of the elements at the edge of the tool; derived from the tool by default"
    )
    refinement: float = Field(
        default=1.0,
        ge=0.01,
        le=100.0,
        description="divides all element sizes; 100 in each direction are a million times as many elements",
    )

    @model_validator(mode="after")
    def _one_shape(self) -> SpecimenTable:
        round_ = self.radius_mm is not None and self.height_mm is not None
        if (self.radius_mm is not None or self.height_mm is not None) and self.size_mm is not None:
            raise ValueError("give radius_mm and height_mm (a cylinder) or size_mm (a block), not both")
        if not round_ and self.size_mm is None:
            raise ValueError("give radius_mm and height_mm (a cylinder) or size_mm (a block)")
        if self.size_mm is not None and min(self.size_mm) <= 0.0:
            raise ValueError("the lengths of size_mm must be above 0")
        if self.size_mm is not None and self.symmetry == "sector":
            raise ValueError('a sector is for a cylinder; for a block take symmetry = "quarter", "half" or "whole"')
        if self.layer_mm >= self.thickness_mm:
            raise ValueError("layer_mm must be less than the height of the specimen")
        if self.bonded_radius_mm is not None and self.base != "bonded":
            raise ValueError('bonded_radius_mm goes with base = "bonded"')
        sideways = [k for k, free in (("x", ("half", "whole")), ("y", ("whole",))) if self.symmetry not in free]
        if any(self.gravity_m_s2["xyz".index(k)] for k in sideways):
            raise ValueError(f"gravity_m_s2 must not act along {' or '.join(sideways)}: symmetry = {self.symmetry!r} excludes it")
        return self

    @property
    def thickness_mm(self) -> float:
        """Thickness along z."""
        if self.size_mm is not None:
            return self.size_mm[2]
        assert self.height_mm is not None  # _one_shape has checked it
        return self.height_mm

    @property
    def smallest_radius_mm(self) -> float:
        """Distance of the nearest side from the axis."""
        if self.size_mm is not None:
            return 0.5 * min(self.size_mm[:2])
        assert self.radius_mm is not None  # _one_shape has checked it
        return self.radius_mm


def _coefficient(value: object) -> object:
    possible = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value <= 1.0
    if value != "stick" and not possible:
        raise ValueError('must be a coefficient from 0 to 1, or "stick"')
    return value


Friction = Annotated[float | Literal["stick"], BeforeValidator(_coefficient)]


class ToolTable(Table):
    """A rigid tool that moves down along the z axis."""

    shape: Literal["flat-cylinder", "sphere", "platen", "bonded-disc"] = Field(
        description="shape of the tool; a platen is wider than the specimen, a bonded disc is glued to it"
    )
    radius_mm: float | None = Field(default=None, gt=0.0, description="radius of the tool; not for a platen")
    edge_radius_mm: float | None = Field(default=None, gt=0.0, description="radius of the edge of a flat cylinder; 1 by default")
    friction: Friction = Field(default=0.0, description='a coefficient from 0 to 1, or "stick"')

    @model_validator(mode="after")
    def _whole(self) -> ToolTable:
        if (self.shape == "platen") != (self.radius_mm is None):
            raise ValueError("radius_mm is required for every shape except a platen, which has none")
        if self.edge_radius_mm is not None and self.shape != "flat-cylinder":
            raise ValueError('edge_radius_mm is possible for shape = "flat-cylinder" only')
        if self.shape == "flat-cylinder" and self.rounding_mm > (self.radius_mm or 0.0):
            raise ValueError("edge_radius_mm must not be above radius_mm")
        if self.shape == "bonded-disc" and self.friction != 0.0:
            raise ValueError("a bonded disc is glued to the specimen and has no friction; remove friction")
        return self

    @property
    def outer_radius_mm(self) -> float:
        """Radius of the tool; infinite for a platen."""
        return math.inf if self.radius_mm is None else self.radius_mm

    @property
    def rounding_mm(self) -> float:
        """Radius of the edge of a flat cylinder."""
        return 1.0 if self.edge_radius_mm is None else self.edge_radius_mm
