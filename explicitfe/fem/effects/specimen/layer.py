"""A surface layer, such as the mucosa, of its own stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import SpecimenT, ToolT
from explicitfe.fem.effects.effect import Description, Effect, Sought


class Layer(Effect):
    """Thickness and stiffness of a layer on the surface of a specimen."""

    about: ClassVar[Description] = Description(
        title="surface layer",
        equation="moduli x ratio where z > height - thickness",
        source="Gerard et al. (2005) Med. Eng. Phys. 27:884-892 measure with and without mucosa",
        where="specimen",
        strength="(ratio - 1) x thickness / height",
        plausible=0.5,
        needs="two tool radii, or depths that reach from the layer into what is below",
        neighbours="stiffness-gradient, third-yeoh, C10 itself",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "ratio": Sought((0.6, 0.25, 1.7, 4.0), 0.02, 50.0, kind="log", none=1.0),
        "thickness_mm": Sought((0.05, 0.2), 0.01, 0.6, scale="height_mm", kind="log"),
    }
    variant_of: ClassVar[str] = "stiffness-gradient"
    requires: ClassVar[tuple[str, ...]] = ("tool",)
    acts_on = "specimen"
    thickness_mm: float = Field(gt=0.0, description="thickness [mm]")
    ratio: float = Field(gt=0.0, description="its moduli relative to the tissue below")

    @property
    def strength(self) -> float:
        return self.ratio - 1.0

    def prepare(self, specimen: SpecimenT, tool: ToolT) -> tuple[SpecimenT, ToolT]:
        changed = {"layer_mm": self.thickness_mm, "layer_stiffness_ratio": self.ratio}
        return type(specimen).model_validate(specimen.model_dump() | changed), tool
