"""The tables of a scenario that tell what a surgeon did: what was taken out, what was put in, where it scarred.

Lengths and places are those of the undeformed model, in mm. An element belongs to a region if its centre lies in it.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from explicitfe.fem.inputs.material import Material
from explicitfe.fem.inputs.table import Table, Vector, row_of

Corners = Annotated[tuple[Vector, Vector], row_of(2, "two corners [[x0, y0, z0], [x1, y1, z1]]")]


SHORTEST_NORMAL = 1e-6  # of a plane: below it the direction drowns in rounding


class SphereTable(Table):
    """The inside of a sphere."""

    centre_mm: Vector
    radius_mm: float = Field(gt=0.0)


class PlaneTable(Table):
    """One side of a plane: the one that its normal points to."""

    point_mm: Vector = Field(description="a point of the plane")
    normal: Vector = Field(description="points to the side that is meant; of any length above 0.000001")

    @model_validator(mode="after")
    def _normal_has_a_length(self) -> PlaneTable:
        if math.hypot(*self.normal) < SHORTEST_NORMAL:
            raise ValueError("normal must have a length above 0.000001")
        return self


class RegionTable(Table):
    """A part of the body; where several of the keys are given, what lies in all of them."""

    box_mm: Corners | None = Field(default=None, description="two opposite corners of a box along the axes")
    sphere: SphereTable | None = None
    plane: PlaneTable | None = None
    set: str | None = Field(
        default=None, description="an element set, or a node set: the elements whose eight nodes all belong to it"
    )

    @model_validator(mode="after")
    def _region_is_given(self) -> RegionTable:
        if (self.box_mm, self.sphere, self.plane, self.set) == (None,) * 4:
            raise ValueError("give a region: box_mm, sphere, plane or set")
        if self.box_mm is not None and any(low >= high for low, high in zip(*self.box_mm, strict=True)):
            raise ValueError("the first corner of box_mm must lie below the second along x, y and z")
        return self


class ResectionTable(RegionTable):
    """Tissue that is taken out."""


class GraftTable(RegionTable):
    """A flap of other tissue without muscle, where tissue was or was taken out."""

    material: Material | None = Field(default=None, description="its constants, of the law of the model's material")
    stiffness_ratio: float | None = Field(default=None, gt=0.0, description="its moduli over those of the model's material")

    @model_validator(mode="after")
    def _tissue_is_given(self) -> GraftTable:
        if (self.material is None) == (self.stiffness_ratio is None):
            raise ValueError("give either material or stiffness_ratio, and not both")
        return self


class ScarTable(Table):
    """The tissue beside a cut or a graft, stiffer than before."""

    thickness_mm: float = Field(gt=0.0, description="how far from the cut, or from the border of a graft, the tissue is a scar")
    stiffness_ratio: float = Field(gt=0.0, description="its moduli over those of the tissue that it was")
