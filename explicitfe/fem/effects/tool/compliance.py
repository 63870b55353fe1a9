"""A rig that gives way: the machine's displacement is the tool's plus force times compliance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from explicitfe.fem.effects.affected import ModelT, tool_of
from explicitfe.fem.effects.effect import Description, Effect, Rig, Sought


class Compliance(Effect):
    """Compliance of load cell and frame, in series with the tissue."""

    about: ClassVar[Description] = Description(
        title="compliance of the rig",
        equation="d_machine = d_tool + c F",
        source="two springs in series",
        where="measurement",
        strength="c (mm/N)",
        plausible=1.0,
        needs="stiff and soft parts of a curve, or two radii",
        neighbours="C20, layer",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"compliance_mm_N": Sought((0.03, 0.1, 0.3), 0.0, 0.9, scale="compliance_mm_N")}
    sought_without_tool: ClassVar[Mapping[str, Sought]] = {
        "strain_per_kPa": Sought((0.03, 0.1, 0.3), 0.0, 0.9, scale="strain_per_kPa")
    }
    acts_on = "tool"
    pointwise = True
    without_tool = True
    compliance_mm_N: float = Field(default=0.0, ge=0.0, description="compliance [mm/N]")
    strain_per_kPa: float = Field(default=0.0, ge=0.0, description="the same where stresses are read: strain per stress [1/kPa]")

    @property
    def strength(self) -> float:
        return self.compliance_mm_N or self.strain_per_kPa

    def apply(self, model: ModelT) -> ModelT:
        return replace(model, tool=replace(tool_of(model), compliance_m_N=1e-3 * self.compliance_mm_N))

    def on_rig(self, rig: Rig) -> Rig:
        return replace(rig, compliance_m_N=1e-3 * self.compliance_mm_N, compliance_per_Pa=1e-3 * self.strain_per_kPa)
